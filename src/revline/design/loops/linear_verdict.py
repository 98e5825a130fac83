"""Whether the exact linear loop about an operating point is stable, and where its gains would have to be: told beside what is run.

Continuous controllers are judged with every delay exact, sampled ones as their samples see it. Between two factors of all gains at
which the loop has a root on the stability boundary the number of unstable roots is one and the same, so that one count tells.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim
from revline.design.controllers.pid_controller import Continuous, PidController
from revline.design.plants.loop_signals import SPEED_BY_THROTTLE, LoopSignals
from revline.design.stability.discrete_loop import Transfer, find_discrete_margins, sampled_plant_of_model, sampled_plant_of_system
from revline.design.stability.margins import Margins, find_margins
from revline.design.stability.open_loop import OpenLoop, open_loop_of_model, open_loop_of_system
from revline.errors import InvalidInputError, NotConvergedError
from revline.lti.state_space import position
from revline.lti.transfer_function import TransferFunction
from revline.system import DelaySystem

TRIES = 3
"""So many ranges of factors to each side of the gains given are asked for stability."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearVerdict:
    """The linear loop about an operating point.

    Attributes:
        unstable_poles: of the closed loop; infinite where the delay makes them so.
        where: what they lie beyond, in words.
        margins: none where the loop gain does not fall at high frequency, so that it has no margins.
        stable_range: factors of all gains between which the loop is stable, nearest to 1; none where it is stable as it is, or where no
            factor mends it.
        slow: what is to be said of a sampling period that is longer than the plant's delay; empty where it is not.
    """

    unstable_poles: float
    where: str
    margins: Margins | None
    stable_range: tuple[float, float] | None
    slow: str = ""

    @property
    def stable(self) -> bool:
        """Whether the loop is stable with its own gains."""
        return self.unstable_poles == 0

    @property
    def warning(self) -> str:
        """What is wrong with it, with the margin that it lacks; empty where nothing is."""
        if self.stable:
            return ""
        count = f"{self.unstable_poles:g}" if math.isfinite(self.unstable_poles) else "infinitely many"
        noun = "pole" if self.unstable_poles == 1 else "poles"
        return f"the linear loop at the operating point is unstable, with {count} {noun} {self.where}{self.remedy}"

    @property
    def remedy(self) -> str:
        """With which multiple of its gains an unstable loop would be stable, as the end of a sentence; empty where there are no margins."""
        if self.stable_range is None:
            return "; no common factor of its gains was found to mend it" if self.margins is not None else ""
        low, high = self.stable_range
        edge = high if high < 1.0 else low
        margin = f"gain margin {20.0 * math.log10(edge):.2f} dB"
        if low == 0.0:
            return f"; it would be stable below {high:.4g} times its gains ({margin})"
        upper = f" to {high:.4g}" if math.isfinite(high) else " and more"
        return f"; it would be stable with {low:.4g}{upper} times its gains ({margin})"


def judge_linear_system(
    plant: DelaySystem, trim: Trim, controller: PidController, *, wires: LoopSignals = SPEED_BY_THROTTLE
) -> LinearVerdict:
    """Judge the linear loop of a system about its trim.

    Args:
        plant: nonlinear, with its delays.
        trim: where.
        controller: continuous or sampled; limits, dead zone and quantisation have no part in small signals.
        wires: which signals close the loop.

    Raises:
        InvalidInputError: the system has no such signals, or a sampling period is too long to be judged.
        NotConvergedError: the loop has a root on the stability boundary, or too near to tell.
        AnalysisError: roots to the right may be without number.
    """
    model = linearize(plant, trim).model
    drive, measured = position(model.inputs, wires.drive), position(model.outputs, wires.measurement)
    static = _static_gain(lambda s: np.asarray(model.transfer(s)[..., measured, drive]))
    if isinstance(controller.sampling, Continuous):
        return _judge_continuous(lambda law: open_loop_of_system(model, law, wires=wires, name=plant.name), controller, static)
    sampled, speed = sampled_plant_of_system(model, wires=wires, name=plant.name), trim.output(wires.measurement)
    found = _judge_sampled(lambda law: find_discrete_margins(sampled, law, speed=speed).margins, controller, static)
    return replace(found, slow=_slow(controller.sampling.period_at(speed), float(max(model.lags, default=0.0))))


def judge_linear_model(model: TransferFunction, controller: PidController, *, speed: float = 0.0) -> LinearVerdict:
    """Judge the loop of a linear model.

    Args:
        model: strictly proper, with or without delay.
        controller: continuous or sampled.
        speed: at the trim, in rad/s, for sampling by the crank's angle.

    Raises:
        InvalidInputError: plant and controller do not make a well-posed loop; sampled, also where the model has a pole on the axis.
        NotConvergedError: the loop has a root on the stability boundary, or too near to tell.
    """
    static = _static_gain(lambda s: np.asarray(model(s)))
    if isinstance(controller.sampling, Continuous):
        return _judge_continuous(lambda law: open_loop_of_model(model, law), controller, static)
    sampled = sampled_plant_of_model(model)
    given = {} if speed == 0.0 else {"speed": speed}
    found = _judge_sampled(lambda law: find_discrete_margins(sampled, law, **given).margins, controller, static)
    return replace(found, slow=_slow(controller.sampling.period_at(speed), model.delay))


def _slow(period: float, delay: float) -> str:
    """What is to be said of a period that is longer than the plant's delay."""
    if not 0.0 < delay < period:
        return ""
    return (
        f"the controller samples every {period:.4g} s, longer than the plant's delay of {delay:.3g} s; the loop waits for the controller "
        "more than for the plant: sample faster"
    )


def _static_gain(transfer: Transfer) -> float:
    """Gain of the plant at rest; infinite where it integrates."""
    with np.errstate(divide="ignore", invalid="ignore"):
        value = complex(transfer(np.zeros(1, dtype=complex))[0])
    return value.real if math.isfinite(value.real) else math.inf


def _judge_continuous(make: Callable[[PidController], OpenLoop], controller: PidController, static: float) -> LinearVerdict:
    loop = make(controller)
    try:
        margins = find_margins(loop)
    except (InvalidInputError, NotConvergedError):  # no gain, or one that does not fall: the count alone stands
        margins = None
    stable_range = None if margins is None or loop.stable else _find_range(margins, controller, static, lambda law: make(law).stable)
    where = "right of the imaginary axis"
    return LinearVerdict(unstable_poles=loop.unstable_poles, where=where, margins=margins, stable_range=stable_range)


def _judge_sampled(find: Callable[[PidController], Margins], controller: PidController, static: float) -> LinearVerdict:
    margins = find(controller)
    stable_range = None if margins.stable else _find_range(margins, controller, static, lambda law: find(law).stable)
    where = "outside the unit circle, as its samples see it"
    return LinearVerdict(unstable_poles=margins.unstable_poles, where=where, margins=margins, stable_range=stable_range)


def _find_range(
    margins: Margins, controller: PidController, static: float, stable: Callable[[PidController], bool]
) -> tuple[float, float] | None:
    """Ask the ranges between crossings for stability, from the gains outwards, the smaller factors first.

    Without integral action a root may pass through rest itself too, which is no crossover.
    """
    gains, edges = controller.gains, sorted(crossing.gain_margin for crossing in margins.phase_crossovers)
    if gains.ki == 0.0 and math.isfinite(static) and gains.kp * static < 0.0:
        edges = sorted([*edges, -1.0 / (gains.kp * static)])
    ranges = list(zip([0.0, *edges], [*edges, math.inf], strict=True))
    below, above = [one for one in ranges if one[1] < 1.0][::-1], [one for one in ranges if one[0] > 1.0][:TRIES]
    for low, high in (*below[:TRIES], *below[TRIES:][-1:], *above):  # the lowest range is asked in any case
        middle = math.sqrt(low * high) if low > 0.0 and math.isfinite(high) else 0.9 * high if low == 0.0 else 1.1 * low
        try:
            found = stable(replace(controller, gains=gains.scaled(kp=middle, ki=middle, kd=middle)))
        except NotConvergedError:  # a range too narrow to be told from its ends; that the loop as it is is unstable stands
            continue
        if found:
            return low, high
    return None
