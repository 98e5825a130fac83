"""A user's own file of one of three kinds, from its bytes to a record."""

import re
from collections.abc import Mapping
from typing import Any, Final

from revline.errors import InvalidInputError, suggestion
from revline.web.files.engine_file import read_engine_file
from revline.web.files.log_file import read_log_file
from revline.web.files.response_file import read_response_file
from revline.web.state import State

KINDS: Final = ("response", "log", "engine")
LARGEST: Final = 5_000_000
"""Bytes of a file at most."""

NAME: Final = re.compile(r"[\w][\w .()+-]{0,79}")
"""Names that messages repeat; a file of another is called after its kind."""


def read_own_file(kind: str, name: str, state: State, content: bytes) -> Mapping[str, Any]:
    """Check, show, fit and compare a file.

    Args:
        kind: one of `KINDS`.
        name: as the user calls it; it is only repeated, never opened.
        state: what it is compared with.
        content: UTF-8, with or without byte order mark.

    Raises:
        InvalidInputError: there is no such kind, or the file is too large, no text, or none of its kind.
        AnalysisError: the engine of the state cannot be compared with.
    """
    if kind not in KINDS:
        message = f"there is no kind of file {kind!r}{suggestion(kind, KINDS)}; there are {', '.join(KINDS)}"
        raise InvalidInputError(message)
    shown = name if NAME.fullmatch(name) else f"{kind} file"
    if len(content) > LARGEST:
        message = f"{shown} has {len(content)} bytes; give {LARGEST} at most"
        raise InvalidInputError(message, bytes=float(len(content)))
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"{shown} is no text in UTF-8 (byte {error.start}); save it in UTF-8"
        raise InvalidInputError(message, byte=float(error.start)) from error
    if kind == "engine":
        return read_engine_file(text, shown)
    return (read_log_file if kind == "log" else read_response_file)(text, shown, state)
