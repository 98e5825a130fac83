"""What a page of the workbench shows: engine, operating point, excitation, controller and step, as one value that makes the view again."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from revline.engine.catalogue import engine_names
from revline.errors import InvalidInputError, suggestion

SCHEMA: Final = "revline.workbench/1"
START_DEG: Final = 25.0
"""Throttle angle in deg where a state names none. Source: Lee (1995), chapter 4."""


def quantity(low: float, high: float, unit: str, meaning: str) -> Any:
    """Describe a number of a state: its range, both ends included, its unit and what it is."""
    return Field(ge=low, le=high, description=f"{meaning} [{unit}]", json_schema_extra={"unit": unit})


class State(BaseModel):
    """All that can be set on a page; what is left out keeps its default."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, populate_by_name=True, serialize_by_alias=True)

    schema_name: Annotated[Literal["revline.workbench/1"], Field(alias="schema", description="format and version")] = SCHEMA
    engine: Annotated[str, Field(description="built-in engine", max_length=64)] = "lee1995"
    parameters: Annotated[Mapping[str, float], Field(description="parameters that differ, by section.name", max_length=64)] = {}
    throttle_deg: Annotated[float | None, quantity(0.0, 90.0, "deg", "throttle angle of the operating point; or the speed is given")] = None
    speed_rad_s: Annotated[float | None, quantity(1.0, 1500.0, "rad/s", "speed of the operating point, in place of the throttle angle")] = (
        None
    )
    load_n_m: Annotated[float, quantity(-200.0, 400.0, "N m", "load torque")] = 0.0
    amplitude_deg: Annotated[float, quantity(0.01, 45.0, "deg", "amplitude of the sinusoids on the throttle")] = 5.0
    kp: Annotated[float, quantity(-1e4, 1e4, "deg/(rad/s)", "proportional gain")] = 1.2
    ki: Annotated[float, quantity(-1e5, 1e5, "deg/(rad/s)/s", "integral gain")] = 2.0
    kd: Annotated[float, quantity(-1e3, 1e3, "deg s/(rad/s)", "derivative gain, on the measured speed")] = 0.1
    step: Annotated[Literal["command", "load", "throttle"], Field(description="what steps at time 0")] = "command"
    command_rad_s: Annotated[float, quantity(-1000.0, 1000.0, "rad/s", "step of the speed command")] = 40.0
    load_step_n_m: Annotated[float, quantity(-400.0, 400.0, "N m", "step of the load torque")] = 5.0
    throttle_step_deg: Annotated[float, quantity(-90.0, 90.0, "deg", "step of the throttle, without a controller")] = 5.0
    until_s: Annotated[float, quantity(0.1, 60.0, "s", "time that is shown")] = 4.0
    low_deg: Annotated[float | None, quantity(0.0, 90.0, "deg", "lower limit of the throttle; 0 if left out")] = None
    high_deg: Annotated[float | None, quantity(0.0, 90.0, "deg", "upper limit; where the throttle saturates if left out")] = None

    @model_validator(mode="after")
    def _one_point(self) -> "State":
        if self.throttle_deg is not None and self.speed_rad_s is not None:
            message = "throttle_deg and speed_rad_s are both given: one is known, the other is found; leave one out"
            raise ValueError(message)
        if not all(name.isprintable() for name in self.parameters):
            message = "parameters: a name holds what cannot be printed; the engine's parameters list them"
            raise ValueError(message)
        if self.engine not in engine_names():
            message = (
                f"engine: there is none named {self.engine!r}{suggestion(self.engine, engine_names())}; give {' or '.join(engine_names())}"
            )
            raise ValueError(message)
        return self

    @property
    def throttle(self) -> float | None:
        """Throttle angle asked for, in deg; none where the speed is."""
        return START_DEG if self.throttle_deg is None and self.speed_rad_s is None else self.throttle_deg

    @property
    def changed(self) -> tuple[tuple[str, float], ...]:
        """Parameters that differ, in a fixed order."""
        return tuple(sorted(self.parameters.items()))


def parse_state(entries: Mapping[str, Any]) -> State:
    """Check what a page or a program sent.

    Args:
        entries: keys and values, as JSON has them.

    Raises:
        InvalidInputError: a key is unknown, or a value is of a wrong kind or out of range; `details` has the key as `control`.
    """
    try:
        return State.model_validate(dict(entries))
    except ValidationError as error:
        raise as_input_error(error.errors(include_url=False)[0]) from error


def as_input_error(found: Mapping[str, Any], known: Sequence[str] = ()) -> InvalidInputError:
    """Word an error of pydantic's as the project words its own.

    Args:
        found: one entry of its list.
        known: keys that there are, for suggestions; those of a state by default.
    """
    control = ".".join(str(part) for part in found["loc"] if part not in {"float", "int", "nullable[float]"})
    limits = found.get("ctx", {})
    value = found.get("input")
    shown = f"{value:g}" if isinstance(value, float) else repr(value)  # an integer may be beyond all floating-point numbers
    if len(shown) > 60:
        shown = f"{shown[:60]}..."
    kind = found["type"]
    if kind in {"greater_than_equal", "less_than_equal"}:
        end = f"{limits['ge']:g} or more" if "ge" in limits else f"{limits['le']:g} or less"
        message = f"{control} = {shown} is outside its range; give {end}"
    elif kind == "extra_forbidden":
        message = f"there is no {control!r}{suggestion(control, known or _names())}; leave it out"
    elif kind == "missing":
        message = f"{control} is missing; give it"
    elif kind == "value_error":
        message = str(limits["error"])
    else:
        message = f"{control or 'the request'} = {shown}: {found['msg'][0].lower()}{found['msg'][1:]}"
    return InvalidInputError(message, **({"control": control} if control else {}))


def _names() -> tuple[str, ...]:
    return tuple(field.alias or name for name, field in State.model_fields.items())
