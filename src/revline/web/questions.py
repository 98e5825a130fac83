"""What a program can ask over HTTP: the options of the command line, units in the keys, one model for each question.

Engines are named, with what is changed about them; controllers, models and responses come in the request as their files' content.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from revline.web.state import as_input_error, quantity

MOST_FREQUENCIES: Final = 200
"""So many frequencies at most has a response that is asked for."""

MOST_ANGLES: Final = 2001
"""So many angles at most has a map that is asked for."""

LONGEST: Final = 300.0
"""Longest time in s that a loop is run for."""

MOST_CHARACTERS: Final = 5_000_000
"""Length of a file's text at most."""

Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Content = Annotated[dict[str, Any], Field(max_length=64)]


class Question(BaseModel):
    """What all questions have in common: unknown keys, texts for numbers, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class OnEngine(Question):
    """A question about an engine."""

    engine: Annotated[str, Field(description="built-in engine", max_length=64)] = "lee1995"
    parameters: Annotated[Mapping[str, float], Field(description="parameters that differ, by section.name", max_length=64)] = {}
    load_n_m: Annotated[float, quantity(-1e4, 1e4, "N m", "load torque")] = 0.0


class AtTrim(OnEngine):
    """A question about an engine at a throttle angle."""

    throttle_deg: Annotated[float, quantity(0.0, 90.0, "deg", "throttle angle of the operating point")]


class AnyPlant(OnEngine):
    """A question about a model, or about an engine at a throttle angle."""

    throttle_deg: Annotated[float | None, quantity(0.0, 90.0, "deg", "throttle angle of the engine's trim")] = None
    model: Annotated[Content | None, Field(description="content of a model file, in place of the engine")] = None


class TrimQuestion(OnEngine):
    """Options of `revline trim`."""

    throttle_deg: Annotated[float | None, quantity(0.0, 90.0, "deg", "throttle angle")] = None
    speed_rad_s: Annotated[float | None, Field(description="engine speed, in place of the throttle angle [rad/s]")] = None


class MapQuestion(OnEngine):
    """Options of `revline map`."""

    from_deg: Annotated[float, quantity(0.0, 90.0, "deg", "lowest throttle angle")] = 0.0
    to_deg: Annotated[float, quantity(0.0, 90.0, "deg", "highest throttle angle")] = 90.0
    points: Annotated[int, Field(ge=2, le=MOST_ANGLES, description="how many angles")] = 91
    line_deg: Annotated[list[Number] | None, Field(min_length=2, max_length=2, description="ends of a range for a straight line")] = None
    linear_within: Annotated[str | None, Field(max_length=32, description='widest range linear within so much: "1%" or "3" rad/s')] = None
    around_deg: Annotated[float, quantity(0.0, 90.0, "deg", "centre of that range")] = 25.0


class LinearizeQuestion(AtTrim):
    """Options of `revline linearize`."""

    roots: Annotated[int | None, Field(ge=1, le=200, description="list so many right-most roots")] = None
    roots_right_of_rad_s: Annotated[Number | None, Field(description="list all roots right of this")] = None


class ResponseQuestion(AtTrim):
    """Options of `revline response`."""

    amplitude_deg: Annotated[float, quantity(1e-9, 90.0, "deg", "amplitude of the throttle's sinusoid")] = 5.0
    frequencies_rad_s: Annotated[list[Number], Field(min_length=1, max_length=MOST_FREQUENCIES, description="rising")]
    method: Literal["peaks", "fourier", "harmonic-balance", "exact"] = "peaks"
    check: Literal["full", "quick", "none"] | None = None
    time_step_s: Annotated[float, quantity(1e-5, 0.1, "s", "longest step of the simulations")] = 1e-3
    distortion_limit: Number = 0.05


class FitQuestion(Question):
    """Options of `revline fit`, and a frequency response: the text of a CSV file, or the rows that the response's record lists."""

    csv: Annotated[str | None, Field(max_length=MOST_CHARACTERS, description="text of a CSV file")] = None
    frequency_response: Annotated[list[dict[str, Any]] | None, Field(max_length=20_000, description="rows, keys as the columns of CSV")] = (
        None
    )
    data_name: Annotated[str, Field(pattern=r"^[\w][\w .-]{0,63}$", description="what messages call the response")] = "response.csv"
    zeros: Annotated[int, Field(ge=0, le=12)]
    poles: Annotated[int, Field(ge=0, le=12)]
    delay: Literal["none", "phase-line", "free", "fixed"] = "none"
    delay_s: Number | None = None
    weight: Literal["none", "relative"] = "none"
    columns: Annotated[dict[str, str] | None, Field(max_length=16)] = None
    amplitude_deg: Number | None = None
    name: Annotated[str | None, Field(max_length=64)] = None


class TuneQuestion(AnyPlant):
    """Options of `revline tune`."""

    rule: Annotated[str | None, Field(max_length=64)] = None
    compare: bool = False
    natural_frequency_rad_s: Number | None = None
    damping: Number | None = None
    closed_loop_lag_s: Number | None = None
    reading: Literal["tangent", "63"] | None = None
    ultimate_gain: Number | None = None
    ultimate_period_s: Number | None = None
    start: Annotated[Content | None, Field(description="controller that fine tuning begins from")] = None
    free: Annotated[str | None, Field(max_length=32)] = None
    overshoot_limit: Number | None = None
    objective: Literal["setpoint-error", "load-error"] | None = None
    horizon_s: Number | None = None


class MarginsQuestion(AnyPlant):
    """Options of `revline margins`."""

    controller: Annotated[Content, Field(description="content of a controller file")]
    csv: Annotated[str | None, Field(max_length=MOST_CHARACTERS, description="a frequency response in place of engine and model")] = None
    data_name: Annotated[str, Field(pattern=r"^[\w][\w .-]{0,63}$", description="what messages call the response")] = "response.csv"
    unstable_poles: Annotated[int | None, Field(ge=0, le=1000)] = None
    delay_s: Number | None = None
    columns: Annotated[dict[str, str] | None, Field(max_length=16)] = None
    amplitude_deg: Number | None = None


class MarkedController(Question):
    """A controller to be placed among the gains."""

    name: Annotated[str, Field(max_length=64)]
    controller: Content


class RegionQuestion(AnyPlant):
    """Options of `revline region`, but for the long one on the nonlinear engine."""

    kd: Annotated[list[Number] | None, Field(min_length=1, max_length=8)] = None
    kp_max: Number | None = None
    ki_max: Number | None = None
    ms: Annotated[list[Number], Field(max_length=8)] = []
    damping: Number | None = None
    damping_up_to_rad_s: Number | None = None
    mark: Annotated[list[MarkedController], Field(max_length=16)] = []
    largest_kd: bool = False


class LoopQuestion(AnyPlant):
    """Options of `revline loop`; with `series` also all samples."""

    controller: Annotated[Content, Field(description="content of a controller file, or of a gain map with a schedule")]
    step_rad_s: Number = 60.0
    until_s: Annotated[float, quantity(0.0, LONGEST, "s", "stop time")] = 20.0
    time_step_s: Annotated[float, quantity(1e-5, 1.0, "s", "step of the simulation")] = 1e-3
    low_deg: Number | None = None
    high_deg: Number | None = None
    load_step_n_m: Number | None = None
    load_at_s: Number | None = None
    period_s: Number | None = None
    crank_angle_rad: Number | None = None
    computation_delay_s: Number = 0.0
    noise_rad_s: Number = 0.0
    jitter_s: Number = 0.0
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    series: bool = False


class LimitCycleQuestion(AtTrim):
    """Options of `revline limit-cycle`."""

    controller: Annotated[Content, Field(description="content of a controller file")]
    command_rad_s: Number = 60.0
    until_s: Annotated[float, quantity(0.0, LONGEST, "s", "stop time of the simulation")] = 20.0
    onset: bool = False


T = TypeVar("T", bound=Question)


def parse_question(kind: type[T], entries: Mapping[str, Any]) -> T:
    """Check what a program sent.

    Args:
        kind: of question.
        entries: keys and values, as JSON has them.

    Raises:
        InvalidInputError: a key is missing or unknown, or a value is of a wrong kind or out of range; `details` has it as `control`.
    """
    try:
        return kind.model_validate(dict(entries))
    except ValidationError as error:
        raise as_input_error(error.errors(include_url=False)[0], tuple(kind.model_fields)) from error
