"""The study's tables as values: for the report, and as CSV files with a unit in every column."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from revline.design.loops.closed_loop import describe_outcome
from revline.design.loops.outcome import LimitCycle
from revline.design.maps.schedule_design import ScheduleResult
from revline.report.tables import NumberColumn, Table
from revline.studies.config import StudyConfig, read_table_4_1
from revline.studies.results import LoopRow, ModelsResult, title
from revline.studies.stability_results import RegionRow
from revline.studies.study_results import StudyResults

Cell = float | str | None


def study_tables(config: StudyConfig, results: StudyResults) -> tuple[Table, ...]:
    """All tables of a study."""
    return tuple(_tables(config, results))


def _tables(config: StudyConfig, results: StudyResults) -> Iterator[Table]:
    yield steady_table(results)
    for size, record in zip(results.steps.sizes, results.steps.free, strict=True):
        yield _table(f"step_{size:g}_deg", ("time_s", "throttle_deg", "manifold_pressure_kpa", "engine_speed_rad_s"), record)
    yield response_table(config, results)
    yield from (_spectrum_table(check.omega, check.spectrum.omega, check.spectrum.amplitude) for check in results.spectra)
    yield models_table("models", results.models)
    for models in results.table_models:
        yield models_table("models_from_table_4_1", models)
    yield controllers_table(results)
    yield loops_table(results)
    yield margins_table(results)
    yield from (region_table(row) for row in results.stability.regions)
    yield rivals_table(results)
    yield from (schedule_table(found) for found in results.operating_map.schedule)
    yield trials_table(results)
    for row in results.loops.rows:
        run = row.run
        yield _table(f"loop_{row.controller}_{row.plant}", ("time_s", "speed_rad_s", "throttle_deg"), (run.times, run.output, run.control))


def _table(name: str, columns: tuple[str, ...], arrays: Sequence[np.ndarray]) -> Table:
    return make_table(name, columns, (tuple(float(v) for v in row) for row in zip(*arrays, strict=True)))


def make_table(name: str, headers: Sequence[str], rows: Iterable[tuple[Cell, ...]]) -> Table:
    """Make a table of columns whose headers hold their units, as in "speed_rad_s"."""
    columns = tuple(NumberColumn(name=header, heading=header) for header in headers)
    return Table(name=name, columns=columns, rows=tuple(rows))


def steady_table(results: StudyResults) -> Table:
    """The steady map."""
    steady = results.range.steady_map
    rows = tuple(
        (float(angle), trim.output("engine_speed"), trim.state("manifold_pressure"), "yes" if trim.stable else "no")
        for angle, trim in zip(steady.values, steady.trims, strict=True)
    )
    return make_table("steady_map", ("throttle_deg", "engine_speed_rad_s", "manifold_pressure_kpa", "stable"), rows)


def response_table(config: StudyConfig, results: StudyResults) -> Table:
    """The frequency response by all methods, beside Table 4.1 where it is the thesis's."""
    stream, exact = results.response, results.point.exact
    columns = ["frequency_rad_s", "peaks_amplitude_rad_s", "peaks_phase_deg", "fourier_amplitude_rad_s", "fourier_phase_deg"]
    columns += ["exact_amplitude_rad_s", "exact_phase_deg", "distortion_1", "mean_speed_rad_s"]
    arrays = [stream.omega, stream.peak_amplitude, stream.peaks.phase_deg, stream.amplitude, stream.phase_deg]
    arrays += [exact.magnitude * config.amplitude_deg, exact.phase_deg, stream.distortion, stream.mean]
    if config.has_the_frequencies_of_table_4_1:
        columns += ["table_4_1_amplitude_rad_s", "table_4_1_phase_deg"]
        arrays += [
            np.array([r["speed_amplitude_rad_s"] for r in read_table_4_1()]),
            -np.array([r["phase_lag_deg"] for r in read_table_4_1()]),
        ]
    return _table("frequency_response", tuple(columns), arrays)


def _spectrum_table(omega: float, frequencies: np.ndarray, amplitude: np.ndarray) -> Table:
    shown = frequencies <= 12.0 * omega
    return _table(f"spectrum_{omega:g}_rad_s", ("frequency_rad_s", "amplitude_rad_s"), (frequencies[shown], amplitude[shown]))


def models_table(name: str, models: ModelsResult) -> Table:
    """Coefficients, delay, errors and verdict of all models; coefficients in ascending powers of s."""
    width = max(len(named.fit.model.denominator) for named in models.fits)
    columns = ("model", "numerator_0_rad_s_deg", "numerator_1_rad_deg", *(f"denominator_{k}_s{k}" for k in range(width)))
    columns += ("delay_s", "largest_magnitude_error_db", "largest_phase_error_deg", "verdict")
    rows: list[tuple[Cell, ...]] = []
    for named, verdict in zip(models.fits, models.verdicts, strict=True):
        model = named.fit.model
        numerator = (*model.numerator, 0.0)[:2]
        denominator = (*model.denominator, *[0.0] * width)[:width]
        errors = (named.fit.max_magnitude_error_db, named.fit.max_phase_error_deg)
        rows.append((title(named.name), *numerator, *denominator, model.delay, *errors, verdict.text))
    return make_table(name, columns, tuple(rows))


def controllers_table(results: StudyResults) -> Table:
    """Gains and where they come from."""
    rows = tuple((name, g.kp, g.ki, g.kd, g.rule, g.designed_on) for name, g in results.controllers.gains.items())
    columns = ("controller", "kp_deg_s_rad", "ki_deg_rad", "kd_deg_s2_rad", "rule", "designed_on")
    return make_table("controllers", columns, rows)


def loops_table(results: StudyResults) -> Table:
    """How each closed loop ends; numbers that a loop does not have are left empty."""
    columns = (
        "controller",
        "plant",
        "outcome",
        "overshoot_1",
        "bandwidth_rad_s",
        "cycle_low_rad_s",
        "cycle_high_rad_s",
        "cycle_period_s",
        "text",
    )
    return make_table("closed_loops", columns, tuple(_loop_cells(row) for row in results.loops.rows))


def _loop_cells(row: LoopRow) -> tuple[Cell, ...]:
    outcome = row.run.outcome
    cycle: tuple[Cell, ...] = (outcome.low, outcome.high, outcome.period) if isinstance(outcome, LimitCycle) else (None, None, None)
    overshoot: Cell = row.run.overshoot if outcome.name in {"settled", "limit-cycle"} else None
    bandwidth: Cell = row.bandwidth if row.bandwidth > 0.0 else None
    return (row.controller, row.plant, outcome.name, overshoot, bandwidth, *cycle, describe_outcome(row.run))


def margins_table(results: StudyResults) -> Table:
    """Margins of every loop; those that a loop does not have are left empty."""
    columns = ("controller", "plant", "stable", "gain_margin_1", "phase_margin_deg", "delay_margin_s", "ms_1", "mt_1", "disk_margin_1")
    rows: list[tuple[Cell, ...]] = []
    for row in results.stability.margins:
        found = row.margins
        rise: Cell = None if found.gain_rise is None else found.gain_rise.gain_margin
        phase: Cell = None if found.phase is None else found.phase.phase_margin_deg
        delay: Cell = None if found.delay is None else found.delay.delay_margin
        peaks = (found.sensitivity.value, found.complementary.value, found.disk_margin)
        rows.append((row.controller, row.plant, "yes" if found.stable else "no", rise, phase, delay, *peaks))
    return make_table("margins", columns, tuple(rows))


def region_table(row: RegionRow) -> Table:
    """Boundary of the gains that stabilise one plant at one kd, by rising frequency."""
    name = f"gain_region_{row.plant}_kd_{row.kd:.3g}".replace("-", "_")
    return _table(name, ("frequency_rad_s", "kp_deg_s_rad", "ki_deg_rad"), (row.omega, row.kp, row.ki))


def rivals_table(results: StudyResults) -> Table:
    """Controllers and rules beside the optimum of their form."""
    errors = ("controller", "ms_1", "setpoint_iae_s", "load_iae_rad_per_n_m", "optimum_load_iae_rad_per_n_m", "ratio_1")
    gains = ("optimum_kp_deg_s_rad", "optimum_ki_deg_rad", "optimum_kd_deg_s2_rad", "optimum_ms_1")
    rows = tuple(
        (
            one.name,
            float(one.cost.sensitivity.max()),
            one.cost.setpoint,
            one.cost.load,
            one.optimum.cost,
            one.ratio,
            *one.optimum.terms[:3],
            one.margins.sensitivity.value,
        )
        for one in results.rivals.compared.competitors
    )
    return make_table("optimum_comparison", errors + gains, rows)


def schedule_table(found: ScheduleResult) -> Table:
    """Gains at the nodes of the schedule."""
    table = found.schedule
    columns = ("engine_speed_rad_s", "load_torque_n_m", "kp_deg_s_rad", "ki_deg_rad", "kd_deg_s2_rad")
    rows = tuple(
        (float(a), float(b), float(table.kp[i, j]), float(table.ki[i, j]), float(table.kd[i, j]))
        for i, a in enumerate(table.first)
        for j, b in enumerate(table.second)
    )
    return make_table("gain_schedule", columns, rows)


def trials_table(results: StudyResults) -> Table:
    """The worst of all runs of each controller at each operating point; what was not measured is left empty."""
    judged = ("controller", "throttle_deg", "load_n_m", "ms_1", "gain_reserve_db", "largest_overshoot_1", "longest_settling_s")
    others = ("largest_droop_rad_s", "runs_1", "runs_that_ended_early_1")
    rows: list[tuple[Cell, ...]] = []
    for trial in results.trials.trials:
        for place in trial.summary.places:
            settling = float(place.settling.max()) if place.kinds else math.inf
            measured: tuple[Cell, ...] = (None, None, None)
            if place.kinds:
                measured = (float(place.overshoot.max()), settling if math.isfinite(settling) else None, float(place.droop.max()))
            ms, reserve = (values[0] if values else None for values in (place.ms, place.reserve_db))
            values = (value for _, value in place.place)
            rows.append((trial.name, *values, ms, reserve, *measured, float(len(place.kinds) + place.ended), float(place.ended)))
    return make_table("acceptance", judged + others, rows)
