"""A user's own files: what was put in is found again, a planted difference is noticed, and what is no such file is refused."""

import json
import math
import re
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from revline import signals
from revline.analysis.logged_response import estimate_response
from revline.dde.simulate import Options, Start, simulate
from revline.errors import InvalidInputError, NoTrimError
from revline.io.engine_files import format_engine
from revline.lti.sampled_inputs import answer_to_samples
from revline.lti.transfer_function import TransferFunction
from revline.web.answers import answer_file
from revline.web.files.engine_file import read_engine_file
from revline.web.files.log_file import read_log_file
from revline.web.files.response_file import read_response_file
from revline.web.parameters import changed_engine
from revline.web.plants import find_point, place_of
from revline.web.state import State, parse_state

NOISE = 0.05
"""Standard deviation in rad/s of the noise on the logged speed."""

HOLD, RUN, EVERY = 0.25, 120.0, 0.01


@lru_cache(maxsize=4)
def record(inertia: float = 0.1454) -> tuple[Any, Any, Any]:
    """Times, throttle and speed of an engine under random throttle movements of 2 deg about 25 deg, with noise on the speed."""
    draw = np.random.default_rng(7)
    point = find_point(place_of(parse_state({"parameters": {} if inertia == 0.1454 else {"rotation.inertia": inertia}})))
    knots = np.arange(0.0, RUN + HOLD, HOLD)
    moves = np.concatenate(([0.0], draw.choice([-2.0, 2.0], knots.size - 1)))
    start = Start(states=point.trim.states, inputs=point.trim.inputs)
    run = simulate(point.engine, start, {"throttle": signals.recorded(knots, moves)}, until=RUN, step=1e-3, options=Options(every=10))
    return run.times, 25.0 + np.interp(run.times, knots, moves), run.output("engine_speed") + draw.normal(0.0, NOISE, run.times.size)


def log_text(speed_name: str = "engine_speed_rad_s", factor: float = 1.0, **engine: float) -> str:
    lines = [f"time_s,throttle_deg,{speed_name}"]
    lines += [f"{t:.3f},{u:.6f},{factor * y:.6f}" for t, u, y in zip(*record(**engine), strict=True)]
    return "\n".join(lines)


def test_a_log_of_the_engine_itself_is_explained_up_to_its_noise() -> None:
    found = read_log_file(log_text(), "bench.csv", State())
    assert found["engine"]["rms_error_rad_s"] == pytest.approx(NOISE, rel=0.05)
    assert found["notes"] == []
    errors = {name: found["models"][name]["rms_error_rad_s"] for name in ("g1", "g2", "g2d")}
    assert found["engine"]["rms_error_rad_s"] < found["exact"]["rms_error_rad_s"] < errors["g1"]
    assert errors["g2d"] < errors["g1"]
    response = found["response"]
    exact = response["engine"]["exact"]
    assert exact["rms_magnitude_difference_db"] < 0.8
    assert exact["rms_phase_difference_deg"] < 5.0
    assert min(response["coherence"]) >= 0.8
    assert max(response["relative_bias"]) <= 0.1
    assert (response["between_samples"], "write `# between_samples: held`" in response["remark"]) == ("straight", True)
    assert response["between_samples_known"] is False
    assert response["models"]["g2d"]["delay_s"] == pytest.approx(0.021, abs=0.008)


def test_with_a_command_the_response_is_the_engine_s_under_feedback_too() -> None:
    """Here the command moves the throttle alone; without one the page warns of controllers, and two are refused."""
    told, rows = read_log_file(log_text(), "bench.csv", State()), log_text().splitlines()
    angles = [float(row.split(",")[1]) for row in rows[1:]]
    lines = [f"{row},{2300.0 + 10.0 * (angle - 25.0):.6f}" for row, angle in zip(rows[1:], angles, strict=True)]
    text = "\n".join((f"{rows[0]},speed_command_rpm", *lines))
    found = read_log_file(text, "bench.csv", State())["response"]
    assert "log its command too, as speed_command_rad_s" in told["response"]["remark"]
    assert "command" not in found["remark"]
    assert found["magnitude_db"] == pytest.approx(told["response"]["magnitude_db"], abs=1e-3)
    with pytest.raises(InvalidInputError, match=r"speed_command_rad_s and speed_command_rpm for the command; name one"):
        read_log_file("time_s,speed_command_rad_s,speed_command_rpm,throttle_deg,speed_rad_s\n0,1,1,1,1\n", "bench.csv", State())


def test_a_held_throttle_is_played_and_read_as_held() -> None:
    """Read as straight, its steps come half a sample too early, and the response has half a sample more of delay."""
    draw, point = np.random.default_rng(4), find_point(place_of(State()))
    steps = np.repeat(draw.choice([-1.0, 1.0], 400), 3)
    edges = 0.02 * np.arange(1, steps.size)
    jumps = np.column_stack((edges - 1e-4, edges + 1e-4)).ravel()
    course = np.column_stack((steps[:-1], steps[1:])).ravel()
    start = Start(states=point.trim.states, inputs=point.trim.inputs)
    moves = {"throttle": signals.recorded(jumps, course)}
    run = simulate(point.engine, start, moves, until=24.0, step=1e-3, options=Options(every=20))
    rows = "".join(f"{t:.2f},{25.0 + u:.6f},{y:.8f}\n" for t, u, y in zip(run.times, steps, run.output("engine_speed"), strict=False))
    found = {
        kind: read_log_file(f"{kind}time_s,throttle_deg,speed_rad_s\n{rows}", "held.csv", State())
        for kind in ("", "# between_samples: straight\n")
    }
    told, other = found[""], found["# between_samples: straight\n"]
    assert (told["response"]["between_samples"], other["response"]["between_samples"]) == ("held", "straight")
    assert "half a sample" not in told["response"]["remark"]
    assert (told["response"]["between_samples_known"], other["response"]["between_samples_known"]) == (True, True)
    assert told["engine"]["late_rms_error_rad_s"] < 0.25 * other["engine"]["late_rms_error_rad_s"]
    phases = [entry["response"]["engine"]["exact"]["rms_phase_difference_deg"] for entry in (told, other)]
    assert phases[0] < 0.2 * phases[1]
    assert max(told["response"]["relative_bias"]) <= 0.1


def test_an_engine_that_differs_is_noticed() -> None:
    """Negative control: a log of a heavier engine is not explained by the light one, and is by the heavy one."""
    text = log_text(inertia=0.25)
    light = read_log_file(text, "bench.csv", State())
    heavy = read_log_file(text, "bench.csv", parse_state({"parameters": {"rotation.inertia": 0.25}}))
    assert heavy["engine"]["rms_error_rad_s"] == pytest.approx(NOISE, rel=0.05)
    assert light["engine"]["rms_error_rad_s"] > 20.0 * NOISE
    assert light["response"]["engine"]["exact"]["max_magnitude_difference_db"] > 2.0


def test_speeds_in_rpm_are_read_and_a_log_that_begins_elsewhere_says_so() -> None:
    lines = log_text("speed_rpm", 30.0 / math.pi).split("\n")
    found = read_log_file("\n".join([lines[0], *lines[3000:6000]]), "part.csv", State())
    assert found["engine"]["late_rms_error_rad_s"] == pytest.approx(NOISE, rel=0.1)
    assert found["notes"][0].startswith("the log begins at ")
    assert found["duration_s"] == pytest.approx(29.99)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,throttle_deg\n0,25\n1,26\n", "no column for the engine's speed among time_s, throttle_deg"),
        ("time_s,speed_rpm,throttle_deg,speed_rad_s\n0,1,1,1\n", "speed_rad_s and speed_rpm for the engine's speed"),
        ("time_s,throttle_deg,speed_rpm\n0,25,900\n0,25,900\n", "line 3, column time_s: 0 s repeats 0 s in line 2"),
        ("time_s,throttle_deg,speed_rpm\n0,25,900\n1,99,900\n", "line 3, column throttle_deg: 99 is outside 0 to 90"),
        ("time_s,throttle_deg,speed_rpm\n0,25,900\n1,9,-900\n", "line 3, column speed_rpm: -900 is outside 0 to 95493; mend"),
        ("time_s,throttle_deg,speed_rpm\n0,25,900\n700,9,900\n", "duration of bad.csv = 700 s is outside 0 to 600 s"),
        ("time_s,throttle_deg,speed_rpm\n0,25,900\n1,25,1e200\n", "line 3, column speed_rpm: 1e+200 is outside 0 to 95493; mend"),
        ("time_s,throttle_deg,speed_rad_s\n0,25,1e200\n1,25,90\n", "line 2, column speed_rad_s: 1e+200 is outside 0 to 10000; mend"),
        ("time_s,throttle_deg,speed_rpm\n0,25,900\n1e200,25,900\n", "line 3, column time_s: 1e+200 is outside -1e+10 to 1e+10; mend"),
        (
            "time_s,throttle_deg,speed_rpm,load_torque_n_m\n0,25,900,0\n1,25,900,-1e200\n",
            "line 3, column load_torque_n_m: -1e+200 is outside -10000 to 10000; mend",
        ),
        (
            "# between_samples: holds\ntime_s,throttle_deg,speed_rpm\n0,25,900\n1,25,900\n",
            "bad.csv: between_samples is 'holds', did you mean held?; write one of held, straight, smooth",
        ),
        ("time_s,throttle_deg,speed_rpm\n0,25,900\n1,x,900\n", "line 3, column throttle_deg: 'x' is no finite number"),
        ("time_s,throttle_deg,speed_rpm\n" + "0,25,900\n" * 200_001, "has 200001 rows; give 200000 at most"),
        ("", "bad.csv is empty"),
        ("\0\1", "is a binary file"),
    ],
)
def test_what_is_no_log_is_refused(text: str, words: str) -> None:
    with pytest.raises(InvalidInputError, match=re.escape(words)):
        read_log_file(text, "bad.csv", State())


def test_a_log_too_short_or_too_still_for_a_response_is_played_all_the_same() -> None:
    short = "time_s,throttle_deg,speed_rad_s\n" + "".join(f"{0.01 * k:.2f},25,240.8\n" for k in range(300))
    found = read_log_file(short, "still.csv", State())
    assert found["engine"]["max_error_rad_s"] < 0.01
    assert "throttle does not move in this record" in found["response"]["problem"]["detail"]


def test_about_an_unstable_point_no_model_is_played() -> None:
    slow = "time_s,throttle_deg,speed_rad_s\n" + "".join(f"{0.01 * k:.2f},4.6,13\n" for k in range(100))
    found = read_log_file(slow, "slow.csv", State())
    assert "open-loop unstable at the log's mean throttle of 4.6 deg" in found["exact"]["problem"]["detail"]
    assert found["models"]["g1"]["problem"]["exit_status"] in {1, 2}
    nowhere = slow.replace(",4.6,", ",1.0,")
    with pytest.raises(NoTrimError, match="no trim at throttle = 1 deg"):
        read_log_file(nowhere, "slow.csv", State())


def test_a_response_of_the_engine_is_that_of_the_engine() -> None:
    omega = np.geomspace(0.3, 60.0, 25)
    exact = find_point(place_of(State())).linear.model.response(omega, "throttle", "engine_speed")
    columns = zip(omega, exact.magnitude_db, exact.phase_deg, strict=True)
    text = "frequency_rad_s,magnitude_db,phase_deg\n" + "".join(f"{w!r},{m!r},{p!r}\n" for w, m, p in columns)
    found = read_response_file(text.replace("np.float64(", "").replace(")", ""), "own.csv", parse_state({"amplitude_deg": 1.0}))
    assert found["engine"]["exact"]["max_magnitude_difference_db"] < 1e-9
    assert found["engine"]["exact"]["max_phase_difference_deg"] < 1e-9
    assert 0.0 < found["engine"]["harmonic_balance"]["max_magnitude_difference_db"] < 0.2
    assert found["models"]["g2d"]["max_phase_error_deg"] < found["models"]["g2"]["max_phase_error_deg"]
    elsewhere = read_response_file(text.replace("np.float64(", "").replace(")", ""), "own.csv", parse_state({"throttle_deg": 40.0}))
    assert elsewhere["engine"]["exact"]["max_magnitude_difference_db"] > 3.0
    nowhere = read_response_file(text.replace("np.float64(", "").replace(")", ""), "own.csv", parse_state({"throttle_deg": 2.0}))
    assert nowhere["engine"]["problem"]["exit_status"] == 1
    assert nowhere["models"]["g1"]["numerator"]


def test_a_response_too_large_is_refused() -> None:
    text = "frequency_hz,magnitude,phase_deg\n" + "".join(f"{k},1,0\n" for k in range(1, 2002))
    with pytest.raises(InvalidInputError, match=r"own\.csv holds 2001 frequencies; give 2000 at most"):
        read_response_file(text, "own.csv", State())


def test_an_engine_file_becomes_a_state() -> None:
    changed = (("friction.viscous", 0.2), ("rotation.inertia", 0.21))
    found = read_engine_file(format_engine(changed_engine("lee1995-generic", changed)), "mine.toml")
    assert found["state"] == {"engine": "lee1995-generic", "parameters": dict(changed)}
    assert found["changes"][0] == {"key": "friction.viscous", "unit": "N m s/rad", "value": 0.2, "built_in": 0.1056}
    assert parse_state(found["state"]).changed == changed
    with pytest.raises(InvalidInputError, match=r"mine.toml, line 1: schema = 'x' cannot be read"):
        read_engine_file('schema = "x"\n', "mine.toml")


def test_an_input_straight_between_samples_is_answered_to_second_order() -> None:
    """Against the closed form of a lag under a ramp: y = t - T + T exp(-t/T)."""
    errors = []
    for step in (0.02, 0.01):
        times = np.arange(0.0, 2.0 + step / 2.0, step)
        answer = TransferFunction(numerator=(1.0,), denominator=(1.0, 0.3)).step_response(times)
        found = answer_to_samples(answer, 5.0 + times)
        errors.append(float(np.max(np.abs(found - (times - 0.3 + 0.3 * np.exp(-times / 0.3))))))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    settled = answer_to_samples([0.0, 0.5, 1.0], [0.0, 1.0, 1.0, 1.0, 1.0])
    assert settled == pytest.approx([0.0, 0.25, 0.75, 1.0, 1.0])


@pytest.mark.parametrize(
    ("kind", "name", "content", "words"),
    [
        ("log", "a.csv", b"\xff\xfe\x00", "a.csv is no text in UTF-8 (byte 0)"),
        ("log", "<script>", b"time_s,throttle_deg\n0,1\n", "log file, line 1: no column for the engine's speed"),
        ("log", "../../etc/passwd", b"", "log file is empty"),
        ("engine", "e.toml", b"x = [", "e.toml is no valid TOML"),
        ("engine", "e.toml", b"a = " + b"[" * 100_000, "e.toml is no valid TOML"),
        ("response", "r.csv", b" " * 5_000_001, "r.csv has 5000001 bytes; give 5000000 at most"),
        ("logs", "r.csv", b"", "there is no kind of file 'logs', did you mean log?"),
    ],
)
def test_files_of_the_wrong_kind_are_problems(kind: str, name: str, content: bytes, words: str) -> None:
    found = answer_file(kind, name, {}, content)
    problem = json.loads(found.body)
    assert (found.status, found.kind, problem["exit_status"]) == (422, "application/problem+json", 2)
    assert words in problem["detail"]


def test_a_file_is_answered_as_json() -> None:
    found = answer_file("engine", "mine.toml", {}, format_engine(changed_engine("lee1995", ())).encode("utf-8-sig"))
    assert found.status == 200
    assert json.loads(found.body)["changes"] == []


def test_a_record_with_a_gap_or_a_still_output_tells_no_response() -> None:
    times = np.arange(0.0, 60.0, 0.01)
    moved = np.sin(3.0 * times)
    cut = (times < 20.0) | (times > 40.0)
    names, units = ("throttle", "engine_speed"), ("deg", "rad/s")
    with pytest.raises(InvalidInputError, match=r"a gap of 20\.\d* s at 19\.99 s, where its samples usually lie 0\.01 s apart"):
        estimate_response(times[cut], moved[cut], 2.0 * moved[cut], names=names, units=units)
    with pytest.raises(InvalidInputError, match="engine_speed does not move in this record"):
        estimate_response(times, moved, np.full(times.size, 240.0), names=names, units=units)
