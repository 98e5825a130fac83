"""Results of a study's steps, as frozen values."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from revline.analysis.operating_range import LineFit, OperatingRange
from revline.analysis.steady_map import SteadyMap
from revline.analysis.trim import Trim
from revline.design.controllers.controller import PidGains
from revline.design.fitting.model_choice import NamedFit, Verdict
from revline.design.loops.closed_loop import LoopRun
from revline.design.tuning.fine_tuning import FineTuning
from revline.design.tuning.step_tangent import StepTangent
from revline.errors import RevlineError
from revline.lti.response import FrequencyResponse
from revline.values import make_read_only

Floats = NDArray[np.float64]
T = TypeVar("T")


def title(name: str) -> str:
    """Name of a model or controller as people write it: G2d for g2d."""
    return name[:1].upper() + name[1:]


class NotFound(NamedTuple):
    """A part of a step that has no result, and why."""

    what: str
    reason: str


def attempt(what: str, make: Callable[[], T]) -> tuple[tuple[T, ...], tuple[NotFound, ...]]:
    """Make a part of a step: what there is, or why there is nothing. An interruption goes on upwards.

    Args:
        what: the part, in words.
        make: makes it.
    """
    try:
        return (make(),), ()
    except RevlineError as error:
        return (), (NotFound(what, str(error)),)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointResult:
    """The operating point and its small-signal behaviour.

    Attributes:
        trim: the steady state.
        gain: static gain from throttle to speed, in rad/s per deg.
        exact: small-signal response with exact delay at the study's frequencies.
    """

    trim: Trim
    gain: float
    exact: FrequencyResponse


@dataclass(frozen=True, slots=True, kw_only=True)
class NoRange:
    """No range about the operating point is linear within a tolerance, and why."""

    tolerance: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangeResult:
    """Steady map, the line over the range studied, and the widest range for a stated tolerance, where there is one."""

    steady_map: SteadyMap
    line: LineFit
    widest: OperatingRange | NoRange


class TimeRecord(NamedTuple):
    """A throttle experiment: times in s, throttle in deg, pressure in kPa, speed in rad/s."""

    times: Floats
    throttle: Floats
    pressure: Floats
    speed: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepsResult:
    """Answers to throttle steps, with the speed free and with it held."""

    sizes: tuple[float, ...]
    start: float
    free: tuple[TimeRecord, ...]
    held: tuple[TimeRecord, ...]
    held_speed: float


class SineRecord(NamedTuple):
    """Two settled periods of a sinusoid: frequency in rad/s, times in s, throttle in deg, speed less its initial value in rad/s."""

    frequency: float
    times: Floats
    throttle: Floats
    speed: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelsResult:
    """Six models fitted to one response, each with its verdict; `chosen` is the one to design on, empty where all are rejected."""

    response: FrequencyResponse
    fits: tuple[NamedFit, ...]
    verdicts: tuple[Verdict, ...]
    chosen: str

    def fit(self, name: str) -> NamedFit:
        """The fit of one structure, by its name."""
        return next(named for named in self.fits if named.name == name)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControllersResult:
    """Controllers by name, the tangents behind the Ziegler-Nichols rules, and the fine tunings."""

    gains: Mapping[str, PidGains]
    tangents: Mapping[str, StepTangent]
    tunings: Mapping[str, FineTuning]


class LoopRow(NamedTuple):
    """One closed loop of the study; bandwidth in rad/s, 0 where none was computed."""

    controller: str
    plant: str
    run: LoopRun
    bandwidth: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopsResult:
    """All closed loops."""

    command: float
    rows: tuple[LoopRow, ...]

    def row(self, controller: str, plant: str) -> LoopRow:
        """The closed loop of a controller and a plant."""
        return next(row for row in self.rows if (row.controller, row.plant) == (controller, plant))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorRecord:
    """Speed of the engine and of the linear models after one throttle input, each as a deviation from the trim.

    Attributes:
        kind: "step" or "sine".
        frequency: of the sinusoid in rad/s; 0 for a step.
        start: when the input begins, in s.
        times: shape (n,), in s.
        speed: of the engine, shape (n,), in rad/s.
        models: names.
        answers: of the models, shape (n_models, n).
        judged_from: errors count from this time on, in s.
    """

    kind: str
    frequency: float
    start: float
    times: Floats
    speed: Floats
    models: tuple[str, ...]
    answers: Floats
    judged_from: float

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def errors(self) -> Floats:
        """Model less engine, shape (n_models, n)."""
        difference: Floats = self.answers - self.speed
        return difference

    def largest(self, model: str) -> float:
        """Largest error of a model without sign."""
        return float(np.max(np.abs(self._judged(model))))

    def rms(self, model: str) -> float:
        """Root mean square error of a model."""
        return float(np.sqrt(np.mean(self._judged(model) ** 2)))

    def swing(self, model: str) -> float:
        """Half of the error's range, its mean left out: what an error of amplitude and phase amounts to."""
        judged = self._judged(model)
        return 0.5 * float(np.max(judged) - np.min(judged))

    def _judged(self, model: str) -> Floats:
        return self.errors[self.models.index(model)][self.times >= self.judged_from]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorsResult:
    """Time-domain errors of the linear models, and where G2 and G2d are equally good."""

    records: tuple[ErrorRecord, ...]
    equal_frequency: float
