"""Each example on the page about the HTTP API is asked, and answered with what the page shows."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from revline.web.answers import OWN, answer
from revline.web.asked.registry import ASKED

PAGE = (Path(__file__).parents[2] / "docs" / "http-api.md").read_text()
BLOCK = re.compile(r"^```json\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"`POST /api/v1/([\w-]+)`")


def examples() -> list[tuple[str, str, str]]:
    """Question, request and answer, each of the last question named before it."""
    found = list(BLOCK.finditer(PAGE))
    pairs = zip(found[::2], found[1::2], strict=True)
    return [(NAMED.findall(PAGE[: asked.start()])[-1], asked.group(1), shown.group(1)) for asked, shown in pairs]


def differences(shown: Any, found: Any, place: str = "") -> list[str]:
    """Where what is shown is not in what was found, to four digits."""
    if isinstance(shown, dict):
        return [line for key in shown for line in differences(shown[key], found.get(key), f"{place}.{key}")]
    if isinstance(shown, list):
        return [line for k, entry in enumerate(shown) for line in differences(entry, found[k], f"{place}[{k}]")]
    if isinstance(shown, float):
        return [] if found == pytest.approx(shown, rel=2e-4, abs=1e-12) else [f"{place}: {shown} is shown and {found} found"]
    return [] if shown == found else [f"{place}: {shown!r} is shown and {found!r} found"]


@pytest.mark.parametrize(("name", "asked", "shown"), examples(), ids=lambda text: text if len(text) < 20 else "")
def test_an_example_is_answered_as_the_page_shows(name: str, asked: str, shown: str) -> None:
    found = answer(name, asked.encode())
    assert differences(json.loads(shown), json.loads(found.body)) == []
    assert (found.status == 422) == ('"exit_status"' in shown)


def test_every_question_has_an_example_or_is_named() -> None:
    asked = {name for name, *_ in examples()}
    assert {*OWN, *ASKED} - asked == {"parameters", "study-file", "engine-file"}
    for name in (*OWN, *ASKED):
        assert f"/api/v1/{name}" in PAGE


def test_a_planted_difference_is_found() -> None:
    assert differences({"a": [1.0, {"b": "x"}]}, {"a": [1.001, {"b": "y"}], "c": 1}) == [
        ".a[0]: 1.0 is shown and 1.001 found",
        ".a[1].b: 'x' is shown and 'y' found",
    ]
