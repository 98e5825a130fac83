"""Views, as they are sent."""

import json
from collections.abc import Mapping
from typing import Any

from revline.web.answers import answer


def view(entries: Mapping[str, Any], *parts: str) -> dict[str, Any]:
    """Parts of a view, as they are sent."""
    found = answer("view", json.dumps({"state": dict(entries), "parts": list(parts)}).encode())
    assert found.status == 200, found.body
    return dict(json.loads(found.body)["parts"])
