"""The sampled PID controller with scheduled gains: its equations for simulation and exported code.

The law is that of `revline.design.controllers.pid_update`; its gains are looked up at each sample, from the measurement and from
the second signal, which comes in as a command. The integral sums ki e, so that a change of ki makes no jump.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

from revline.design.controllers.controller import PidGains
from revline.design.controllers.gain_schedule import GainSchedule, ScheduleTables, gains_at
from revline.design.controllers.pid_controller import PidController
from revline.design.controllers.pid_update import PidCode, sampled_pid, start, trust, update
from revline.equations import equation
from revline.errors import InvalidInputError
from revline.sampled import SampledController
from revline.system import Variable

Vector = tuple[float, ...]

MEASUREMENT_BEFORE = 4
"""Place of the last good measurement among the states of the law."""


class ScheduledCode(NamedTuple):
    """Parameters: those of the law, whose own gains are not used, and the schedule."""

    law: PidCode
    tables: ScheduleTables


@equation
def with_gains(law: PidCode, gains: tuple[float, float, float]) -> PidCode:
    """The law's parameters with other gains."""
    return PidCode(
        gains[0],
        gains[1],
        gains[2],
        law.setpoint_weight,
        law.derivative_weight,
        law.filter_time,
        law.rest_output,
        law.rest_command,
        law.low,
        law.high,
        law.rate_limit,
        law.clamping,
        law.tracking_rate,
        law.dead_zone,
        law.measurement_quantised,
        law.measurement_step,
        law.output_quantised,
        law.output_step,
        law.hold_samples,
        law.safe_output,
        law.rounding,
    )


@equation
def scheduled_gains(p: ScheduledCode, measurement: float, second: float) -> tuple[float, float, float]:
    """Gains at a sample; a second signal that is no number counts as the table's last value."""
    return gains_at(p.tables, measurement, trust(second, p.tables.second[len(p.tables.second) - 1]))


@equation
def scheduled_update(p: ScheduledCode, xd: Vector, y: Vector, r: Vector, t: Vector) -> Vector:
    """One sample: that of the law with the gains at its measurement, which are recorded behind its outputs."""
    gains = scheduled_gains(p, trust(y[0], xd[MEASUREMENT_BEFORE]), r[1])
    return (*update(with_gains(p.law, gains), xd, y, (r[0],), t), gains[0], gains[1], gains[2])


@equation
def scheduled_start(p: ScheduledCode, y: Vector, r: Vector, u: Vector) -> Vector:
    """States from which the first output is the one given; see `revline.design.controllers.pid_update.start`."""
    return start(with_gains(p.law, scheduled_gains(p, trust(y[0], trust(r[0], p.law.rest_command)), r[1])), y, (r[0],), u)


def scheduled_pid(schedule: GainSchedule, controller: PidController, *, output: float, measurement: float) -> SampledController:
    """Build the sampled controller with scheduled gains about a point of rest.

    It measures the schedule's first signal, and reads the second as a command: in a simulation name the system's own input, such as
    "load_torque", in the wiring.

    Args:
        schedule: over the measurement and another signal.
        controller: with its limits and its sampling; its own gains are replaced, their units must be the schedule's.
        output: at rest.
        measurement: at rest.

    Raises:
        InvalidInputError: the units differ, or as for `sampled_pid`.
    """
    unit = controller.gains.gain_units["kp"]
    if unit != schedule.gain_unit or controller.gains.input_unit != schedule.units[0]:
        message = (
            f"the controller has gains in {unit} by {controller.gains.input_unit}, the schedule in {schedule.gain_unit} by "
            f"{schedule.units[0]}; it is scheduled by what it measures: convert one of them"
        )
        raise InvalidInputError(message)
    plain = sampled_pid(controller, output=output, measurement=measurement)
    units = (unit, f"{unit}/s", f"{unit} s")
    return SampledController(
        name="scheduled pid",
        parameters=ScheduledCode(law=plain.parameters, tables=schedule.tables),
        states=plain.states,
        measurements=plain.measurements,
        commands=(*plain.commands, Variable(name=schedule.names[1], unit=schedule.units[1], description="what else the gains depend on")),
        outputs=(
            *plain.outputs,
            *(Variable(name=f"{name}_used", unit=u, description="gain") for name, u in zip(("kp", "ki", "kd"), units, strict=True)),
        ),
        drives=plain.drives,
        update=scheduled_update,
        start=scheduled_start,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScheduledController:
    """A PID controller whose gains are looked up over its measurement and a second signal.

    Attributes:
        controller: with its limits and its sampling; its own gains count for their units alone.
        schedule: of the gains.
    """

    controller: PidController
    schedule: GainSchedule

    def scaled(self, factor: float) -> "ScheduledController":
        """Multiply all gains by a factor."""
        table = self.schedule
        return replace(self, schedule=replace(table, kp=factor * table.kp, ki=factor * table.ki, kd=factor * table.kd))

    def frozen_at(self, measurement: float, second: float) -> PidController:
        """The controller with the gains of one place."""
        kp, ki, kd = self.schedule.gains_at(measurement, second)
        own = self.controller.gains
        gains = PidGains(
            kp=kp, ki=ki, kd=kd, input_unit=own.input_unit, output_unit=own.output_unit, rule=own.rule, designed_on=own.designed_on
        )
        return replace(self.controller, gains=gains)


AnyController = PidController | ScheduledController
"""What a sampled loop may be closed with."""


def law_of(controller: AnyController) -> PidController:
    """Limits, sampling and units of a controller."""
    return controller.controller if isinstance(controller, ScheduledController) else controller


def scaled_controller(controller: AnyController, factor: float) -> AnyController:
    """Multiply all gains of a controller by a factor."""
    if isinstance(controller, ScheduledController):
        return controller.scaled(factor)
    return replace(controller, gains=controller.gains.scaled(kp=factor, ki=factor, kd=factor))
