"""Controller values: the gains of a PID controller, with units and origin.

The law is u = u_trim + kp e + ki integral(e) dt - kd dy/dt with e = command - y: the derivative acts on the measurement only,
the integral starts at zero, and there is no derivative filter.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from types import MappingProxyType
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from revline.errors import InvalidInputError

Complexes = NDArray[np.complex128]

LAW: Final = "u = u_trim + kp e + ki integral(e) dt - kd dy/dt, e = command - y"
"""The control law that all gains of this project are meant for."""

_NO_DETAILS: Final[Mapping[str, float | str]] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PidGains:
    """Gains of a PID controller, and where they come from.

    Attributes:
        kp: proportional gain [output unit per input unit].
        ki: integral gain [output unit per input unit and s].
        kd: derivative gain [output unit s per input unit].
        input_unit: unit of the error and of the measurement, for example "rad/s".
        output_unit: unit of what the controller commands, for example "deg".
        rule: name of the rule that gave the gains.
        designed_on: name of the model that they were designed on.
        details: what else belongs to their origin: the rule's options and what it measured on the model.

    Raises:
        InvalidInputError: a gain is no finite number, or a text is empty.
    """

    derivative_acts_on: ClassVar[str] = "measurement"

    kp: float
    ki: float
    kd: float
    input_unit: str
    output_unit: str
    rule: str
    designed_on: str
    details: Mapping[str, float | str] = field(default_factory=lambda: _NO_DETAILS)

    def __post_init__(self) -> None:
        for name in ("input_unit", "output_unit", "rule", "designed_on"):
            if not getattr(self, name):
                message = f"the controller's {name} is empty; say what it is"
                raise InvalidInputError(message, field=name)
        for name, unit in self.gain_units.items():
            value = getattr(self, name)
            if not math.isfinite(value):
                message = f"{name} = {value} {unit} is not finite; give a finite gain, 0 for none"
                raise InvalidInputError(message, field=name)
            object.__setattr__(self, name, float(value))
        object.__setattr__(self, "details", MappingProxyType(dict(self.details)))

    def __reduce__(self) -> tuple[Callable[[], "PidGains"], tuple[()]]:
        """Give what makes the gains again in another process: a locked mapping cannot be sent."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return partial(PidGains, **values | {"details": dict(self.details)}), ()

    @property
    def gain_units(self) -> Mapping[str, str]:
        """Unit symbol of each gain."""
        unit = f"{self.output_unit}/({self.input_unit})"
        return MappingProxyType({"kp": unit, "ki": f"{unit}/s", "kd": f"{unit} s"})

    def setpoint_transfer(self, s: ArrayLike) -> Complexes:
        """Evaluate kp + ki/s, the controller from command to output, the derivative acting on the measurement only.

        Args:
            s: Laplace variable [rad/s], of any shape.

        Raises:
            InvalidInputError: an s is 0, where integral action is infinite.
        """
        points = np.asarray(s, dtype=np.complex128)
        if self.ki == 0.0:
            return np.full_like(points, self.kp)
        if np.any(points == 0.0):
            message = f"the controller has no value at s = 0 rad/s, where its integral action (ki = {self.ki:g}) is infinite; leave 0 out"
            raise InvalidInputError(message, ki=self.ki)
        return np.asarray(self.kp + self.ki / points)

    def feedback_transfer(self, s: ArrayLike) -> Complexes:
        """Evaluate kp + ki/s + kd s, the controller from measurement to output with its sign reversed.

        Args:
            s: Laplace variable [rad/s], of any shape.

        Raises:
            InvalidInputError: an s is 0, where integral action is infinite.
        """
        return np.asarray(self.setpoint_transfer(s) + self.kd * np.asarray(s, dtype=np.complex128))

    def scaled(self, *, kp: float = 1.0, ki: float = 1.0, kd: float = 1.0) -> "PidGains":
        """Multiply gains by factors, for example kp by 0.1 and leave the others; the rule's name and the details say so.

        Args:
            kp: factor of the proportional gain.
            ki: factor of the integral gain.
            kd: factor of the derivative gain.
        """
        factors = {name: factor for name, factor in (("kp", kp), ("ki", ki), ("kd", kd)) if factor != 1.0}
        if not factors:
            return self
        changes = ", ".join(f"{name} times {factor:g}" for name, factor in factors.items())
        return replace(
            self,
            kp=self.kp * kp,
            ki=self.ki * ki,
            kd=self.kd * kd,
            rule=f"{self.rule}, {changes}",
            details={**self.details, **{f"{name}_factor": factor for name, factor in factors.items()}},
        )
