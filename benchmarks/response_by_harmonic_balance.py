"""Compare three ways to the thesis's frequency response at 25 +- 5 deg, and measure linearisation at many points.

    python benchmarks/response_by_harmonic_balance.py [--repeats N]

All at the 42 frequencies of Table 4.1, on one thread, compiled and warm: harmonic balance at 1e-5; sinusoids simulated until they have
settled, with the step halved until it no longer matters, at 1e-5; and the thesis's procedure at our compiled speed, 4 cycles at the lowest
frequency to 120 at the highest in steps of 1 ms, its fundamental read by least squares from the second half. Their errors are those of
the complex response, against harmonic balance at 1e-11. Routes take turns; the least times count. Status 1: a budget is missed.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from revline import lee1995
from revline.analysis.harmonic_balance import BalanceSettings, balance_harmonics
from revline.analysis.linearize import linearize_each
from revline.analysis.periodic import Excitation, RunSettings
from revline.analysis.sinestream import find_sinestream
from revline.analysis.trim import Trim, find_trim
from revline.dde.simulate import Options, Start, simulate
from revline.signals import sine
from revline.studies.config import read_table_4_1
from revline.system import DelaySystem

ACCURACY = 1e-5
AMPLITUDE = 5.0
SETTLED_BUDGET = 30.0
"""Least ratio of settled sinusoids to harmonic balance."""

THESIS_BUDGET = 100.0
"""Least ratio of the thesis's procedure to harmonic balance."""

BALANCE_BUDGET = 0.010
"""Seconds that harmonic balance may take at most."""

LINEAR_BUDGET = 0.5
"""Seconds that exact linearisation at a thousand points may take."""

Complexes = NDArray[np.complex128]
Floats = NDArray[np.float64]
SINE = Excitation(input_name="throttle", output_name="engine_speed", amplitude=AMPLITUDE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """A way to the response: its name, and the function that gives the complex values."""

    name: str
    run: Callable[[], Complexes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """What a route took at least, in seconds, and its largest relative error."""

    name: str
    seconds: float
    error: float


def make_routes(engine: DelaySystem, trim: Trim, omega: Floats) -> tuple[Route, ...]:
    """List the three routes, harmonic balance first."""
    settings = RunSettings(tolerance=ACCURACY, step_tolerance=ACCURACY)
    return (
        Route(
            name="harmonic balance",
            run=lambda: balance_harmonics(engine, trim, SINE, omega, settings=BalanceSettings(tolerance=ACCURACY)).fundamental.values,
        ),
        Route(
            name="settled sinusoids",
            run=lambda: find_sinestream(engine, trim, SINE, omega, settings=settings, workers=1).fourier.values,
        ),
        Route(name="the thesis's procedure", run=lambda: np.array([run_as_thesis(engine, trim, w, omega) for w in omega])),
    )


def run_as_thesis(engine: DelaySystem, trim: Trim, w: float, omega: Floats) -> complex:
    """Simulate 4 to 120 cycles, by the frequency's place between lowest and highest, and fit three harmonics to the second half."""
    place = np.log(w / omega[0]) / np.log(omega[-1] / omega[0])
    cycles = round(4.0 * 30.0**place)
    start = Start(states=trim.states, inputs=trim.inputs, channels=trim.channels)
    kept = Options(every=max(1, int(2.0 * np.pi / w / 1e-3 / 128)))  # about 128 samples of a slow cycle, so that reading them costs little
    run = simulate(engine, start, {"throttle": sine(AMPLITUDE, w)}, until=cycles * 2.0 * np.pi / w, step=1e-3, options=kept)
    half = run.times.size // 2
    phases = w * run.times[half:]
    columns = [np.ones_like(phases)] + [wave(m * phases) for m in (1, 2, 3) for wave in (np.sin, np.cos)]
    basis = np.array(columns)
    found = np.linalg.solve(basis @ basis.T, basis @ run.output("engine_speed")[half:])
    return complex(found[1] + 1j * found[2]) / AMPLITUDE


def measure(routes: Sequence[Route], exact: Complexes, repeats: int) -> list[Measured]:
    """Let routes take turns; harmonic balance, which takes milliseconds, several times in each."""
    least = [np.inf] * len(routes)
    for _ in range(repeats):
        for k, route in enumerate(routes):
            least[k] = min(least[k], *(time_once(route) for _ in range(100 if k == 0 else 1)))
    errors = (float(np.max(np.abs(route.run() / exact - 1.0))) for route in routes)
    return [Measured(name=route.name, seconds=least[k], error=error) for k, (route, error) in enumerate(zip(routes, errors, strict=True))]


def time_once(route: Route) -> float:
    """Seconds that a route takes."""
    begun = time.perf_counter()
    route.run()
    return time.perf_counter() - begun


def measure_linearisation(engine: DelaySystem, repeats: int) -> float:
    """Linearise at a thousand trims, which are given: fifty operating points, twenty times each; least seconds."""
    trims = [find_trim(engine, inputs={"throttle": angle}) for angle in np.linspace(6.0, 80.0, 50)] * 20
    least = np.inf
    for _ in range(3 * repeats):
        begun = time.perf_counter()
        linearize_each(engine, trims)
        least = min(least, time.perf_counter() - begun)
    return float(least)


def main() -> int:
    """Measure, and compare with the budgets."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--repeats", type=int, default=3, help="turns of each route; the least times count")
    repeats = parser.parse_args().repeats
    omega = np.array([row["frequency_rad_s"] for row in read_table_4_1()])
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    exact = balance_harmonics(engine, trim, SINE, omega, settings=BalanceSettings(tolerance=1e-11)).fundamental.values
    routes = make_routes(engine, trim, omega)
    balance, settled, thesis = measure(routes, exact, repeats)
    for entry in (balance, settled, thesis):
        ratio = entry.seconds / balance.seconds
        sys.stdout.write(f"{entry.name:24} {1e3 * entry.seconds:9.2f} ms   error {entry.error:.1e}   ratio {ratio:6.1f}\n")
    linear = measure_linearisation(engine, repeats)
    sys.stdout.write(f"{'1000 linearisations':24} {1e3 * linear:9.2f} ms\n")
    kept = (
        balance.seconds <= BALANCE_BUDGET
        and balance.error <= min(ACCURACY, settled.error, thesis.error)
        and settled.seconds >= SETTLED_BUDGET * balance.seconds
        and thesis.seconds >= THESIS_BUDGET * balance.seconds
        and linear <= LINEAR_BUDGET
    )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
