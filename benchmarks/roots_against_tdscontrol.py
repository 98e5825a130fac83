"""Measure characteristic roots of the engine's exact model, open and in closed loop, against tdscontrol.

    python benchmarks/roots_against_tdscontrol.py [--repeats N]

tdscontrol, the Python binding of KU Leuven's TDS-CONTROL, is given the matrices of the same retarded system, closed here a second time,
and a half plane; it lists a root several times, so that equal ones are merged. revline is asked for as many roots. Before any time counts,
both lists must hold the same roots, and each of ours must be a root of the determinant, written out here, to rounding. Times are the
least of several, in one thread. Status 1: a root is wrong, or revline takes longer than its budget allows.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.engine.lee1995 import lee1995
from revline.lti.interconnection import feed_back
from revline.lti.roots import RightmostRoots, characteristic_roots
from revline.lti.state_space import DelayStateSpace, Signal

ACCURACY = 1e-10
"""Largest Newton step of the determinant at one of our roots, relative to 1 + |s|."""

PEER_ACCURACY = 1e-6
"""Largest distance of a root of tdscontrol from ours, relative to 1 + |s|."""

BUDGET = 1.0
"""Largest ratio of revline's time to tdscontrol's."""

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A loop: dx/dt = now x(t) + then x(t - lag), and revline's own form of it.

    Attributes:
        name: in words.
        now, then: matrices.
        lag: in s.
        system: what revline is given.
        right_of: roots with a larger real part are asked for.
    """

    name: str
    now: Floats
    then: Floats
    lag: float
    system: DelayStateSpace
    right_of: float


def make_cases() -> tuple[Case, ...]:
    """The engine at 25 degrees: open, with C2d and with C1 of the thesis."""
    engine = lee1995()
    model = linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model
    channel = [signal.name for signal in model.channels].index("charge")
    throttle = [signal.name for signal in model.inputs].index("throttle")
    now, then = model.A, np.outer(model.Bz[:, channel], model.Cz[channel])
    lag, drive = float(model.lags[channel]), model.Bu[:, throttle]
    cases = [Case(name="engine, open", now=now, then=then, lag=lag, system=model, right_of=-310.0)]
    for name, (kp, ki, kd), right_of in (("with C2d", (1.2, 2.0, 0.1), -150.0), ("with C1", (2.153, 16.85, 0.0), -60.0)):
        closed_now, closed_then = np.zeros((3, 3)), np.zeros((3, 3))  # the third state is the integral of the speed
        closed_now[:2, :2], closed_then[:2, :2], closed_now[2, 1] = now, then, 1.0
        closed_now[:2] -= np.outer(drive, np.array([0.0, kp, ki]) + kd * np.append(now[1], 0.0))
        closed_then[:2] -= np.outer(drive, kd * np.append(then[1], 0.0))
        system = close_loop(model, throttle, (kp, ki, kd))
        cases.append(Case(name=f"engine {name}", now=closed_now, then=closed_then, lag=lag, system=system, right_of=right_of))
    return tuple(cases)


def close_loop(model: DelayStateSpace, throttle: int, gains: tuple[float, float, float]) -> DelayStateSpace:
    """Close the loop by revline's own algebra: the integral of the speed as a state, then proportional feedback of outputs."""
    names = [signal.name for signal in model.outputs]
    speed, acceleration = names.index("engine_speed"), names.index("engine_acceleration")
    n, p = len(model.states), len(model.outputs)
    integral = Signal("integral_of_engine_speed", "rad")
    extended = DelayStateSpace(
        A=np.block([[model.A, np.zeros((n, 1))], [model.Cy[[speed]], np.zeros((1, 1))]]),
        Bu=np.vstack((model.Bu, model.Dyu[[speed]])),
        Bz=np.vstack((model.Bz, model.Dyz[[speed]])),
        Cy=np.block([[model.Cy, np.zeros((p, 1))], [np.zeros((1, n)), np.ones((1, 1))]]),
        Dyu=np.vstack((model.Dyu, np.zeros((1, len(model.inputs))))),
        Dyz=np.vstack((model.Dyz, np.zeros((1, len(model.channels))))),
        Cz=np.hstack((model.Cz, np.zeros((len(model.channels), 1)))),
        Dzu=model.Dzu,
        Dzz=model.Dzz,
        lags=model.lags,
        states=(*model.states, integral),
        inputs=model.inputs,
        outputs=(*model.outputs, integral),
        channels=model.channels,
    )
    feedback = np.zeros((len(model.inputs), p + 1))
    for row, gain in zip((speed, p, acceleration), gains, strict=True):
        feedback[throttle, row] = -gain
    return feed_back(extended, feedback)


def newton_steps(case: Case, roots: Complexes) -> Floats:
    """How far Newton's method on the determinant would move each root, relative to 1 + |s|; the slope by complex central difference."""

    def determinant(s: Complexes) -> Complexes:
        shifted = s[:, None, None]
        return np.asarray(np.linalg.det(shifted * np.eye(len(case.now)) - case.now - case.then * np.exp(-shifted * case.lag)))

    width = 1e-5 * (1.0 + np.abs(roots))
    slopes = (determinant(roots + width) - determinant(roots - width)) / (2.0 * width)
    return np.asarray(np.abs(determinant(roots) / slopes) / (1.0 + np.abs(roots)))


def distinct(roots: Complexes) -> Complexes:
    """Merge roots that are equal to the peer's accuracy."""
    kept: list[complex] = []
    for root in map(complex, roots):
        if all(abs(root - other) > 10.0 * PEER_ACCURACY * (1.0 + abs(root)) for other in kept):
            kept.append(root)
    return np.array(kept, dtype=complex)


def check(case: Case, own: RightmostRoots, theirs: Complexes) -> float:
    """Compare all roots in the half plane; give the largest relative distance. RuntimeError says what differs."""
    mine = own.roots[own.roots.real > case.right_of]
    steps = newton_steps(case, mine)
    if not np.max(steps) <= ACCURACY:
        message = f"{case.name}: {mine[np.argmax(steps)]:.12g} is no root of the determinant: Newton moves it by {np.max(steps):.2g}"
        raise RuntimeError(message)
    if mine.size == own.roots.size:
        message = f"{case.name}: revline's list ends within the half plane right of {case.right_of:g}; ask for more roots"
        raise RuntimeError(message)
    merged = distinct(theirs)
    if merged.size != mine.size:
        message = f"{case.name}: tdscontrol finds {merged.size} roots right of {case.right_of:g} rad/s, revline {mine.size}"
        raise RuntimeError(message)
    gaps = np.min(np.abs(merged[:, None] - mine[None, :]), axis=1) / (1.0 + np.abs(merged))
    if not np.max(gaps) <= PEER_ACCURACY:
        message = f"{case.name}: tdscontrol's root {merged[np.argmax(gaps)]:.9g} is none of ours, off by {np.max(gaps):.2g}"
        raise RuntimeError(message)
    return float(np.max(gaps))


def least_ms(run: Callable[[], object], repeats: int) -> float:
    """Least time of several, in ms."""
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        run()
        times.append(time.perf_counter() - begun)
    return 1e3 * min(times)


def main() -> int:
    """Check, measure, and compare with the budget."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--repeats", type=int, default=9, help="runs of each")
    repeats = parser.parse_args().repeats
    try:
        from tdscontrol import pytdscontrol as peer  # noqa: PLC0415 - a peer: only where it is measured
    except ImportError as error:
        print(f"{error}; make .venv/.bench installs the peers", file=sys.stderr)
        return 2
    ratios = []
    for case in make_cases():
        matrices = [np.asfortranarray(case.now), np.asfortranarray(case.then)]

        def theirs(matrices: list[Floats] = matrices, case: Case = case) -> Any:
            return peer.roots(peer.tds(matrices, [0.0, case.lag]), case.right_of)

        listed = np.array(theirs(), dtype=complex)
        count = distinct(listed).size + 1
        own = characteristic_roots(case.system, count=count)
        gap = check(case, own, listed)
        mine = least_ms(lambda case=case, count=count: characteristic_roots(case.system, count=count), repeats)
        other = least_ms(theirs, repeats)
        ratios.append(mine / other)
        print(f"{case.name}: {count - 1} roots right of {case.right_of:g} rad/s, the first {own.roots[0]:.10g}")
        print(f"  revline {mine:.2f} ms, {own.roots.size} roots; tdscontrol {other:.2f} ms, listed {listed.size} times, off by {gap:.1e}")
    if max(ratios) > BUDGET:
        print(f"revline takes {max(ratios):.2f} times as long as tdscontrol, over its budget of {BUDGET:g}", file=sys.stderr)
    return int(max(ratios) > BUDGET)


if __name__ == "__main__":
    sys.exit(main())
