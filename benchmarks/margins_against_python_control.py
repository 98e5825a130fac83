"""Measure gain and phase margins of delayed loops against python-control, which approximates delays by Pade fractions.

    python benchmarks/margins_against_python_control.py [--repeats N]

The true margins come from closed forms where there are any, and from bisection of each loop's own formula, written out here a second
time. revline must meet them to 1e-9 before any time counts. python-control is given the delay as Pade fractions of several orders, and
as exact samples of the loop (an FRD), its only way to an exact delay. Times are the least of several, in one thread, from a model to
its margins. Status 1: a margin of revline is wrong, or finding it takes longer than the budget allows.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.stability.margins import Margins, find_margins
from revline.design.stability.open_loop import open_loop_of_model, open_loop_of_system
from revline.engine.lee1995 import lee1995
from revline.lti.state_space import DelayStateSpace
from revline.lti.transfer_function import TransferFunction

ORDERS = (1, 2, 4, 8)
"""Of the Pade fractions."""

SAMPLES = 1000
"""Frequencies of the sampled loop."""

AGREEMENT = 1e-9
"""Largest relative error of our gain margins, and absolute one of our phase margins in degrees."""

BUDGET = 50.0
"""Largest ratio of revline's time, peaks and stability verdict included, to that of python-control with a Pade fraction of order 4."""

Complexes = NDArray[np.complex128]
Loop = Callable[[Any], Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A loop, in three forms: ours, a formula, and python-control's by a Pade order.

    Attributes:
        name: in words.
        find: our margins, from the model on.
        loop: L(s), written out.
        pade: builds python-control's system with a Pade fraction of an order.
    """

    name: str
    find: Callable[[], Margins]
    loop: Loop
    pade: Callable[[int], Any]


@dataclass(frozen=True, slots=True)
class Truth:
    """The smallest gain margin above 1 and the phase margin in degrees."""

    gain: float
    phase_deg: float


def gains(kp: float, ki: float = 0.0, kd: float = 0.0, units: tuple[str, str] = ("rad/s", "deg")) -> PidGains:
    """Gains of a controller."""
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit=units[0], output_unit=units[1], rule="PID", designed_on="benchmark")


def model_case(name: str, numerator: float, denominator: tuple[float, ...], delay: float, pid: tuple[float, float, float]) -> Case:
    """A loop of a transfer function with delay and a PID controller."""
    kp, ki, kd = pid
    plant = TransferFunction(
        numerator=(numerator,), denominator=denominator, delay=delay, input_unit="deg", output_unit="rad/s", output_name="engine_speed"
    )

    def loop(s: Any) -> Any:
        rational = numerator / sum(c * s**k for k, c in enumerate(denominator))
        return (kp + (ki / s if ki else 0.0) + kd * s) * rational * np.exp(-s * delay)

    def pade(order: int) -> Any:
        import control as ct  # noqa: PLC0415 - a peer: only where it is measured

        controller = ct.tf([kd, kp, ki], [1.0, 0.0]) if ki else ct.tf([kd, kp], [1.0])
        return controller * ct.tf([numerator], list(reversed(denominator))) * ct.tf(*ct.pade(delay, order))

    return Case(name=name, find=lambda: find_margins(open_loop_of_model(plant, gains(*pid))), loop=loop, pade=pade)


def engine_case(name: str, pid: tuple[float, float, float]) -> Case:
    """A loop of the engine's exact linear model at 25 degrees, whose delay lies inside, and a PID controller on the speed."""
    kp, ki, kd = pid
    engine = lee1995()
    model = linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model
    a, b, enter, leave, lag = single_delay(model)

    def loop(s: Any) -> Any:
        points = np.atleast_1d(np.asarray(s, dtype=complex))[:, None, None]
        matrix = points * np.eye(2) - a - np.exp(-points * lag) * np.outer(enter, leave)
        speed = np.linalg.solve(matrix, np.broadcast_to(b[:, None], (points.size, 2, 1)))[:, 1, 0]
        return (kp + ki / points[:, 0, 0] + kd * points[:, 0, 0]) * speed

    def pade(order: int) -> Any:
        import control as ct  # noqa: PLC0415 - a peer: only where it is measured

        fraction = ct.ss(ct.tf(*ct.pade(lag, order)))
        n = fraction.nstates
        inner = np.block(
            [[a + np.outer(enter, leave) * fraction.D, np.outer(enter, fraction.C)], [np.outer(fraction.B, leave), fraction.A]]
        )
        whole = np.zeros((n + 3, n + 3))  # the last state is the integral of the speed
        whole[:-1, :-1], whole[-1, 1] = inner, 1.0
        drive = np.concatenate((b, np.zeros(n + 1)))
        output = kd * whole[1] + kp * np.eye(n + 3)[1] + ki * np.eye(n + 3)[-1]
        return ct.ss(whole, drive[:, None], output[None], kd * drive[1])

    return Case(name=name, find=lambda: find_margins(open_loop_of_system(model, gains(*pid))), loop=loop, pade=pade)


def single_delay(model: DelayStateSpace) -> tuple[Any, Any, Any, Any, float]:
    """A, the throttle's column of B, what the one channel in the loop gives the states and takes from them, and its lag."""
    names = [signal.name for signal in model.channels]
    channel = names.index("charge")
    throttle = [signal.name for signal in model.inputs].index("throttle")
    others = np.delete(model.Cz, channel, axis=0)
    if np.any(others) or np.any(model.Dzz) or np.any(model.Dzu[:, throttle]):
        message = "the engine's model has more than one channel in the loop; the formula of this benchmark has one"
        raise RuntimeError(message)
    return model.A, model.Bu[:, throttle], model.Bz[:, channel], model.Cz[channel], float(model.lags[channel])


def make_cases() -> tuple[Case, ...]:
    """All loops."""
    return (
        model_case("lag with a delay as long: exp(-s)/(s + 1)", 1.0, (1.0, 1.0), 1.0, (1.0, 0.0, 0.0)),
        model_case("first order plus dead time with SIMC's PI: exp(-0.1 s)/(0.8 s + 1), kp 4, ki 5", 1.0, (1.0, 0.8), 0.1, (4.0, 5.0, 0.0)),
        model_case("G2d with C2d", 12.0065, (1.0, 0.5515, 0.0344), 0.0213, (1.2, 2.0, 0.1)),
        engine_case("the engine's exact model with C2d", (1.2, 2.0, 0.1)),
    )


CLOSED_FORMS = {0: Truth(2.26182633411465, math.inf), 1: Truth(math.pi, 90.0 - math.degrees(0.5))}
"""Of the first case: atan w + w = pi, gain sqrt(1 + w^2), never 1 above zero frequency. Of the second L = 5 exp(-0.1 s)/s."""


def true_margins(loop: Loop, low: float = 1e-2, high: float = 1e3) -> Truth:
    """Margins of a formula by bisection between many frequencies.

    The first case's gain is 1 at zero frequency only, so that it has no phase margin.
    """
    omega = np.geomspace(low, high, 20_001)
    value = np.asarray(loop(1j * omega))

    def at(w: float) -> complex:
        return complex(np.asarray(loop(1j * np.array([w])))[0])

    def roots(function: Callable[[complex], float]) -> list[float]:
        samples = np.array([function(complex(v)) for v in value])
        places = np.flatnonzero(np.sign(samples[1:]) != np.sign(samples[:-1]))
        return [float(brentq(lambda w: function(at(w)), omega[k], omega[k + 1], xtol=1e-14, rtol=1e-14)) for k in places]

    turns = [1.0 / abs(at(w)) for w in roots(lambda v: v.imag) if at(w).real < 0.0]
    phases = [math.degrees(math.atan2(-at(w).imag, -at(w).real)) for w in roots(lambda v: abs(v) - 1.0)]
    return Truth(min((g for g in turns if g > 1.0), default=math.inf), min(phases, key=abs, default=math.inf))


def our_margins(found: Margins) -> Truth:
    """The same two numbers of our result."""
    rise, phase = found.gain_rise, found.phase
    return Truth(math.inf if rise is None else rise.gain_margin, math.inf if phase is None else phase.phase_margin_deg)


def their_margins(system: Any) -> Truth:
    """The same two numbers by python-control."""
    import control as ct  # noqa: PLC0415 - a peer: only where it is measured

    gain, phase, *_ = ct.stability_margins(system)
    return Truth(float(gain), float(phase))


def sampled(case: Case) -> Any:
    """The loop as exact samples."""
    import control as ct  # noqa: PLC0415 - a peer: only where it is measured

    omega = np.geomspace(1e-2, 1e3, SAMPLES)
    return ct.frd(np.asarray(case.loop(1j * omega)), omega, smooth=True)


def errors(found: Truth, truth: Truth) -> tuple[float, float]:
    """Relative error of the gain margin, and of the phase margin in degrees; 0 where both are infinite."""
    gain = 0.0 if found.gain == truth.gain else abs(found.gain / truth.gain - 1.0)
    return gain, 0.0 if found.phase_deg == truth.phase_deg else abs(found.phase_deg - truth.phase_deg)


def least_ms(run: Callable[[], object], repeats: int) -> float:
    """Least time of several, in ms."""
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        run()
        times.append(time.perf_counter() - begun)
    return 1e3 * min(times)


def check(case: Case, truth: Truth) -> Truth:
    """Our margins; RuntimeError says which is wrong."""
    found = our_margins(case.find())
    for what, error in zip(("gain margin", "phase margin"), errors(found, truth), strict=True):
        if not error <= AGREEMENT:
            message = f"{case.name}: our {what} is off by {error:.2g}, more than {AGREEMENT:g}: {found} instead of {truth}"
            raise RuntimeError(message)
    return found


def show(name: str, found: Truth, truth: Truth, milliseconds: float) -> None:
    """Print one line."""
    gain, phase = errors(found, truth)
    left, right = f"gain {found.gain:8.4f} (off {gain:7.1e})", f"phase {found.phase_deg:8.3f} deg (off {phase:7.1e})"
    print(f"  {name:28s} {left}  {right}  {milliseconds:7.2f} ms")


def main() -> int:
    """Check, measure and show."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--repeats", type=int, default=15, help="runs of each")
    repeats = parser.parse_args().repeats
    try:
        import control  # noqa: PLC0415 - a peer: only where it is measured
    except ImportError as error:
        print(f"{error}; make .venv/.bench installs the peers", file=sys.stderr)
        return 2
    print(f"python-control {control.__version__}")
    slowest = 0.0
    for number, case in enumerate(make_cases()):
        truth = true_margins(case.loop)
        if number in CLOSED_FORMS and max(errors(truth, CLOSED_FORMS[number])) > 1e-10:
            message = f"{case.name}: bisection gives {truth}, the closed form {CLOSED_FORMS[number]}"
            raise RuntimeError(message)
        print(case.name)
        own = least_ms(case.find, repeats)
        show("revline, exact", check(case, truth), truth, own)
        for order in ORDERS:
            spent = least_ms(lambda case=case, order=order: their_margins(case.pade(order)), repeats)
            show(f"python-control, Pade {order}", their_margins(case.pade(order)), truth, spent)
            slowest = max(slowest, own / spent) if order == 4 else slowest
        show(
            f"python-control, {SAMPLES} samples",
            their_margins(sampled(case)),
            truth,
            least_ms(lambda case=case: their_margins(sampled(case)), 3),
        )
    print(f"revline takes at most {slowest:.1f} times as long as Pade of order 4")
    if slowest > BUDGET:
        print(f"revline takes {slowest:.1f} times as long as python-control, over its budget of {BUDGET:g}", file=sys.stderr)
    return int(slowest > BUDGET)


if __name__ == "__main__":
    sys.exit(main())
