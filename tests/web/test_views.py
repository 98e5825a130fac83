"""Views of states: a part that fails leaves the others whole, and the words say what is true."""

import json
import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from revline.web.answers import LIVE, answer
from revline.web.parameters import THESIS
from revline.web.plants import find_point, fit_model, place_of
from revline.web.state import State, parse_state
from revline.web.view import build
from revline.web.view.build import PARTS, make_view
from revline.web.view.drawing import drawn, thin
from tests.web.viewing import view


def test_slow_parts_are_found_too() -> None:
    c1 = dict(zip(("kp", "ki", "kd"), THESIS[0][1:4], strict=True))
    found = view({**c1, "command_rad_s": 60.0}, "contours", "peaks", "cycle", "roots")
    assert [one["ms"] for one in found["contours"]["contours"]] == [1.4, 2.0, 3.0]
    assert all(one["largest_deviation"] < 1e-3 for one in found["contours"]["contours"])
    assert found["peaks"]["magnitude_db"][0] == pytest.approx(21.4, abs=0.2)
    assert found["cycle"]["limit_cycle"]["low_rad_s"] == pytest.approx(291.14, abs=0.02)
    assert found["cycle"]["agreement"]["largest_difference"] < found["cycle"]["agreement"]["tolerance"]
    assert len(found["roots"]["models"]["g2"]["closed"]) == 3


def test_a_part_that_fails_leaves_the_others_whole() -> None:
    found = view({"amplitude_deg": 40.0}, *LIVE)
    assert found["models"]["problem"]["control"] == "amplitude_deg"
    assert found["models"]["problem"]["detail"].startswith("amplitude_deg = 40 deg is outside 0 to 25 deg")
    assert found["response"]["harmonic_balance"]["problem"]["status"] == 422
    assert found["response"]["exact"]["magnitude_db"]
    assert found["margins"]["stable"] is True
    assert found["words"]["verdict"].startswith("stable, gain margin 3.5 dB")


def test_a_sinusoid_that_stalls_the_engine_is_answered_in_part_and_the_amplitude_that_would_do_is_told() -> None:
    response = view({"throttle_deg": 10.0, "amplitude_deg": 9.0}, "response")["response"]
    note = next(note for note in response["harmonic_balance"]["notes"] if "; missing: " in note)
    found = re.match(
        r"15 of 42 frequencies are finished with 9 deg, each of them has an answer up to (\d\.\d+) deg; missing: 0.01 rad/s", note
    )
    assert found is not None
    whole = view({"throttle_deg": 10.0, "amplitude_deg": float(found[1])}, "response")["response"]["harmonic_balance"]
    assert len(whole["frequency_rad_s"]) == 42


@pytest.mark.parametrize(
    ("entries", "control", "words"),
    [
        ({"throttle_deg": 2.0}, "throttle_deg", "no trim at throttle = 2 deg"),
        ({"speed_rad_s": 1400.0}, "speed_rad_s", "no trim at engine_speed = 1400 rad/s"),
        ({"parameters": {"rotation.inertia": 0.0}}, "parameters.rotation.inertia", "rotation.inertia = 0 kg m2 is outside"),
    ],
)
def test_without_an_operating_point_each_part_says_why(entries: dict[str, Any], control: str, words: str) -> None:
    found = view(entries, *LIVE)
    for name in LIVE:
        if name != "words":
            assert words in found[name]["problem"]["detail"]
            assert found[name]["problem"]["control"] == control
    assert found["words"]["verdict"].startswith("no operating point: ")


@pytest.mark.parametrize(
    ("entries", "control", "words"),
    [
        ({"command_rad_s": 0.0}, "command_rad_s", "command_rad_s = 0 rad/s moves nothing"),
        ({"step": "load", "load_step_n_m": 0.0}, "load_step_n_m", "load_step_n_m = 0 N m moves nothing"),
        ({"step": "throttle", "throttle_step_deg": 80.0}, "throttle_step_deg", "leads from 25 deg to 105 deg"),
        ({"low_deg": 50.0, "high_deg": 40.0}, "low_deg", "low_deg = 50 deg is not below high_deg = 40 deg"),
    ],
)
def test_a_step_that_cannot_be_names_its_control(entries: dict[str, Any], control: str, words: str) -> None:
    problem = view(entries, "loop")["loop"]["problem"]
    assert words in problem["detail"]
    assert problem["control"] == control


def controller(k: int) -> dict[str, float]:
    return dict(zip(("kp", "ki", "kd"), THESIS[k][1:4], strict=True))


BLIND = "the second-order model without delay would not have told you"
HUNTS = (
    "unstable, by a gain 4.8 dB too high; the engine hunts between 291.1 and 310.1 rad/s, every 0.209 s; "
    "the first-order model and the second-order model without delay would have called it stable"
)
HUNTS_FASTER = (
    "unstable, by a gain 13.8 dB too high; the engine hunts between 292.2 and 306.9 rad/s, every 0.132 s; "
    "the second-order model without delay would have called it stable"
)


@pytest.mark.parametrize(
    ("k", "entries", "verdict"),
    [
        (2, {"command_rad_s": 60.0}, f"stable, gain margin 3.5 dB, Ms 3.26; {BLIND}"),
        (0, {"command_rad_s": 60.0}, HUNTS),
        (1, {"command_rad_s": 60.0}, HUNTS_FASTER),
        (
            2,
            {"kp": 0.3, "ki": 0.5, "kd": 0.0, "command_rad_s": 700.0, "until_s": 20.0},
            "stable, gain margin 16.2 dB, Ms 1.40; the engine rests 116 rad/s off its target",
        ),
        (2, {"kp": 0.3, "ki": 0.5, "kd": 0.0, "command_rad_s": -239.0}, "stable, gain margin 16.2 dB, Ms 1.40; the engine stalls"),
    ],
)
def test_the_line_says_what_is_true(k: int, entries: dict[str, Any], verdict: str) -> None:
    """The thesis's C2d, C1 and C2, a throttle at its limit, and an engine that stalls."""
    assert view({**controller(k), **entries}, "words")["words"]["verdict"].startswith(verdict)


def test_load_and_throttle_steps_are_answered() -> None:
    load = view({"step": "load", "load_step_n_m": 5.0, "kp": 0.4, "ki": 1.0, "kd": 0.0}, "loop", "answers", "words")
    assert 0.5 < load["loop"]["droop_rad_s"] < 20.0
    assert abs(load["loop"]["end_error_rad_s"]) < 0.2 * load["loop"]["droop_rad_s"]
    assert load["answers"] == {}
    assert any("After the load's step" in line for line in load["words"]["lines"])
    step = view({"step": "throttle", "throttle_step_deg": 5.0}, "loop", "answers")
    end = step["loop"]["speed_rad_s"][-1]
    assert end == pytest.approx(301.2, abs=1.0)
    assert step["answers"]["g2d"]["speed_rad_s"][-1] == pytest.approx(end, rel=0.02)


def test_a_load_that_stalls_hunts_or_goes_on_is_said_to() -> None:
    """An engine that stalls, one whose fall is not over, and gains that hunt: words and measures say so, and claim no more."""
    gains = {"step": "load", "kp": 1.2, "ki": 2.0, "kd": 0.1}
    stalled = view({**gains, "load_step_n_m": 400.0, "until_s": 10.0}, "loop", "words")
    assert re.fullmatch(r"stalls after 0\.\d+ s, at engine speed \d+\.?\d* rad/s", stalled["loop"]["ended"])
    assert "iae_rad" not in stalled["loop"]
    assert f"; the engine {stalled['loop']['ended']}" in stalled["words"]["verdict"]
    assert any(line.startswith("The run ended early. Stalled: lee1995 with pid at t = 0.") for line in stalled["words"]["lines"])
    assert any("as far as it is shown" in line for line in stalled["words"]["lines"])
    falling = view({**gains, "load_step_n_m": 100.0}, "loop", "words")
    assert falling["loop"]["still_moving"] is True
    assert falling["loop"]["saturated_share"] > 0.5
    assert "still moves away at the end" in falling["words"]["verdict"]
    hunting = view({**gains, "kp": 20.0, "ki": 98.0, "kd": 0.4, "until_s": 10.0}, "loop", "words")
    assert hunting["loop"]["outcome"] == "limit-cycle"
    assert "the engine hunts between" in hunting["words"]["verdict"]
    calm = view({**gains, "until_s": 10.0}, "loop")["loop"]
    assert calm["outcome"] == "settled"
    assert calm["iae_rad"] > 0.5 * calm["droop_rad_s"] * calm["droop_at_s"]


def test_an_engine_that_rests_later_than_is_shown_is_said_to() -> None:
    """After a command beyond its reach for a while: what is shown ends far above the target."""
    short, long = (view({"command_rad_s": 500.0, "until_s": until}, "loop", "words")["words"]["verdict"] for until in (4.0, 8.0))
    assert "the engine comes to rest after 5.72 s, later than is shown" in short
    assert "later than is shown" not in long


def test_what_a_model_answers_does_not_depend_on_the_time_shown() -> None:
    gains = {"kp": 20.0, "ki": 400.0, "kd": 0.05}
    short, long = (view({**gains, "until_s": until}, "answers")["answers"]["g2"]["overshoot"] for until in (4.0, 20.0))
    assert short == pytest.approx(long, rel=2e-3)
    assert "overshoot" not in view({"until_s": 0.1}, "answers")["answers"]["g2d"]


def test_short_lags_are_run_in_short_steps() -> None:
    state = {"step": "load", "parameters": {"delays.spark_to_torque": 0.2}}
    assert "problem" not in view(state, "loop")["loop"]
    undecided = view({"until_s": 0.1, "parameters": {"delays.spark_to_torque": 0.2}}, "loop")["loop"]
    assert "problem" not in undecided


def test_an_engine_that_stalls_without_a_controller_is_shown_until_then() -> None:
    found = view({"step": "throttle", "throttle_step_deg": -24.0}, "loop", "words")
    assert "stalls after" in found["loop"]["ended"]
    assert 0.5 < found["loop"]["time_s"][-1] < 1.3
    assert found["words"]["verdict"].startswith("with the controller stable")
    assert "; the engine stalls after" in found["words"]["verdict"]
    assert len(found["words"]["verdict"]) < 200


def test_where_the_throttle_moves_nothing_its_control_is_named() -> None:
    """Beyond saturation, at the end of the throttle's way, and where only the models lack room."""
    for entries, control, words in (
        ({"throttle_deg": 89.0, "amplitude_deg": 0.5}, "throttle_deg", "at 89 deg the air no longer follows the throttle"),
        ({"throttle_deg": 90.0}, "throttle_deg", "at 90 deg the air no longer follows the throttle"),
    ):
        found = view(entries, "response", "gains", "margins", "loop_roots", "contours", "words")
        for part in (found["response"]["exact"], found["gains"], found["margins"], found["loop_roots"], found["contours"]):
            assert part["problem"]["control"] == control
            assert words in part["problem"]["detail"]
        assert words in found["words"]["verdict"]
    found = view({"throttle_deg": 90.0}, "models", "promises", "answers")
    assert all("no room for a sinusoid" in part["problem"]["detail"] for part in found.values())
    assert all(part["problem"]["control"] == "throttle_deg" for part in found.values())
    for part in view({"amplitude_deg": 40.0}, "promises", "answers").values():
        assert part["problem"]["control"] == "amplitude_deg"


def test_a_limit_near_by_and_a_kink_are_told() -> None:
    near = view({"throttle_deg": 79.46, "amplitude_deg": 20.0}, "validity", "words")
    assert near["validity"]["warnings"][0].startswith("a limit of rate of manifold_pressure begins near by, at throttle = 79.5569 deg")
    assert "kink" not in near["words"]["verdict"]
    at = view({"throttle_deg": 79.556871893, "amplitude_deg": 20.0}, "words")["words"]
    assert at["verdict"].endswith("the engine has a kink here, and a linear model holds on one side of it alone")
    assert any("has a kink in throttle here" in line for line in at["lines"])
    assert view({}, "validity")["validity"] == {"warnings": []}


def test_without_control_the_loop_is_the_engine_alone() -> None:
    state = {"kp": 0.0, "ki": 0.0, "kd": 0.0}
    found = view(state, "margins", "loop_roots", "roots", "promises", "words")
    assert found["loop_roots"]["roots_rad_s"] == found["roots"]["plant"]
    assert found["roots"]["models"]["g2d"]["closed"] == found["roots"]["models"]["g2d"]["poles"]
    assert found["promises"] == {}
    assert found["margins"]["no_control"] is True
    gentle, loaded = (view({"load_n_m": load}, "point")["point"]["speed_rad_s"] for load in (-0.05, 0.05))
    assert found["margins"]["load_gain_rad_s_per_n_m"] == pytest.approx((loaded - gentle) / 0.1, rel=1e-3)
    assert found["words"]["verdict"].startswith("no control: kp, ki and kd are 0, so that the engine runs alone, stable by itself")
    assert "Left alone it comes to rest with a time constant of 0.48 s." in found["words"]["lines"]
    unstable = view({**state, "throttle_deg": 4.6}, "words")["words"]["verdict"]
    assert "the engine alone is unstable here" in unstable


def test_roots_of_the_loops_solve_their_equations() -> None:
    """Each root of the exact loop and of the delayed model's makes 1 + L vanish; C1 has a pair right of the axis, as its margins say."""
    state = parse_state(dict(zip(("kp", "ki", "kd"), THESIS[0][1:4], strict=True)))
    found = view(state.model_dump(exclude_none=True), "loop_roots", "roots", "margins")
    point = find_point(place_of(state))
    model = fit_model(place_of(state), state.amplitude_deg, "g2d").fit.model

    def law(s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(state.kp + state.ki / s + state.kd * s)

    exact = np.array([complex(*pair) for pair in found["loop_roots"]["roots_rad_s"]])
    fitted = np.array([complex(*pair) for pair in found["roots"]["models"]["g2d"]["closed"]])
    row, column = (
        [v.name for v in signals].index(name)
        for signals, name in ((point.linear.model.outputs, "engine_speed"), (point.linear.model.inputs, "throttle"))
    )
    assert np.max(np.abs(1.0 + point.linear.model.transfer(exact)[:, row, column] * law(exact))) < 1e-8
    assert np.max(np.abs(1.0 + model(fitted) * law(fitted))) < 1e-8
    assert int(np.sum(exact.real > 0.0)) == 2
    assert found["margins"]["stable"] is False


def test_limits_that_exclude_the_point_name_their_control() -> None:
    for entries, control in (
        ({"low_deg": 30.0, "high_deg": 40.0}, "low_deg"),
        ({"high_deg": 20.0}, "high_deg"),
        ({"throttle_deg": 85.0}, "throttle_deg"),
    ):
        problem = view(entries, "loop")["loop"]["problem"]
        assert problem["control"] == control
        assert "the throttle rests at" in problem["detail"]


def test_a_part_without_memory_leaves_the_others_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    def hoard(_: State) -> Any:
        raise MemoryError

    monkeypatch.setattr(build, "PARTS", {**build.PARTS, "cycle": hoard})
    found = make_view(parse_state({}), ["cycle", "point"])["parts"]
    assert found["cycle"]["problem"]["type"] == "/problems/out-of-memory"
    assert found["point"]["stable"] is True


def test_series_are_thinned_without_losing_an_extreme() -> None:
    times = np.linspace(0.0, 1.0, 10_001)
    spike = np.zeros(times.size)
    spike[7_777] = 3.0
    kept, values, other = thin(times, np.sin(40.0 * times), spike, most=200)
    assert kept.size <= 200
    assert (kept[0], kept[-1]) == (0.0, 1.0)
    assert other.max() == 3.0
    assert values.max() == pytest.approx(1.0, abs=1e-6)
    assert np.all(np.diff(kept) > 0.0)
    assert drawn([1.23456789e-5, 0.0, -123456789.0, 1e300]) == [1.234568e-05, 0.0, -123456800.0, 1e300]


def test_questions_that_are_none_are_refused() -> None:
    for body, words in (
        (b"{", "the request is no JSON"),
        (b"[]", "the request is a JSON list; send an object"),
        (b'{"state": {"kp": NaN}}', "NaN is no JSON number"),
        (b'{"parts": ["nix"]}', "a view has no part 'nix'"),
        (b"[" * 100_000, "the request is no JSON"),
    ):
        found = answer("view", body)
        assert found.status == 422
        assert words in json.loads(found.body)["detail"]
        assert json.loads(found.body)["exit_status"] == 2


def test_a_view_names_every_part() -> None:
    assert set(LIVE) - {"words"} <= set(PARTS)
    assert make_view(parse_state({}), [])["parts"] == {}


def test_a_load_s_step_that_is_nearly_over_is_judged_by_what_comes_after_the_time_shown() -> None:
    """After 4 s the speed still creeps by a thousandth of its droop: a longer run says that it settles, as one of 8 s shown does."""
    short, long = (view({"step": "load", "load_step_n_m": 10.0, "until_s": until}, "loop")["loop"] for until in (4.0, 8.0))
    assert (short["outcome"], long["outcome"]) == ("settled", "settled")
    assert short["time_s"][-1] == pytest.approx(4.0)
    assert short["droop_rad_s"] == long["droop_rad_s"]
    assert short["iae_rad"] == pytest.approx(long["iae_rad"], rel=1e-3)
