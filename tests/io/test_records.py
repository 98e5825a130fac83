"""Records of points, fits and loops: that they hold what the results hold, leave out what does not exist, and have a JSON form."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from revline.analysis.linearize import linearize
from revline.analysis.steady_map import find_steady_map
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.fitting.fit import DelayRule, fit_transfer_function
from revline.design.fitting.model_choice import judge_model
from revline.design.loops.closed_loop import Limits, LoopRun, LoopTask, run_linear_loop
from revline.design.loops.load_response import LoadStep
from revline.design.loops.outcome import LimitCycle, Settled, Stalled
from revline.design.plants.loop_signals import operating_point
from revline.engine.lee1995 import lee1995
from revline.io.fit_records import fit_record
from revline.io.json_files import format_json, parse_json
from revline.io.loop_records import bandwidth_fields, format_loop, late_load, loop_record, loop_warnings
from revline.io.model_files import parse_model
from revline.io.point_records import format_map, linearization_record, map_record, trim_record, trim_warnings
from revline.lti.transfer_function import TransferFunction

G2D = TransferFunction(
    numerator=(12.0,),
    denominator=(1.0, 0.55, 0.034),
    delay=0.0213,
    input_name="throttle",
    input_unit="deg",
    output_name="engine_speed",
    output_unit="rad/s",
)
G1 = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55), input_unit="deg", output_unit="rad/s")


def gains(kp: float, ki: float, kd: float = 0.0) -> PidGains:
    return PidGains(kp=kp, ki=ki, kd=kd, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="g")


def as_json(record: Any) -> dict[str, Any]:
    return dict(json.loads(format_json(record)))


def settled() -> LoopRun:
    return run_linear_loop(G1, gains(2.0, 8.0), LoopTask(command=60.0, until=3.0), name="g1")


def test_a_trim_s_record_holds_its_numbers() -> None:
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 5.0})
    model = linearize(engine, trim).model
    record = as_json(trim_record(trim, model))
    assert record["speed_rad_s"] == trim.state("engine_speed")
    assert record["pressure_kpa"] == trim.state("manifold_pressure")
    assert record["gain_rad_s_per_deg"] == model.static_gain("throttle", "engine_speed")
    assert record["outputs"]["indicated_torque"] == {"value": trim.output("indicated_torque"), "unit": "N m"}
    assert complex(*record["rightmost_roots_rad_s"][0]) == trim.roots.roots[0]
    assert record["unstable_roots"] == 2
    assert trim_warnings(trim) == ["open-loop unstable: 2 characteristic roots in the right half-plane"]


def test_other_steady_states_are_in_the_record_and_its_warnings() -> None:
    engine = lee1995()
    high, low = (find_trim(engine, inputs={"throttle": angle}) for angle in (25.0, 5.0))
    trim = replace(high, alternatives=(low,))
    record = as_json(trim_record(trim, linearize(engine, high).model))
    assert record["alternatives"][0]["speed_rad_s"] == low.state("engine_speed")
    assert record["alternatives"][0]["stable"] is False
    assert trim_warnings(trim) == [f"there is another, unstable steady state at {low.state('engine_speed'):.6g} rad/s"]


def test_a_map_s_record_and_table_agree() -> None:
    steady_map = find_steady_map(lee1995(), sweep_input="throttle", values=[5.0, 10.0, 20.0], output="engine_speed")
    record = as_json(map_record(steady_map, load=0.0))
    lines = format_map(steady_map, load=0.0).splitlines()
    assert lines[:2] == ["# engine: lee1995", "# load_n_m: 0.0"]
    for row, line in zip(record["steady_map"], lines[3:], strict=True):
        cells = dict(zip(lines[2].split(","), line.split(","), strict=True))
        assert float(cells["speed_rad_s"]) == row["speed_rad_s"]
        assert float(cells["pressure_kpa"]) == row["pressure_kpa"]
        assert bool(int(cells["stable"])) is row["stable"]


def test_a_linear_model_s_record_gives_its_response_again() -> None:
    engine = lee1995()
    trim = find_trim(engine, inputs={"throttle": 25.0})
    found = linearize(engine, trim)
    record = as_json(linearization_record(found, trim))
    blocks = {name: np.array(record[name]) for name in ("A", "Bu", "Bz", "Cy", "Dyu", "Dyz", "Cz", "Dzu", "Dzz")}
    s = 20j
    decay = np.diag(np.exp(-s * np.array(record["lags_s"])))
    inner = np.block([[s * np.eye(2) - blocks["A"], -blocks["Bz"]], [-decay @ blocks["Cz"], np.eye(2) - decay @ blocks["Dzz"]]])
    solved = np.linalg.solve(inner, np.vstack([blocks["Bu"], decay @ blocks["Dzu"]]))
    value = (blocks["Cy"] @ solved[:2] + blocks["Dyz"] @ solved[2:] + blocks["Dyu"])[0, record["inputs"].index("throttle")]
    assert value == pytest.approx(complex(found.model.response(np.array([20.0]), "throttle", "engine_speed").values[0]), rel=1e-12)


def test_a_fit_s_record_is_a_model_file() -> None:
    fit = fit_transfer_function(G2D.response(np.geomspace(0.1, 100.0, 20)), zeros=0, poles=2, delay=DelayRule.FREE)
    record = fit_record(fit, judge_model(fit), name="g2d", provenance={"program": "test"})
    file = parse_model(parse_json(format_json(record), "test"), name="other")
    assert (file.name, file.model) == ("g2d", fit.model)
    content = as_json(record)
    assert content["max_phase_error_deg"] == fit.max_phase_error_deg
    assert content["verdict"].startswith("accepted, with a delay of 0.0213 s")
    assert content["provenance"]["delay_rule"] == "free"
    assert len(content["numerator_deviation"]) == 1


def test_a_settled_loop_has_overshoot_settling_time_and_bandwidth() -> None:
    run = settled()
    record = as_json({**loop_record(run), **bandwidth_fields(G1, run.gains)})
    measures = run.measures()
    assert (record["outcome"], record["stable"]) == ("settled", True)
    assert record["overshoot"] == run.overshoot
    assert (record["settling_time_s"], record["rise_time_s"]) == (measures.settling_time, measures.rise_time)
    assert record["bandwidth_rad_s"] > 20.0
    assert "limit_cycle" not in record
    assert "throttle_limits_deg" not in record
    assert "bandwidth_rad_s" not in loop_record(run)


def test_a_loop_without_a_band_has_no_bandwidth() -> None:
    weak = run_linear_loop(G1, gains(0.05, 0.0), LoopTask(command=60.0, until=10.0), name="g1")
    assert "bandwidth_rad_s" not in bandwidth_fields(G1, weak.gains)


def test_a_loop_that_rests_off_its_target_or_shows_no_settling_time_warns() -> None:
    run = settled()
    assert loop_warnings(run) == ()
    assert isinstance(run.outcome, Settled)
    off = replace(run, outcome=replace(run.outcome, steady_error=-30.0))
    assert loop_warnings(off) == ("the speed rests 30 rad/s off its target",)
    limited = replace(off, limits=Limits(low=0.0, high=float(run.control[-1])))
    assert loop_warnings(limited) == ("the speed rests 30 rad/s off its target with the throttle at a limit",)
    assert loop_record(limited)["warnings"] == ["the speed rests 30 rad/s off its target with the throttle at a limit"]
    short = run.first_part(0.35)
    assert loop_warnings(short) == ("the record is too short to show a settling time; give a later stop time",)
    assert loop_warnings(replace(run, outcome=Stalled(time=0.4, state="engine_speed", value=0.0))) == ()


def test_a_load_s_step_at_the_end_of_the_record_is_said_to_go_unanswered() -> None:
    run = settled()
    end = float(run.times[-1])
    assert late_load(run, LoadStep(size=5.0, at=0.5 * end)) == ()
    (text,) = late_load(run, LoadStep(size=5.0, at=0.95 * end))
    assert text.startswith(f"only {0.05 * end:.3g} s of the record follow the load's step")
    (text,) = late_load(run, LoadStep(size=5.0, at=2.0 * end))
    assert text.startswith("the record ends before the load's step")


def test_what_does_not_exist_is_left_out() -> None:
    run = settled()
    cycle = LimitCycle(low=1.0, high=2.0, period=0.5, low_spread=0.0, high_spread=0.0, period_spread=0.0, cycles=5, swings=1, drift=0.0)
    record = as_json(loop_record(replace(run, outcome=cycle)))
    assert record["limit_cycle"] == {"low_rad_s": 1.0, "high_rad_s": 2.0, "period_s": 0.5}
    assert "settling_time_s" not in record
    stalled = as_json(loop_record(replace(run, outcome=Stalled(time=0.4, state="engine_speed", value=0.0))))
    assert (stalled["ended_at_s"], stalled["state"], stalled["value"]) == (0.4, "engine_speed", 0.0)
    assert not {"overshoot", "limit_cycle", "settling_time_s"} & set(stalled)
    unstable = run_linear_loop(G2D, gains(5.0, 5.0), LoopTask(command=60.0, until=3.0), name="g2d")
    diverged = as_json({**loop_record(unstable), **bandwidth_fields(G2D, unstable.gains)})
    assert (diverged["stable"], diverged["speed_bound_rad_s"]) == (False, 600.0)
    assert not {"overshoot", "bandwidth_rad_s"} & set(diverged)
    short = run.first_part(0.35)
    assert isinstance(short.outcome, Settled)
    assert "settling_time_s" not in loop_record(short)


def test_a_loop_s_table_has_its_samples() -> None:
    run = settled()
    lines = format_loop(run).splitlines()
    assert lines[0] == "# plant: g1"
    assert f"# form: {run.form}" in lines
    first = lines.index("time_s,speed_rad_s,throttle_deg,proportional_deg,integral_deg,derivative_deg,windup_deg") + 1
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[first:]])
    assert np.array_equal(table, np.column_stack([run.times, run.output, run.control, run.terms, run.windup]))


def test_a_loop_starts_from_a_trim() -> None:
    trim = find_trim(lee1995(), inputs={"throttle": 25.0, "load_torque": 3.0})
    point = operating_point(trim)
    assert point.inputs == {"throttle": 25.0, "air_fuel_ratio": 15.0, "spark": 10.0, "load_torque": 3.0}
    assert point.measurement == trim.output("engine_speed")
    assert np.array_equal(point.states, trim.states)
