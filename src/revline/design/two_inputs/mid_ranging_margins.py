"""Margins of a mid-ranging controller: every loop broken where it can fail, both inputs at once, and the roots of the whole.

The roots are those of the nonlinear controller connected to the nonlinear system and linearised; the loops are products of transfer
functions. At a root, 1 plus the loop broken at the measurement is zero: how nearly is told, and ties both routes together.
"""

from dataclasses import dataclass

import numpy as np

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim
from revline.connection import connect
from revline.design.controllers.controller import PidGains
from revline.design.plants.loop_signals import LoopSignals
from revline.design.stability.margins import Margins, find_margins
from revline.design.stability.open_loop import OpenLoop, open_loop_of_system
from revline.design.two_inputs.mid_ranging import MidRangingDesign
from revline.design.two_inputs.one_input import TwoInputSignals
from revline.design.two_inputs.two_input_loops import LoopGains, TwoInputDisk, TwoInputPlant, broken_loops, find_two_input_disk, loops_of
from revline.design.two_inputs.two_output_system import OutputRange, TwoOutputGains, two_output_system
from revline.errors import NotConvergedError
from revline.lti.roots import RightmostRoots, characteristic_roots
from revline.system import DelaySystem, Floats, index_of

AGREEMENT = 1e-6
"""At a root of the connected system, 1 plus the loop may be this far from zero, relative to its terms."""

KEPT = 1e-3
"""A bound may be missed by this part: the gains lie on a contour that is known so well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RestingPoint:
    """A steady state of a closed loop: that of its plant, the controller's integral terms holding its outputs."""

    states: Floats
    inputs: Floats
    channels: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MidRangingMargins:
    """What a design keeps on one plant.

    Attributes:
        broken: where the loop is broken, and the margins there: "fast", "slow", "both", "fast at its limit", "slow alone", the competitor.
        disk: both inputs changed at once, independently.
        roots: right-most characteristic roots of the closed loop.
        disagreement: largest |1 + L| at the listed roots, relative to the loops' sizes.
        fast_crossover, slow_crossover: highest frequencies at which the fast loop alone and the slow loop around it have gain 1, in rad/s.
    """

    broken: tuple[tuple[str, Margins], ...]
    disk: TwoInputDisk
    roots: RightmostRoots
    disagreement: float
    fast_crossover: float
    slow_crossover: float

    @property
    def loops(self) -> dict[str, Margins]:
        """Margins by where the loop is broken."""
        return dict(self.broken)

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable, with both inputs and with the fast one at its limit."""
        return self.roots.stable and self.loops["fast at its limit"].stable


def law_of(gains: LoopGains, sign: float) -> TwoOutputGains:
    """The law of both outputs, the fast one's sign put in; at its limit it asks for the limit and kp e."""
    return TwoOutputGains(
        kp=sign * gains.kp,
        ki=sign * gains.ki,
        slow_kp=sign * gains.slow_kp,
        slow_ki=sign * gains.slow_ki,
        slow_kd=gains.slow_kd,
        share_of_error=0.0,
        fast_tracking=gains.ki / gains.kp,
        slow_tracking=gains.slow_ki / gains.slow_kp,
    )


def law_of_slow_alone(design: MidRangingDesign) -> TwoOutputGains:
    """The same law for the slow input alone."""
    alone = design.alone
    return TwoOutputGains(
        kp=0.0,
        ki=0.0,
        slow_kp=alone.kp,
        slow_ki=alone.ki,
        slow_kd=alone.kd,
        share_of_error=1.0,
        fast_tracking=0.0,
        slow_tracking=alone.ki / alone.kp,
    )


def close_both(system: DelaySystem, law: TwoOutputGains, *, fast: OutputRange, slow: OutputRange, signals: TwoInputSignals) -> DelaySystem:
    """Connect the controller to the system; the last input is the command.

    Raises:
        InvalidInputError: limits exclude the trim, or there are no such signals.
    """
    measured = system.outputs[index_of(system.outputs, signals.measurement)]
    units = tuple(system.inputs[index_of(system.inputs, name)].unit for name in (signals.fast, signals.slow))
    controller = two_output_system(law, fast=fast, slow=slow, measurement=measured, units=(units[0], units[1]))
    return connect(
        system,
        controller,
        to_first={signals.fast: "fast", signals.slow: "slow"},
        to_second={"measurement": signals.measurement, "measurement_rate": signals.measurement_rate},
        name=f"{system.name} under two inputs",
    )


def resting_point(loop: DelaySystem, trim: Trim, command: float) -> RestingPoint:
    """Where the loop rests: at the trim, commanded to stay."""
    known = {variable.name: trim.input(variable.name) for variable in trim.input_variables}
    inputs = np.array([known[v.name] for v in loop.inputs[:-1]] + [command])
    controller = loop.parameters.second
    states = np.append(trim.states, (controller.fast.rest, controller.slow.rest))
    return RestingPoint(states=states, inputs=inputs, channels=trim.channels)


def find_mid_ranging_margins(design: MidRangingDesign, system: DelaySystem, trim: Trim, *, name: str = "nominal") -> MidRangingMargins:
    """Find the margins of a design on its own plant or on another with the same trim, such as one with other lags.

    Args:
        design: both controllers.
        system: the plant.
        trim: of that plant; its steady values those of the design.
        name: of the plant, for messages.

    Raises:
        InvalidInputError: the trim is none of this plant.
        NotConvergedError: roots or margins could not be found, or the two routes to the closed loop disagree.
    """
    signals = design.signals
    model = linearize(system, trim).model
    plant = TwoInputPlant.of(model, signals.fast, signals.slow, signals.measurement, sign=design.reserve.sign)
    rest_fast, rest_slow = OutputRange(trim.input(signals.fast)), OutputRange(trim.input(signals.slow))
    law = law_of(design.gains, design.reserve.sign)
    loop = close_both(system, law, fast=rest_fast, slow=rest_slow, signals=signals)
    closed = linearize(loop, resting_point(loop, trim, trim.output(signals.measurement))).model
    roots = characteristic_roots(closed)
    disagreement = _disagreement(plant, design.gains, roots)
    if disagreement > AGREEMENT:
        message = (
            f"{name}: at the roots of the connected system 1 + L is {disagreement:.3g} of its terms where 0 is due (limit {AGREEMENT:g}); "
            "the loops are not those of the system"
        )
        raise NotConvergedError(message, disagreement=disagreement)
    wires = LoopSignals(drive=signals.slow, measurement=signals.measurement, measurement_rate=signals.measurement_rate)
    g = design.gains
    left = open_loop_of_system(model, _pid(design, g.slow_kp * g.kp, g.slow_ki * g.kp, g.slow_kd), wires=wires)
    alone = open_loop_of_system(model, _pid(design, design.alone.kp, design.alone.ki, design.alone.kd), wires=wires)
    broken: dict[str, OpenLoop] = broken_loops(plant, g, unstable=float(roots.unstable_count), unstable_at_limit=left.unstable_poles)
    loops = {key: find_margins(entry) for key, entry in {**broken, "slow alone": alone}.items()}
    fast_alone = find_margins(
        OpenLoop(name=f"{signals.fast} alone", transfer=loops_of(plant, g)[0], delay=float(np.min(model.lags)), unstable_poles=0.0)
    )
    return MidRangingMargins(
        broken=tuple(loops.items()),
        disk=find_two_input_disk(plant, g),
        roots=roots,
        disagreement=disagreement,
        fast_crossover=_highest(fast_alone),
        slow_crossover=_highest(loops["slow"]),
    )


def confirm_design(design: MidRangingDesign, system: DelaySystem, trim: Trim) -> MidRangingMargins:
    """Find the margins of a design on its own plant, and refuse a design that does not keep its bounds there.

    Raises:
        NotConvergedError: the closed loop is unstable, a peak of the sensitivity is above the bound, or the crossovers are too near; or as
            `find_mid_ranging_margins`.
    """
    found = find_mid_ranging_margins(design, system, trim)
    bounds = design.bounds
    worst = max(entry.sensitivity.value for entry in found.loops.values())
    apart = found.fast_crossover / found.slow_crossover
    if not (found.stable and worst <= bounds.ms * (1.0 + KEPT) and apart >= bounds.separation * (1.0 - KEPT)):
        message = (
            f"the design does not keep its bounds: stable {found.stable}, Ms {worst:.6g} (limit {bounds.ms:g}), crossovers {apart:.4g} "
            f"apart (limit {bounds.separation:g}); ask for other bounds"
        )
        raise NotConvergedError(message, ms=worst, separation=apart)
    return found


def _highest(found: Margins) -> float:
    """The highest crossover; both loops hold an integrator, so that there is one."""
    return max(c.frequency for c in found.gain_crossovers)


def _disagreement(plant: TwoInputPlant, gains: LoopGains, roots: RightmostRoots) -> float:
    away = roots.roots[np.abs(roots.roots) > 0.0]
    fast, slow = (loop(away) for loop in loops_of(plant, gains))
    return float(np.max(np.abs(1.0 + fast + slow) / (1.0 + np.abs(fast) + np.abs(slow)), initial=0.0))


def _pid(design: MidRangingDesign, kp: float, ki: float, kd: float) -> PidGains:
    model = design.linear.model
    units = {signal.name: signal.unit for signal in (*model.inputs, *model.outputs)}
    return PidGains(
        kp=kp,
        ki=ki,
        kd=kd,
        input_unit=units[design.signals.measurement],
        output_unit=units[design.signals.slow],
        rule="largest integral gain",
        designed_on="exact linear model",
    )
