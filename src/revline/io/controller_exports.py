"""A controller in other programs' forms: C99, MATLAB, python-control, and JSON with everything in it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from revline.design.controllers.pid_controller import PidController
from revline.design.controllers.pid_update import ROUNDING_DOUBLE, ROUNDING_SINGLE, parameter_units, sampled_pid
from revline.design.controllers.scheduled_pid import AnyController, ScheduledController, law_of, scheduled_pid
from revline.errors import InvalidInputError, out_of_range
from revline.io.c_controller import COMPILE, Precision, write_c_controller
from revline.io.controller_files import controller_record
from revline.io.controller_surroundings import law_words
from revline.io.json_files import format_json
from revline.io.matlab_controller import write_matlab_controller
from revline.io.recorded_operations import flat_parameters
from revline.io.schedule_files import scheduled_record
from revline.sampled import FixedRate, SampledController, Sampling
from revline.units import RPM


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """What is exported, and how.

    Attributes:
        controller: sampled.
        name: begins the names of files and functions.
        rest: output and measurement at rest.
        precision: of the C code.
        full_range: lowest and highest output that stand for 0 and 100 per cent.
        provenance: what writes it, from what.
    """

    controller: AnyController
    name: str
    rest: tuple[float, float]
    precision: Precision
    full_range: tuple[float, float]
    provenance: Mapping[str, float | str]

    @property
    def law(self) -> PidController:
        """Limits, sampling and units."""
        return law_of(self.controller)

    def code(self, rounding: float = ROUNDING_DOUBLE) -> SampledController:
        """The sampled form.

        Args:
            rounding: of the arithmetic that will run it; see `sampled_pid`.

        Raises:
            InvalidInputError: see `sampled_pid` and `scheduled_pid`.
        """
        output, measurement = self.rest
        if not isinstance(self.controller, ScheduledController):
            return sampled_pid(self.controller, output=output, measurement=measurement, rounding=rounding)
        made = scheduled_pid(self.controller.schedule, self.law, output=output, measurement=measurement)
        return replace(made, parameters=made.parameters._replace(law=made.parameters.law._replace(rounding=rounding)))

    @property
    def units(self) -> Mapping[str, str]:
        """Units of the parameters."""
        plain = {name: " ".join(unit.split()) for name, unit in parameter_units(self.law.gains).items()}
        return {**plain, **{f"law_{name}": unit for name, unit in plain.items()}}

    @property
    def sampling(self) -> Sampling:
        """When the controller runs.

        Raises:
            InvalidInputError: it is continuous.
        """
        found = self.law.sampling
        if not hasattr(found, "computation_delay"):
            message = "a continuous controller has no code; say when it samples"
            raise InvalidInputError(message)
        return found  # type: ignore[return-value] # both that have a computation delay


def export_c(export: Export) -> str:
    """Write NAME.c."""
    rounding = ROUNDING_DOUBLE if export.precision is Precision.DOUBLE else ROUNDING_SINGLE
    return write_c_controller(export.code(rounding), name=export.name, precision=export.precision, about=_about(export), units=export.units)


def export_matlab(export: Export) -> str:
    """Write NAME.m."""
    return write_matlab_controller(export.code(), name=export.name, about=_about(export), units=export.units)


def export_control(export: Export) -> str:
    """Write NAME_control.py: the linear law as objects of python-control, continuous and sampled."""
    if isinstance(export.controller, ScheduledController):
        message = "a scheduled controller has no one linear law for python-control; export c, matlab or json"
        raise InvalidInputError(message)
    controller, gains = export.controller, export.controller.gains
    period = export.sampling.period_at(export.rest[1]) if not isinstance(export.sampling, FixedRate) else export.sampling.period
    units = ", ".join(export.units[name] for name in ("kp", "ki", "kd"))
    about = "\n".join(f"# {key}: {' '.join(value.split())}" for key, value in _about(export).items())
    return f'''"""{export.name}: the linear law of a controller for python-control; limits, anti-windup and quantisation are not in it."""

{about}
# The measurement path is subtracted: u = from_command * r - from_measurement * y. Its derivative has no filter where filter_time is 0:
# then the continuous law is improper, which python-control allows as a transfer function alone.

import control

kp, ki, kd = {gains.kp!r}, {gains.ki!r}, {gains.kd!r}  # {units}
setpoint_weight, derivative_weight = {controller.setpoint_weight!r}, {controller.derivative_weight!r}
filter_time = {controller.filter_time!r}  # s
period = {period!r}  # s

s = control.tf([1.0, 0.0], [1.0])
derivative = control.tf([kd, 0.0], [filter_time, 1.0] if filter_time > 0.0 else [1.0])
integral = control.tf([ki], [1.0, 0.0])
from_command = kp * setpoint_weight + integral + derivative_weight * derivative
from_measurement = kp + integral + derivative

# As it is sampled: backward sum, filtered backward difference.
sampled_integral = control.tf([ki * period, 0.0], [1.0, -1.0], period)
sampled_derivative = control.tf([kd, -kd], [period + filter_time, -filter_time], period)
sampled_from_command = kp * setpoint_weight + sampled_integral + derivative_weight * sampled_derivative
sampled_from_measurement = kp + sampled_integral + sampled_derivative
'''


def export_json(export: Export) -> str:
    """Write NAME.json: the controller file, the parameters of its sampled form, and its gains in units of engine computers."""
    parameters = {key: value for key, value in flat_parameters(export.code().parameters) if math.isfinite(value)}
    rest = {"rest": {"output": export.rest[0], "measurement": export.rest[1]}, "sampled_parameters": parameters}
    if isinstance(export.controller, ScheduledController):
        return format_json({**scheduled_record(export.controller, provenance=export.provenance), **rest})
    record = controller_record(export.controller, provenance=export.provenance)
    return format_json({**record, **rest, "engine_computer_units": engine_computer_units(export)})


def engine_computer_units(export: Export) -> Mapping[str, float | str]:
    """Give the gains in per cent of the output's range, rpm and ms, as engine computers show them.

    Args:
        export: whose measurement is in rad/s.

    Raises:
        InvalidInputError: the measurement is no speed in rad/s, or the range is none.
    """
    gains, (low, high) = export.law.gains, export.full_range
    if gains.input_unit != "rad/s":
        message = f"gains per rpm need a speed in rad/s; this controller measures in {gains.input_unit}"
        raise InvalidInputError(message)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise out_of_range("range of the output", high - low, gains.output_unit, "the positive numbers", "give what 0 and 100 % stand for")
    per_cent_per_rpm = 100.0 / (high - low) * RPM
    period = export.sampling.period if isinstance(export.sampling, FixedRate) else None
    found: dict[str, float | str] = {
        "full_range": f"{low:g} to {high:g} {gains.output_unit} is 0 to 100 %",
        "kp_percent_per_rpm": gains.kp * per_cent_per_rpm,
        "ki_percent_per_rpm_s": gains.ki * per_cent_per_rpm,
        "kd_percent_s_per_rpm": gains.kd * per_cent_per_rpm,
        "filter_time_ms": 1e3 * export.law.filter_time,
    }
    if period is not None:
        found["period_ms"] = 1e3 * period
        found["ki_percent_per_rpm_and_sample"] = gains.ki * per_cent_per_rpm * period
        found["kd_percent_samples_per_rpm"] = gains.kd * per_cent_per_rpm / period
    return MappingProxyType(found)


FORMATS: Final[Mapping[str, tuple[Callable[[Export], str], str]]] = MappingProxyType(
    {
        "c": (export_c, "{name}.c"),
        "matlab": (export_matlab, "{name}.m"),
        "control": (export_control, "{name}_control.py"),
        "json": (export_json, "{name}.json"),
    }
)
"""What writes each format, and the name of its file."""


def _about(export: Export) -> Mapping[str, str]:
    gains, controller = export.law.gains, export.law
    about = {key: f"{value}" for key, value in export.provenance.items()}
    about |= {
        "law": law_words(controller),
        "rule": f"{gains.rule}, designed on {gains.designed_on}",
        "units": f"measurement and command in {gains.input_unit}, output in {gains.output_unit}, time in s",
        "sampling": _sampling_words(export.sampling),
        "rest": f"output {export.rest[0]!r} {gains.output_unit}, measurement {export.rest[1]!r} {gains.input_unit}",
        "anti-windup": controller.anti_windup.value,
        "lost sensor": f"the last good measurement is kept for {controller.hold_samples} samples, then the output is safe_output",
    }
    if isinstance(export.controller, ScheduledController):
        table = export.controller.schedule
        return {**about, "gains": f"scheduled over {table.names[0]} [{table.units[0]}] and {table.names[1]} [{table.units[1]}]"}
    try:
        numbers = engine_computer_units(export)
    except InvalidInputError:  # another measurement than a speed, or an output without a range: there are no such units
        return about
    return {**about, "in engine computers' units": ", ".join(f"{key} {_short(value)}" for key, value in numbers.items())}


def _sampling_words(sampling: Sampling) -> str:
    step = f"{sampling.period!r} s" if isinstance(sampling, FixedRate) else f"{sampling.angle!r} rad of the crank"
    return f"every {step}, the output {sampling.computation_delay!r} s later"


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


COMPILE_LINE: Final = COMPILE
"""How the C file is compiled."""
