"""Every error that revline raises on purpose, on one page.

Each message names the quantity, its value with unit, the limit, and what to do; the numbers stand in `details` too.
Two families decide the exit status of the command line: wrong input (2) and an analysis that could not be completed (1);
a step that turns out too long during a run is wrong input too.
"""

import difflib
from collections.abc import Iterable
from types import MappingProxyType
from typing import ClassVar

Detail = float | str


class RevlineError(Exception):
    """Base of all errors raised on purpose.

    Args:
        message: what happened, where, and how to mend it.
        details: the numbers of the message, by name.
    """

    exit_status: ClassVar[int] = 1

    def __init__(self, message: str, **details: Detail) -> None:
        super().__init__(message)
        self.details = MappingProxyType(details)


class InvalidInputError(RevlineError, ValueError):
    """What was given cannot be worked with: a value, a file, a combination of options."""

    exit_status: ClassVar[int] = 2


class AnalysisError(RevlineError):
    """The input is sound, but the analysis could not be completed."""


class NoTrimError(AnalysisError):
    """No steady operating point was found; the message says how close the search came."""


class SimulationError(AnalysisError):
    """A simulation ended before its time; `details` has time, state and lag."""


class StalledError(SimulationError):
    """A state left the range in which the model means anything: an engine's speed fell to zero."""


class LagError(SimulationError):
    """A lag fell to the step or below, is not finite, or the delayed time ran backwards."""


class StepError(LagError):
    """The step given is longer than a lag that the run comes to: wrong input, found only under way."""

    exit_status: ClassVar[int] = 2


class DivergedError(SimulationError):
    """A state grew beyond all bounds or stopped being a number."""


class StoppedError(SimulationError):
    """A simulation was stopped from outside; `run` is the trajectory until then, from which it can go on."""

    def __init__(self, message: str, *, run: object, **details: Detail) -> None:
        super().__init__(message, **details)
        self.run = run


class NotSettledError(AnalysisError):
    """A periodic or a steady response was not reached within the allowed time."""


class NotConvergedError(AnalysisError):
    """An iteration stopped short of its tolerance."""


class PartialResultError(AnalysisError):
    """An analysis of several parts was interrupted, or some failed; what is finished is kept and says that it is partial."""


def out_of_range(quantity: str, value: float, unit: str, limit: str, remedy: str) -> InvalidInputError:
    """Build the error for a value outside its range.

    Args:
        quantity: what is wrong, as the user knows it.
        value: the value given.
        unit: its unit symbol; "" or "1" for a plain number.
        limit: the range in words and numbers, for example "0 to 90 deg".
        remedy: what to do.
    """
    shown = f"{value:g}" if unit in {"", "1"} else f"{value:g} {unit}"
    return InvalidInputError(f"{quantity} = {shown} is outside {limit}; {remedy}", quantity=quantity, value=value, limit=limit)


def suggestion(name: str, known: Iterable[str]) -> str:
    """Word a suggestion for a message, such as ', did you mean lee1995?'; empty where no known name resembles the one given.

    Args:
        name: what was given.
        known: what there is.
    """
    found = difflib.get_close_matches(name.lower(), list(known), n=1)
    return f", did you mean {found[0]}?" if found else ""
