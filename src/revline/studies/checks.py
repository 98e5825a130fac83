"""The study's checks of itself: measured against the thesis, against converged values, and of its own parts against each other."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from revline.design.loops.outcome import Diverged, LimitCycle
from revline.studies.config import StudyConfig, read_table_4_1
from revline.studies.results import title
from revline.studies.routes import route_measures
from revline.studies.stability_results import AT_START, AT_TARGET
from revline.studies.trials import FIXED, SCHEDULE

if TYPE_CHECKING:
    from revline.studies.results import ModelsResult
    from revline.studies.study_results import StudyResults

CONVERGED = (
    (0.1, 60.00558, -3.1644),
    (1.0, 54.01155, -29.8740),
    (5.0, 22.06655, -87.6199),
    (10.0, 10.82323, -116.7925),
    (20.0, 4.408247, -153.4502),
    (50.0, 0.949534, -218.9742),
    (100.0, 0.253493, -295.2858),
)
"""Frequency in rad/s, amplitude in rad/s and phase in deg of the engine at 25 +- 5 deg, converged to all digits by harmonic balance."""

EFFECT = ((0.1, 0.0012, 5e-5), (1.0, 0.0017, 5e-5), (5.0, 0.014, 5e-4), (7.0, 0.015, 5e-4), (20.0, 0.0094, 5e-5), (60.0, 0.0, 1e-3))
"""Frequency in rad/s, by which part the exact response is above that to 5 deg, and the digits to which this is known from elsewhere."""

STEADY_SPEEDS = (
    (10.0, 64.467),
    (15.0, 121.238),
    (20.0, 180.676),
    (30.0, 300.778),
    (35.0, 360.154),
    (40.0, 418.614),
    (50.0, 531.854),
    (60.0, 638.934),
)
"""Throttle in deg and steady speed in rad/s, recomputed for the engine of Lee (1995) to all digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One measured number beside what was expected of it."""

    name: str
    measured: float
    expected: float
    tolerance: float
    unit: str = "1"

    @property
    def passed(self) -> bool:
        """Whether the measured number lies within the tolerance."""
        return abs(self.measured - self.expected) <= self.tolerance

    def record(self) -> dict[str, object]:
        """Fields for results.json."""
        return {
            "name": self.name,
            "measured": self.measured,
            "expected": self.expected,
            "tolerance": self.tolerance,
            "unit": self.unit,
            "passed": self.passed,
        }


def check_study(config: StudyConfig, results: "StudyResults") -> tuple[Check, ...]:
    """Check a study: its own consistency always, the thesis's numbers where every question is the thesis's."""
    own = tuple(_own_checks(config, results))
    if not config.asks_what_the_thesis_asked:
        return own
    parts = (_point_checks, _response_checks, _model_checks, _controller_checks, _loop_checks, _stability_checks, _design_checks)
    return own + tuple(check for part in parts for check in part(results))


def _check(name: str, measured: float, expected: float, tolerance: float, unit: str = "1") -> Check:
    return Check(name=name, measured=float(measured), expected=expected, tolerance=tolerance, unit=unit)


def _own_checks(config: StudyConfig, results: "StudyResults") -> Iterator[Check]:
    stream = results.response
    exact = results.point.exact.magnitude * config.amplitude_deg
    yield _check("residual of the trim", results.point.trim.residual, 0.0, 1e-6)
    yield _check("largest part of a waveform still changing when a sinusoid was read", float(np.max(stream.remaining)), 0.0, 1e-5)
    yield _check("largest error of an amplitude by the simulation's step", float(np.max(stream.step_error)), 0.0, 1e-5)
    yield _check("lowest frequency: amplitude over that of the exact small-signal response", stream.amplitude[0] / exact[0], 1.0, 0.03)
    yield _check("highest frequency: amplitude over that of the exact small-signal response", stream.amplitude[-1] / exact[-1], 1.0, 0.05)
    gap = float(np.max(np.abs(stream.peak_amplitude / stream.amplitude - 1.0)))
    yield _check("largest difference of peak reading from the fundamental", gap, 0.0, 0.05)
    for row in results.hunting.cycles:
        yield _check(f"limit cycle of {title(row.controller)}: orbit off its simulation, in tolerances", row.gap / row.tolerance, 0.0, 1.0)
    for name, measured, expected, tolerance in route_measures(results.routes):
        yield _check(name, measured, expected, tolerance)
    gain = abs(results.models.fit("g2").fit.model.static_gain / results.point.gain - 1.0)
    yield _check("static gain of G2 over that of the engine, less one", gain, 0.0, 0.02)
    compared = results.rivals.compared.competitors
    if compared:
        worst = max(one.ratio for one in compared)
        yield _check("largest load error of an optimum over its controller's, less one where above", max(0.0, worst - 1.0), 0.0, 1e-3)
        gap = max(abs(one.margins.sensitivity.value - float(one.optimum.costs[0].sensitivity.max())) for one in compared)
        yield _check("largest difference of an optimum's Ms to that of its exact loop", gap, 0.0, 0.01)
    for schedule in results.operating_map.schedule:
        yield _check("highest Ms of the schedule above its bound", max(0.0, schedule.worst - schedule.peak), 0.0, 0.0)
    for box, limit in zip(results.operating_map.box, results.operating_map.limit, strict=False):
        yield _check("share that no box of fixed gains exceeds, by proofs, over the found box's", limit.share / box.share, 1.125, 0.125)
    for spectrum in results.spectra:
        distance = spectrum.offset / spectrum.spectrum.resolution
        yield _check(f"spectral peak at {spectrum.omega:g} rad/s off the input's frequency, in resolutions", distance, 0.0, 1.0)


def _point_checks(results: "StudyResults") -> Iterator[Check]:
    point, steady = results.point, results.range
    yield _check("speed at 25 deg", point.trim.output("engine_speed"), 240.799, 1e-3, "rad/s")
    yield _check("pressure at 25 deg", point.trim.state("manifold_pressure"), 35.8072, 1e-3, "kPa")
    yield _check("static gain at 25 deg", point.gain, 12.0294, 1e-3, "rad/s per deg")
    angles = list(steady.steady_map.values)
    for angle, speed in STEADY_SPEEDS:
        measured = steady.steady_map.trims[angles.index(angle)].output("engine_speed")
        yield _check(f"steady speed at {angle:g} deg", measured, speed, 2e-3, "rad/s")
    yield _check("slope of the straight line", steady.line.slope, 11.83, 0.15, "rad/s per deg")
    yield _check("lowest angle that runs the engine", steady.steady_map.lowest, 4.0, 1.0, "deg")
    stable = [trim.stable for trim in steady.steady_map.trims]
    first_stable = angles[stable.index(True)]
    yield _check("first whole angle at which the engine is stable by itself", first_stable, 6.0, 0.0, "deg")


def _response_checks(results: "StudyResults") -> Iterator[Check]:
    stream = results.response
    rows = read_table_4_1()
    amplitude = np.array([row["speed_amplitude_rad_s"] for row in rows])
    lag = np.array([row["phase_lag_deg"] for row in rows])
    for name, sizes, phases, mean, worst, turn in (
        ("peaks", stream.peak_amplitude, stream.peaks.phase_deg, 0.0050, 0.0140, 1.72),
        ("fourier", stream.amplitude, stream.phase_deg, 0.0039, 0.0140, 1.58),
    ):
        deviation = np.abs(sizes / amplitude - 1.0)
        yield _check(f"{name}: mean deviation of the amplitude from Table 4.1", float(deviation.mean()), mean, 5e-4)
        yield _check(f"{name}: largest deviation of the amplitude from Table 4.1", float(deviation.max()), worst, 1e-3)
        yield _check(f"{name}: largest deviation of the phase from Table 4.1", float(np.abs(phases + lag).max()), turn, 0.1, "deg")
    for frequency, size, phase in CONVERGED:
        k = int(np.argmin(np.abs(stream.omega - frequency)))
        yield _check(f"fourier at {frequency:g} rad/s over the converged amplitude", stream.amplitude[k] / size, 1.0, 1e-4)
        yield _check(f"fourier at {frequency:g} rad/s, phase", stream.phase_deg[k], phase, 0.01, "deg")
    answered = sum(balance.omega.size for balance in results.routes.balances)
    yield _check("frequencies with an answer by harmonic balance", answered, float(stream.omega.size), 0.0)
    compared = sum(int(np.sum(c.difference.omega >= stream.omega[0])) for c in results.routes.check.comparisons)
    yield _check("frequencies at which two routes were compared, of both comparisons", compared, 2.0 * stream.omega.size, 0.0)
    for balance in results.routes.balances:
        for frequency, size, phase in CONVERGED:
            k = int(np.argmin(np.abs(balance.omega - frequency)))
            yield _check(f"harmonic balance at {frequency:g} rad/s over the converged amplitude", balance.amplitude[k] / size, 1.0, 2e-6)
            yield _check(f"harmonic balance at {frequency:g} rad/s, phase", balance.phase_deg[k], phase, 1e-4, "deg")
    for effect in results.routes.effects:
        for frequency, above, tolerance in EFFECT:
            k = int(np.argmin(np.abs(effect.omega - frequency)))
            yield _check(
                f"exact response over that of harmonic balance at {frequency:g} rad/s, less one", effect.magnitude[k], above, tolerance
            )
        slow = effect.omega <= 10.0
        yield _check("exact response off harmonic balance up to 10 rad/s", float(np.abs(effect.phase_deg[slow]).max()), 0.34, 0.01, "deg")
        yield _check("exact response off harmonic balance at the highest frequency", float(effect.phase_deg[-1]), -1.71, 0.005, "deg")


def _model_checks(results: "StudyResults") -> Iterator[Check]:
    table, own = results.table_models[0], results.models
    yield from _coefficient_checks("Table 4.1", table, "g1", ((12.21634,), (0.579381,)), 2e-4)
    yield from _coefficient_checks("Table 4.1", table, "g2", ((12.006617,), (0.551588, 0.0343956)), 2e-4)
    yield from _coefficient_checks("Table 4.1", table, "g12", ((12.004151, -0.1765447), (0.541338, 0.0266264)), 2e-4)
    yield from _coefficient_checks("own response", own, "g1", ((12.2316,), (0.58020,)), 2e-4)
    yield from _coefficient_checks("own response", own, "g2", ((12.0149,), (0.55104, 0.035517)), 2e-4)
    for position, pole in enumerate((-2.0435, -26.47, -33.81)):
        measured = sorted(table.fit("g3").fit.model.poles.real, reverse=True)[position]
        yield _check(f"Table 4.1: pole {position + 1} of G3", measured, pole, 0.05, "1/s")
    yield _check("Table 4.1: delay of G2d", table.fit("g2d").fit.model.delay, 0.02130, 1e-4, "s")
    yield _check("own response: delay of G2d", own.fit("g2d").fit.model.delay, 0.0214, 5e-4, "s")


def _coefficient_checks(
    source: str, models: "ModelsResult", name: str, expected: tuple[tuple[float, ...], tuple[float, ...]], relative: float
) -> Iterator[Check]:
    model = models.fit(name).fit.model
    for part, got, wanted, first in (
        ("numerator", model.numerator, expected[0], 0),
        ("denominator", model.denominator[1:], expected[1], 1),
    ):
        for k, value in enumerate(wanted):
            yield _check(f"{source}: {title(name)}, {part}, power {k + first}, over the expected", got[k] / value, 1.0, relative)


def _controller_checks(results: "StudyResults") -> Iterator[Check]:
    gains, tangents = results.controllers.gains, results.controllers.tangents
    yield _check("C1: kp", gains["c1"].kp, 2.153, 0.01, "deg/(rad/s)")
    yield _check("C1: ki", gains["c1"].ki, 16.85, 0.1, "deg/rad")
    yield _check("tangent on G2: L", tangents["g2"].dead_time, 0.0417, 2e-3, "s")
    yield _check("tangent on G2: T", tangents["g2"].rise_time, 0.670, 5e-3, "s")
    yield _check("tangent on G2d: L", tangents["g2d"].dead_time, 0.0630, 2e-3, "s")
    yield _check("Ziegler-Nichols with the gain on G2: kp", gains["c2_zn_with_gain"].kp, 1.61, 0.06, "deg/(rad/s)")
    yield _check("Ziegler-Nichols with the gain on G2d: kp", gains["c2d_zn_with_gain"].kp, 1.06, 0.03, "deg/(rad/s)")
    ratio = gains["c2_zn"].kp / gains["c2_zn_with_gain"].kp
    yield _check("Ziegler-Nichols without the gain over the rule with it", ratio, 12.0, 0.1)


def _loop_checks(results: "StudyResults") -> Iterator[Check]:
    loops, errors = results.loops, results.errors
    for controller, plant, stable in (
        ("c1", "g1", True), ("c2", "g2", True), ("c2d", "g2d", True), ("c2d", "engine", True),
        ("c1", "g2d", False), ("c2", "g2d", False), ("c1", "engine", False), ("c2", "engine", False),
    ):  # fmt: skip
        measured = float(loops.row(controller, plant).run.is_stable)
        yield _check(
            f"{title(controller)} on {'the engine' if plant == 'engine' else title(plant)}: stable (1) or not (0)",
            measured,
            float(stable),
            0.0,
        )
    c1 = loops.row("c1", "g1")
    yield _check("C1 on G1: overshoot", c1.run.overshoot, 0.0769, 1e-3)
    yield _check("C1 on G1: bandwidth", c1.bandwidth, 51.57, 0.1, "rad/s")
    for controller in ("c1", "c2"):
        hunts = isinstance(loops.row(controller, "engine").run.outcome, LimitCycle)
        yield _check(f"{title(controller)} on the engine: ends in a limit cycle (1) or not (0)", float(hunts), 1.0, 0.0)
    for controller in ("c1", "c2"):
        diverges = isinstance(loops.row(controller, "g2d").run.outcome, Diverged)
        yield _check(f"{title(controller)} on G2d: diverges (1) or not (0)", float(diverges), 1.0, 0.0)
    cycle = loops.row("c1", "engine").run.outcome
    if isinstance(cycle, LimitCycle):
        yield _check("C1 on the engine: low end of the limit cycle", cycle.low, 291.15, 0.1, "rad/s")
        yield _check("C1 on the engine: high end of the limit cycle", cycle.high, 310.07, 0.1, "rad/s")
        yield _check("C1 on the engine: period of the limit cycle", cycle.period, 0.2088, 2e-4, "s")
    difference = loops.row("c2d", "engine").run.overshoot - loops.row("c2d", "g2d").run.overshoot
    yield _check("C2d: overshoot on the engine less that on G2d", difference, 0.0, 0.01)
    yield _check("frequency at which G2 and G2d err alike", errors.equal_frequency, 18.0, 2.0, "rad/s")
    for record in errors.records:
        if record.kind == "sine" and record.frequency in (10.0, 30.0):
            wanted = {10.0: (1.0, 1.9), 30.0: (1.15, 0.65)}[record.frequency]
            for model, value in zip(("g2", "g2d"), wanted, strict=True):
                name = f"error of {title(model)} at {record.frequency:g} rad/s, its mean left out"
                yield _check(name, record.swing(model), value, 0.1 * value + 0.05, "rad/s")


def _stability_checks(results: "StudyResults") -> Iterator[Check]:
    """Gains at which stability is lost, recomputed for the engine of Lee (1995) to all digits; C1's own ratio ki/kp is 7.83 per second."""
    found, c1 = results.stability, results.controllers.gains["c1"]
    for plant, name, alone, with_integral in ((AT_START, "25 deg", 2.106, 1.240), (AT_TARGET, "30 deg", 2.794, 1.927)):
        ends = [region.intervals[-1][1] for region in found.of_kd(0.0) if region.plant == plant and region.intervals]
        yield _check(f"exact model at {name}: kp at which proportional control alone loses stability", sum(ends), alone, 1e-3)
        loop = found.margin("c1", plant)
        fall = None if loop is None else loop.margins.gain_fall
        measured = 0.0 if fall is None else c1.kp * fall.gain_margin
        yield _check(f"exact model at {name}: kp at which a controller of C1's ratio loses stability", measured, with_integral, 1e-3)
    yield _check("limit cycles computed as orbits", len(results.hunting.cycles), 2.0, 0.0)
    yield _check("onsets of hunting found", len(results.hunting.onsets), 1.0, 0.0)
    yield _check("models compared with the engine by the nu-gap", len(results.distance.rows), 8.0, 0.0)


def _design_checks(results: "StudyResults") -> Iterator[Check]:
    """The ultimate gain of the engine of Lee (1995), recomputed; C2d and Ziegler-Nichols leave something to gain; the schedule holds."""
    beaten = {one.name for one in results.rivals.beaten}
    for name in ("C2d", "ziegler-nichols", "ziegler-nichols-ultimate"):
        yield _check(f"{name}: the optimum has the lower load error (1) or not (0)", float(name in beaten), 1.0, 0.0)
    for found in results.rivals.ultimate:
        yield _check("ultimate gain of the exact linear model", found.exact.gain, 2.1064, 2e-4, found.unit)
        yield _check(
            "ultimate gain by the relay over what its exact model reads", found.relay.ultimate.gain / found.predicted.gain, 1.0, 3e-3
        )
        yield _check("ultimate gain by bisection over the exact one, sampled", found.bisection.gain / found.sampled.gain, 1.0, 0.01)
    for name, passes in (("c2d", False), ("optimum", True), (FIXED, True), (SCHEDULE, True)):
        trial = results.trials.trial(name)
        passed = trial is not None and trial.summary.passed
        yield _check(f"{name}: passes the acceptance (1) or not (0)", float(passed), float(passes), 0.0)
    drawn = float(results.two_inputs.is_drawn)
    yield _check("load steps with two inputs run to their end (1) or not (0)", drawn, 1.0, 0.0)
