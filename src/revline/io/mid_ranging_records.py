"""Mid-ranging designs and their load steps as records for JSON, in words, and as CSV."""

from collections.abc import Mapping

from revline.design.two_inputs.load_steps import LoadStepRun, StalledRun
from revline.design.two_inputs.mid_ranging_comparison import MidRangingComparison, PlantComparison
from revline.design.two_inputs.mid_ranging_margins import MidRangingMargins
from revline.io.csv_text import format_csv
from revline.io.margin_records import margin_fields
from revline.system import Floats

SCHEMA = "revline.mid-ranging/1"
Run = LoadStepRun | StalledRun


def mid_ranging_record(found: MidRangingComparison) -> Mapping[str, object]:
    """Give a design and its load steps as a record for engine signals, deg, rad/s, N m and s; what does not exist is left out."""
    design, reserve = found.design, found.design.reserve
    gains, alone, sign = design.gains, design.alone, design.reserve.sign
    return {
        "schema": SCHEMA,
        "ms_bound": design.bounds.ms,
        "fast_share": design.bounds.fast_share,
        "separation_bound": design.bounds.separation,
        "limited_by": design.limiting,
        "resolution": design.resolution,
        "operating_point": {
            "throttle_deg": found.slow_range.rest,
            "spark_deg": reserve.rest,
            "speed_rad_s": _speed(found),
            "lags_s": design.linear.model.lags.tolist(),
            "residual": design.linear.residual,
        },
        "spark": {
            "gain_n_m_per_deg": reserve.gain,
            "best_deg": reserve.best,
            "range_deg": list(reserve.range),
            "limits_deg": [found.fast_range.low, found.fast_range.high],
            "torque_n_m": reserve.value,
            "reserve_n_m": reserve.reserve,
        },
        "controller": {
            "kp_deg_per_rad_s": sign * gains.kp,
            "ki_deg_per_rad": sign * gains.ki,
            "slow_kp": sign * gains.slow_kp,
            "slow_ki_per_s": sign * gains.slow_ki,
            "slow_kd_deg_s2_per_rad": gains.slow_kd,
        },
        "throttle_alone": {"kp": alone.kp, "ki": alone.ki, "kd": alone.kd},
        "load_step_n_m": found.task.size,
        "until_s": found.task.until,
        "plants": [plant_fields(entry) for entry in found.plants],
        "warnings": list(found.all_warnings()),
    }


def _speed(found: MidRangingComparison) -> float:
    design = found.design
    names = [variable.name for variable in design.linear.system.states]
    return float(design.linear.arguments[names.index(design.signals.measurement)])


def plant_fields(entry: PlantComparison) -> dict[str, object]:
    """Give margins and runs on one plant as fields of a record."""
    return {
        "name": entry.name,
        "stable": entry.margins.stable,
        "margins": {_key(name): margin_fields(loop) for name, loop in entry.margins.loops.items()},
        "two_input_disk_margin": entry.margins.disk.margin,
        "two_input_disk_frequency_rad_s": entry.margins.disk.frequency,
        "fast_crossover_rad_s": entry.margins.fast_crossover,
        "slow_crossover_rad_s": entry.margins.slow_crossover,
        "spectral_abscissa": entry.margins.roots.spectral_abscissa,
        "disagreement": entry.margins.disagreement,
        "mid_ranging": run_fields(entry.both),
        "throttle_alone": run_fields(entry.alone),
    }


def _key(name: str) -> str:
    return name.replace(" ", "_")


def run_fields(run: Run) -> dict[str, object]:
    """Give what a load step is judged by as fields of a record."""
    if isinstance(run, StalledRun):
        return {"outcome": "stalled", "stalled_s": run.stalled.time, "stalled_state": run.stalled.state}
    record: dict[str, object] = {
        "outcome": "recorded",
        "droop_rad_s": run.droop,
        "droop_time_s": run.droop_time,
        "rebound_rad_s": run.rebound,
        "iae_rad": run.integrated_error,
        "spark_travel_deg": run.fast_travel,
        "throttle_travel_deg": run.slow_travel,
        "spark_off_set_point_deg": run.fast_left,
        "reserve_used": run.reserve_used,
        "spark_saturated_share": run.fast_saturated,
        "throttle_saturated_share": run.slow_saturated,
        "time_step_s": run.step,
        "step_difference": run.difference,
    }
    if run.settling_time is not None:
        record["settling_time_s"] = run.settling_time
    if run.return_time is not None:
        record["spark_return_time_s"] = run.return_time
    return record


def describe_design(found: MidRangingComparison) -> list[tuple[str, float | str, str]]:
    """Give the design as rows of name, value and unit, for people."""
    reserve, gains, alone = found.design.reserve, found.design.gains, found.design.alone
    sign, margins = reserve.sign, found.own.margins
    rows: list[tuple[str, float | str, str]] = [
        ("speed", _speed(found), "rad/s"),
        ("torque per spark", reserve.gain, f"{reserve.quantity_unit}/{reserve.unit}"),
        ("torque reserve of the spark", reserve.reserve, reserve.quantity_unit),
        ("spark limits", f"{found.fast_range.low:.4g} to {found.fast_range.high:.4g}", reserve.unit),
        ("spark by speed: kp, ki", f"{sign * gains.kp:.5g}, {sign * gains.ki:.5g}", "deg/(rad/s), /s"),
        ("throttle by spark: kp, ki", f"{sign * gains.slow_kp:.5g}, {sign * gains.slow_ki:.5g}", "deg/deg, /s"),
        ("throttle by acceleration: kd", gains.slow_kd, "deg/(rad/s2)"),
        ("throttle alone: kp, ki, kd", f"{alone.kp:.5g}, {alone.ki:.5g}, {alone.kd:.5g}", "deg/(rad/s), /s, s"),
        ("crossovers, fast and slow", f"{margins.fast_crossover:.4g}, {margins.slow_crossover:.4g}", "rad/s"),
        ("what a quicker slow loop breaks", found.design.limiting, ""),
    ]
    return rows


def describe_margins_of(margins: MidRangingMargins) -> list[tuple[str, float, float | str, float | str]]:
    """Give margins by where the loop is broken: place, Ms, gain margin in dB, delay margin in ms."""
    rows: list[tuple[str, float, float | str, float | str]] = []
    for name, loop in margins.loops.items():
        rise, delay = loop.gain_rise, loop.delay
        rows.append(
            (
                name,
                loop.sensitivity.value,
                "none" if rise is None else f"{rise.gain_margin_db:.2f}",
                "none" if delay is None else f"{1e3 * delay.delay_margin:.1f}",
            )
        )
    return rows


def describe_runs(found: MidRangingComparison) -> list[tuple[str, ...]]:
    """Give all runs as rows of text: plant, controller and measures."""
    rows: list[tuple[str, ...]] = []
    for plant in found.plants:
        for run in plant.runs:
            if isinstance(run, StalledRun):
                rows.append((plant.name, run.name, f"stalls at {run.stalled.time:.3g} s", *[""] * 6))
                continue
            rows.append(
                (
                    plant.name,
                    run.name,
                    f"{run.droop:.3f}",
                    f"{run.integrated_error:.3f}",
                    _seconds(run.settling_time),
                    f"{run.fast_travel:.1f}",
                    _seconds(run.return_time),
                    f"{100.0 * run.reserve_used:.0f}",
                    f"{100.0 * run.fast_saturated:.2g}",
                )
            )
    return rows


def _seconds(value: float | None) -> str:
    return "not by the end" if value is None else f"{value:.2f}"


def mid_ranging_csv(found: MidRangingComparison) -> str:
    """Format the runs on the design's own plant as CSV; a run that stalled has no columns, and a comment says so."""
    columns: list[tuple[str, Floats]] = []
    notes: dict[str, str | float] = {"schema": SCHEMA, "load_step_n_m": found.task.size}
    for key, run in (("mid_ranging", found.own.both), ("throttle_alone", found.own.alone)):
        if isinstance(run, StalledRun):
            notes[key] = f"stalls at {run.stalled.time:.6g} s"
            continue
        if not columns:
            columns.append(("time_s", run.times))
        columns += [
            (f"{key}_engine_speed_rad_s", run.measurement),
            (f"{key}_spark_deg", run.fast),
            (f"{key}_throttle_deg", run.slow),
            (f"{key}_spark_wanted_deg", run.fast_wanted),
            (f"{key}_throttle_wanted_deg", run.slow_wanted),
        ]
    return format_csv(columns, notes=notes)
