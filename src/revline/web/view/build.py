"""A whole view: the parts asked for, each found apart, so that one that fails leaves the others whole."""

import time
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from types import MappingProxyType
from typing import Any, Final

from revline.errors import InvalidInputError, RevlineError, suggestion
from revline.io.json_files import JsonRecord
from revline.io.model_files import parse_model
from revline.web.plants import control_of
from revline.web.problems import make_problem, problem_of
from revline.web.state import State
from revline.web.view.gains import promises_of, view_contours, view_gains, view_loop_roots, view_margins, view_promises, view_roots
from revline.web.view.loops import view_answers, view_cycle, view_loop
from revline.web.view.responses import view_models, view_peaks, view_response
from revline.web.view.rest import view_map, view_point, view_validity
from revline.web.view.words import view_words

PARTS: Final[Mapping[str, Callable[[State], Mapping[str, Any]]]] = MappingProxyType(
    {
        "point": view_point,
        "response": view_response,
        "models": view_models,
        "roots": view_roots,
        "gains": view_gains,
        "margins": view_margins,
        "loop_roots": view_loop_roots,
        "promises": view_promises,
        "loop": view_loop,
        "answers": view_answers,
        "map": view_map,
        "validity": view_validity,
        "contours": view_contours,
        "peaks": view_peaks,
        "cycle": view_cycle,
    }
)
"""What a view is made of, the quick parts first; `words` is made of some of them."""

WORDS: Final = "words"
OF_WORDS: Final = ("point", "margins", "promises", "loop")

GROUPS: Final = (("response", "models", "roots", "promises", "answers"), ("point", "gains", "margins", "loop_roots", "loop"))
"""Live parts that share most of what they need, one group for each of two processes; `words` is made of both."""


def make_view(state: State, parts: Sequence[str]) -> Mapping[str, Any]:
    """Find parts of a view.

    Args:
        state: what is shown.
        parts: their names.

    Returns:
        Each part by name, or `{"problem": ...}` in its place, and how long all took.

    Raises:
        InvalidInputError: there is no part of a name.
    """
    began = time.perf_counter()
    check_parts(parts)
    wanted = dict.fromkeys(name for name in parts if name != WORDS)
    found = {name: find_part(name, state) for name in wanted}
    if WORDS in parts:
        found[WORDS] = view_words(*(found[name] if name in found else find_part(name, state) for name in OF_WORDS))
    return {"parts": found, "seconds": time.perf_counter() - began}


def check_parts(parts: Sequence[str]) -> None:
    """Refuse a part that there is not.

    Raises:
        InvalidInputError: there is no part of a name.
    """
    for name in parts:
        if name not in PARTS and name != WORDS:
            known = (*PARTS, WORDS)
            message = f"a view has no part {name!r}{suggestion(name, known)}; it has {', '.join(known)}"
            raise InvalidInputError(message, control="parts")


def find_part(name: str, state: State) -> Mapping[str, Any]:
    """Find one part, or the problem in its place."""
    return _find(name, state, lambda: PARTS[name](state))


def find_promises(state: State, models: Mapping[str, Any]) -> Mapping[str, Any]:
    """Find the part `promises`, or the problem in its place, from the part `models`, whose fits are then not made again.

    Args:
        state: whose models they are.
        models: the part, as it was found for this state.
    """
    files = {name: parse_model(JsonRecord(where=f"model {name}", entries=record), name=name) for name, record in models.items()}
    return _find("promises", state, lambda: promises_of(state, {name: file.model for name, file in files.items()}))


def _find(name: str, state: State, found: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any]:
    try:
        return found()
    except RevlineError as error:
        return {"problem": problem_of(error, control=control_of(error, state))}
    except MemoryError:
        detail = f"the part {name} needs more memory than a process may have; ask for less, or run it on the command line"
        status = HTTPStatus.SERVICE_UNAVAILABLE
        return {"problem": make_problem("out-of-memory", "the answer needs too much memory", detail, status=status)}
