"""Questions answered in a worker's process: bytes in, bytes out, so that nothing is decoded twice."""

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from revline.errors import InvalidInputError, RevlineError
from revline.io.engine_files import format_engine
from revline.io.json_files import format_compact_json
from revline.web.asked.registry import find_record
from revline.web.parameters import changed_engine, list_parameters
from revline.web.problems import CONTENT_TYPE, problem_of
from revline.web.state import parse_state
from revline.web.study_file import format_study
from revline.web.view.build import check_parts, find_promises, make_view

LIVE: Final = ("point", "response", "models", "roots", "gains", "margins", "loop_roots", "promises", "loop", "answers", "words")
"""Parts that follow each move on a page."""


class Answer(NamedTuple):
    """What goes back to whoever asked: HTTP status, kind of content, and content."""

    status: int
    kind: str
    body: bytes


def answer_view(entries: Mapping[str, Any]) -> Answer:
    """Answer with parts of a view."""
    state = parse_state(entries.get("state", {}))
    parts = entries.get("parts", LIVE)
    return _as_json(make_view(state, list(parts)))


def answer_study_file(entries: Mapping[str, Any]) -> Answer:
    """Answer with the study file of a state."""
    return Answer(HTTPStatus.OK, "application/toml", format_study(parse_state(entries.get("state", {}))).encode())


def answer_engine_file(entries: Mapping[str, Any]) -> Answer:
    """Answer with the engine file of a state."""
    state = parse_state(entries.get("state", {}))
    return Answer(HTTPStatus.OK, "application/toml", format_engine(changed_engine(state.engine, state.changed)).encode())


def answer_parameters(entries: Mapping[str, Any]) -> Answer:
    """Answer with an engine's parameters."""
    return _as_json(list_parameters(str(entries.get("engine", "lee1995"))))


def answer_asked(name: str, entries: Mapping[str, Any]) -> Answer:
    """Answer a question of the command line's."""
    return _as_json(find_record(name, entries))


OWN: Final[Mapping[str, Callable[[Mapping[str, Any]], Answer]]] = MappingProxyType(
    {
        "view": answer_view,
        "study-file": answer_study_file,
        "engine-file": answer_engine_file,
        "parameters": answer_parameters,
    }
)
"""What can be asked beside the command line's questions, `ASKED`."""


def answer(name: str, body: bytes) -> Answer:
    """Answer a question; what the user can mend comes back as a problem, not as an error.

    Args:
        name: one of `OWN` or of `ASKED`.
        body: JSON.
    """
    try:
        entries = _parse(body)
        return OWN[name](entries) if name in OWN else answer_asked(name, entries)
    except RevlineError as error:
        return _as_problem(error)


def answer_file(kind: str, name: str, entries: Mapping[str, Any], content: bytes) -> Answer:
    """Answer what a user's own file says; what is wrong with it comes back as a problem.

    Args:
        kind: "response", "log" or "engine".
        name: of the file, for messages.
        entries: the state that it is compared with.
        content: of the file.
    """
    from revline.web.files.own_files import read_own_file  # noqa: PLC0415 - 0.4 s of libraries that no view waits for

    try:
        return _as_json(read_own_file(kind, name, parse_state(entries), content))
    except RevlineError as error:
        return _as_problem(error)


def answer_parts(entries: Mapping[str, Any], names: Sequence[str], seconds: float = math.inf) -> Mapping[str, bytes]:
    """Find parts of a view, each as JSON; where little time is given, only the first ones.

    Args:
        entries: the state, which was checked before.
        names: of the parts.
        seconds: after half of which no further part is begun; the first one always is.

    Raises:
        InvalidInputError: there is no part of a name.
    """
    began = time.perf_counter()
    check_parts(names)
    state = parse_state(entries)
    found: dict[str, bytes] = {}
    for name in names:
        if found and time.perf_counter() - began > seconds / 2.0:
            break
        found[name] = format_compact_json(make_view(state, [name])["parts"][name]).encode()
    return found


def answer_promises(entries: Mapping[str, Any], models: bytes) -> Mapping[str, bytes]:
    """Find the part `promises`, as JSON, from the part `models` that another process found.

    Args:
        entries: the state, which was checked before.
        models: the part, as JSON, found for this state.
    """
    found = find_promises(parse_state(entries), json.loads(models))
    return {"promises": format_compact_json(found).encode()}


def warm_up() -> None:
    """Find the view that a page begins with, so that all is compiled and imported."""
    make_view(parse_state({}), LIVE)


def _parse(body: bytes) -> Mapping[str, Any]:
    try:
        found = json.loads(body, parse_constant=_refuse)
    except (ValueError, UnicodeDecodeError, RecursionError) as error:
        message = f"the request is no JSON: {error}"
        raise InvalidInputError(message) from error
    if not isinstance(found, dict):
        message = f"the request is a JSON {type(found).__name__}; send an object"
        raise InvalidInputError(message)
    return found


def _refuse(name: str) -> float:
    message = f"{name} is no JSON number; send finite numbers"
    raise ValueError(message)


def _as_problem(error: RevlineError) -> Answer:
    control = error.details.get("control")
    problem = problem_of(error, control=control if isinstance(control, str) else "")
    return Answer(problem["status"], CONTENT_TYPE, format_compact_json(problem).encode())


def _as_json(record: Mapping[str, Any]) -> Answer:
    return Answer(HTTPStatus.OK, "application/json", format_compact_json(record).encode())
