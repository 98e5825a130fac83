"""Errors as problem details (RFC 9457), with the texts of the command line."""

import math
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from revline.errors import RevlineError

CONTENT_TYPE: Final = "application/problem+json"

TITLES: Final = ("the analysis could not be completed", "the input is wrong")


def problem_of(error: RevlineError, *, control: str = "", status: int = HTTPStatus.UNPROCESSABLE_ENTITY) -> Mapping[str, Any]:
    """Give an error as a problem.

    Args:
        error: what was raised.
        control: key of the state that caused it, where that is known.
        status: of the answer that it stands for.
    """
    wrong = error.exit_status == 2
    record = make_problem("invalid-input" if wrong else "analysis", TITLES[wrong], str(error), status=status)
    record["exit_status"] = error.exit_status
    if control:
        record["control"] = control
    numbers = {key: value for key, value in error.details.items() if key != "control" and _sendable(value)}
    return {**record, "details": numbers} if numbers else record


def make_problem(kind: str, title: str, detail: str, *, status: int) -> dict[str, Any]:
    """Make a problem.

    Args:
        kind: what kind, a word for programs.
        title: the same for people.
        detail: what happened and how to mend it.
        status: of the answer.
    """
    return {"type": f"/problems/{kind}", "title": title, "status": int(status), "detail": detail}


def _sendable(value: object) -> bool:
    return not isinstance(value, float) or math.isfinite(value)
