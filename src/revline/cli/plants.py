"""The plant of a loop on the command line: a file, or an engine at a trim, linearised with its delays exact."""

from typing import TYPE_CHECKING, NamedTuple

from revline.cli.options import DEFAULT_ENGINE
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.analysis.trim import Trim
    from revline.lti.state_space import DelayStateSpace
    from revline.system import DelaySystem


class EngineChoice(NamedTuple):
    """What --engine, --throttle and --load say; without a throttle angle no engine is asked for."""

    engine: str
    throttle: float | None
    load: float

    @property
    def place(self) -> str:
        """Where the engine is, in words."""
        return f"{self.throttle:g} deg, {self.load:g} N m"


def refuse_engine(choice: EngineChoice, why: str = "a file of the plant has its own operating point") -> None:
    """Refuse options of an engine beside files that need none, lest they be ignored.

    Args:
        choice: what was given.
        why: they are not needed.

    Raises:
        InvalidInputError: one is given.
    """
    if choice != EngineChoice(DEFAULT_ENGINE, None, 0.0):
        message = f"--engine, --throttle and --load place an engine's trim; {why}, leave them out"
        raise InvalidInputError(message)


def find_engine_trim(choice: EngineChoice, wanting: str) -> "tuple[DelaySystem, Trim]":
    """Load the engine and find its trim.

    Args:
        choice: which engine, and where.
        wanting: message where no throttle angle is given.

    Raises:
        InvalidInputError: there is no throttle angle, or the engine cannot be loaded.
        NoTrimError: the engine has no trim there.
    """
    if choice.throttle is None:
        raise InvalidInputError(wanting)
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine

    system = load_engine(choice.engine)
    return system, find_trim(system, inputs={"throttle": choice.throttle, "load_torque": choice.load})


def linearise_engine(choice: EngineChoice, wanting: str) -> "tuple[str, DelayStateSpace]":
    """Give the engine's exact linear model and its name for people; raises as `find_engine_trim`."""
    from revline.analysis.linearize import linearize

    system, trim = find_engine_trim(choice, wanting)
    return f"{system.name} at {choice.place}", linearize(system, trim).model
