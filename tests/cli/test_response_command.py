import json
import math
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from revline.analysis import linearize, phase_turns, turn_check
from revline.analysis.phase_turns import follow_phase
from revline.cli.shell import Shell
from revline.io.response_files import read_response
from revline.lti.state_space import DelayStateSpace
from revline.system import Floats

from .conftest import Command


@pytest.mark.reference
def test_the_exact_response_has_all_its_turns(revline: Command, tmp_path: Path) -> None:
    """Small-signal response at 25 deg: 0.12 % above the 5 deg one at 0.1 rad/s, 1.71 deg more lag at 100 rad/s."""
    path = tmp_path / "exact.csv"
    done = revline("response", "--throttle", 25, "--frequencies", "0.1,100", "--method", "exact", "--out", path, "--json")
    rows = json.loads(done.out)["frequency_response"]
    assert rows[0]["amplitude_rad_s"] == pytest.approx(60.0056 * 1.0012, rel=1e-4)
    assert rows[1]["phase_deg"] == pytest.approx(-295.286 - 1.71, abs=0.02)
    assert read_response(path).response.phase_deg.tolist() == pytest.approx([row["phase_deg"] for row in rows])


@pytest.mark.slow
@pytest.mark.reference
def test_sinusoids_give_the_converged_fundamental_and_a_file_to_fit(revline: Command, tmp_path: Path) -> None:
    """Lee (1995), Table 4.1, converged by harmonic balance."""
    path, wanted = tmp_path / "response.csv", tmp_path / "wanted.csv"
    wanted.write_text("frequency_rad_s\n1\n5\n10\n20\n50\n")
    arguments = ("response", "--throttle", 25, "--amplitude", 5, "--frequencies-file", wanted, "--json")
    rows = json.loads(revline(*arguments, "--method", "fourier", "--out", path).out)["frequency_response"]
    assert [row["amplitude_rad_s"] for row in rows] == pytest.approx([54.0116, 22.0666, 10.8232, 4.4082, 0.9495], rel=1e-4)
    assert [row["phase_deg"] for row in rows] == pytest.approx([-29.874, -87.620, -116.793, -153.450, -218.974], abs=0.01)
    assert rows[1]["distortion"] == pytest.approx(0.037, abs=0.001)
    assert revline("fit", path, "--zeros", 0, "--poles", 2, "--delay", "free", "--out", tmp_path / "model.json").status == 0
    peaks = json.loads(revline(*arguments).out)["frequency_response"]
    assert [row["amplitude_rad_s"] for row in peaks] == pytest.approx([row["amplitude_rad_s"] for row in rows], rel=0.01)
    assert peaks[1]["amplitude_rad_s"] != pytest.approx(rows[1]["amplitude_rad_s"], rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ((), 2, "give either --frequencies"),
        (("--frequencies", "0,1"), 2, "frequency = 0 rad/s is outside"),
        (("--frequencies", "0,1", "--method", "exact"), 2, "frequency = 0 rad/s is outside"),
        (("--frequencies", "-1"), 2, "frequency = -1 rad/s is outside"),
        (("--frequencies", "5,1"), 2, "frequency 1 rad/s follows 5 rad/s"),
        (("--frequencies", "1,1"), 2, "frequency 1 rad/s follows 1 rad/s"),
        (("--frequencies", "1,,2"), 2, "an empty entry is no finite number"),
        (("--frequencies", "1,x"), 2, "'x' is no finite number"),
        (("--frequencies", "1e9"), 2, "frequency = 1e+09 rad/s is outside 0.000628 to 9.61e+05 rad/s"),
        (("--frequencies-file", "absent.csv"), 2, "cannot read absent.csv"),
        (("--frequencies", "1", "--amplitude", 0), 2, "sine amplitude = 0"),
        (("--frequencies", "1", "--amplitude", 70), 2, "goes too far: throttle = -45 deg is outside 0 to 90 deg"),
        (("--frequencies", "1", "--time-step", -1), 2, "--time-step = -1 s is outside"),
        (("--frequencies", "1", "--distortion-limit", 1), 2, "distortion limit = 1 of the fundamental is outside 0 to 1"),
        (("--frequencies", "1", "--out", "absent/r.csv"), 2, "its folder absent does not exist"),
        (("--frequencies", "1", "--load", 500), 1, "no trim at"),
    ],
)
def test_what_response_refuses(arguments: tuple[object, ...], status: int, message: str, revline: Command) -> None:
    done = revline("response", "--throttle", 25, *arguments)
    assert (done.status, done.out) == (status, "")
    assert message in done.err
    assert len(done.err.splitlines()) == 1


def test_an_unstable_trim_answers_no_sinusoid_but_has_an_exact_response(revline: Command) -> None:
    arguments = ("response", "--throttle", 5, "--frequencies", "1", "--amplitude", 0.5)
    done = revline(*arguments)
    assert done.status == 1
    assert "is not open-loop stable" in done.err
    exact = revline(*arguments, "--method", "exact")
    assert exact.status == 0
    assert "warning: the engine is open-loop unstable here" in exact.err


@pytest.mark.parametrize("omega", ["500", "0.1,500"])
def test_an_unstable_trims_exact_response_has_its_turns_wherever_it_begins(revline: Command, tmp_path: Path, omega: str) -> None:
    """At 5 deg: -(5.48 / 16.903) 500 rad of lag of the charge, and what the engine itself turns, less a turn by its unstable pair."""
    path = tmp_path / "exact.csv"
    done = revline("response", "--throttle", 5, "--frequencies", omega, "--method", "exact", "--json", "--out", path)
    phase = json.loads(done.out)["frequency_response"][-1]["phase_deg"]
    assert phase + math.degrees(500.0 * 5.48 / 16.90303) == pytest.approx(180.0, abs=5.0)
    assert read_response(path).response.phase_deg[-1] == pytest.approx(phase, abs=1e-6)


def test_what_the_exact_response_cannot_show_is_said(revline: Command) -> None:
    done = revline("response", "--throttle", 79, "--frequencies", 1, "--method", "exact", "--amplitude", 12)
    assert "warning: the amplitude of 12 deg only scales this response: so large a sinusoid would leave 0 to 90 deg" in done.err
    saturated = 91.06 / 1.14459
    below = revline("response", "--throttle", saturated - 1e-9, "--frequencies", 1, "--method", "exact")
    assert "warning: rate of manifold_pressure has a kink in throttle here" in below.err


def test_the_verdict_on_linearity_stands_below_the_response(revline: Command) -> None:
    arguments = ("response", "--throttle", 25, "--frequencies", "5,20", "--method", "fourier")
    assert "the speed follows the input's frequency from 5 to 20 rad/s" in revline(*arguments).out
    verdict = json.loads(revline(*arguments, "--distortion-limit", 0.03, "--json").out)["linearity"]
    assert (verdict["follows"], verdict["ranges_rad_s"], verdict["largest_at_rad_s"]) == (False, [[20.0, 20.0]], 5.0)
    assert verdict["largest_distortion"] == pytest.approx(0.0366, abs=1e-4)


def test_a_frequency_that_fails_leaves_the_others_and_says_so(revline: Command, tmp_path: Path) -> None:
    """10 +- 5 deg stalls the engine near 2 rad/s, not at 0.5 or 50."""
    path = tmp_path / "part.csv"
    arguments = ("response", "--throttle", 10, "--amplitude", 5, "--frequencies", "0.1,2,50", "--method", "fourier", "--out", path)
    done = revline(*arguments, "--json")
    assert done.status == 1
    record = json.loads(done.out)
    assert [row["frequency_rad_s"] for row in record["frequency_response"]] == [0.1, 50.0]
    assert record["partial"] is True
    assert record["missing"][0]["frequency_rad_s"] == 2.0
    assert "linearity" not in record
    assert "the response is partial: 2 of 3 frequencies are finished; missing: 2 rad/s (under a sinusoid at 2 rad/s: stalled" in done.err
    assert f"{path} holds the finished part" in done.err
    fitted = revline("fit", path, "--zeros", 0, "--poles", 1)
    assert fitted.status == 0
    assert "is partial: 2 of 3 frequencies are finished" in fitted.err


def test_what_an_interruption_finds_finished_is_written(revline: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The dearest frequency, the lowest, runs first; the interruption comes when it is finished."""

    def interrupt(done: float) -> None:
        assert done == pytest.approx(1.0 / 3.0)
        raise KeyboardInterrupt

    monkeypatch.setattr(Shell, "progress", lambda _, text: nullcontext(interrupt if text == "sinusoids" else lambda _: None))
    path = tmp_path / "part.csv"
    done = revline("response", "--throttle", 25, "--frequencies", "0.1,5,50", "--workers", 1, "--method", "fourier", "--out", path)
    assert done.status == 1
    assert "1 of 3 frequencies are finished; missing: 5 rad/s (interrupted); 50 rad/s (interrupted)" in done.err
    assert read_response(path).response.magnitude == pytest.approx([60.00558 / 5.0], rel=1e-6)
    assert "# partial: 1 of 3 frequencies are finished" in path.read_text()


def test_an_interruption_before_anything_is_finished_writes_nothing(
    revline: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("revline.analysis.sinestream.run_until_periodic", interrupt)
    path = tmp_path / "part.csv"
    done = revline("response", "--throttle", 25, "--frequencies", "1,5", "--out", path)
    assert (done.status, path.exists()) == (1, False)
    assert "interrupted" in done.err


@pytest.mark.reference
def test_harmonic_balance_gives_the_converged_response_with_all_that_is_known_of_it(revline: Command, tmp_path: Path) -> None:
    """The engine of Lee (1995) at 25 +- 5 deg, computed twice independently, to the last digit."""
    path = tmp_path / "balanced.csv"
    arguments = ("response", "--throttle", 25, "--frequencies", "0.1,5,100", "--method", "harmonic-balance")
    record = json.loads(revline(*arguments, "--out", path, "--json").out)
    rows = record["frequency_response"]
    assert [row["amplitude_rad_s"] for row in rows] == pytest.approx([60.0056, 22.0666, 0.2535], abs=6e-5)
    assert [row["phase_deg"] for row in rows] == pytest.approx([-3.164, -87.620, -295.286], abs=6e-4)
    assert [row["distortion"] for row in rows] == pytest.approx([0.0017, 0.037, 0.014], abs=5e-4)
    assert [row["mean_shift_rad_s"] + 240.799 for row in rows] == pytest.approx([240.77, 243.02, 243.64], abs=6e-3)
    for row in rows:
        assert len(row["harmonics_rad_s"]) == 8
        assert row["harmonics_rad_s"][0] == pytest.approx(row["amplitude_rad_s"])
        assert 0.0 < row["estimated_error"] < 1e-6
    assert record["linearity"]["follows"] is True
    file = read_response(path)
    assert file.response.method == "harmonic balance"
    assert file.distortion.tolist() == pytest.approx([row["distortion"] for row in rows])


@pytest.mark.parametrize(
    ("method", "check", "routes", "effect"),
    [
        ("exact", None, 1, False),
        ("harmonic-balance", None, 1, True),
        ("harmonic-balance", "full", 2, True),
        ("fourier", None, 2, True),
        ("peaks", "quick", 1, True),
    ],
)
def test_routes_are_compared_as_asked(method: str, check: str | None, routes: int, effect: bool, revline: Command) -> None:  # noqa: FBT001 - a parameter
    arguments = ("response", "--throttle", 25, "--frequencies", "10,50", "--method", method, "--json")
    done = revline(*arguments, *(() if check is None else ("--check", check)))
    assert (done.status, done.err) == (0, "")
    found = json.loads(done.out)["cross_check"]
    assert found["depth"] == (check or ("full" if method == "fourier" else "quick"))
    assert (found["agreed"], found["checked"], found["unchecked"]) == (True, True, [])
    assert len(found["comparisons"]) == routes
    small = found["comparisons"][0]
    assert small["routes"] == ["exact small-signal response", "harmonic balance at vanishing amplitude"]
    assert [row["frequency_rad_s"] for row in small["rows"]][2:] == [10.0, 50.0]
    assert small["largest_part_of_tolerance"] < 1.0
    assert ("effect_of_amplitude" in found) is effect
    if effect:
        assert found["effect_of_amplitude"]["largest_magnitude_difference"] == pytest.approx(0.0144, abs=2e-3)


def test_whole_turns_are_checked_and_a_wrong_one_fails(revline: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ("response", "--throttle", 25, "--frequencies", "10,300", "--method", "harmonic-balance", "--json")
    done = revline(*arguments)
    assert done.status == 0
    turns = json.loads(done.out)["cross_check"]["turns"]
    assert (turns["agreed"], turns["differ_at_rad_s"]) == (True, [])
    assert turns["orbits"] > 20

    def one_turn_too_many(model: DelayStateSpace, omega: Floats, input_name: str, output_name: str) -> Floats:
        return follow_phase(model, omega, input_name, output_name) - 2.0 * np.pi * (omega > 100.0)

    monkeypatch.setattr(phase_turns, "follow_phase", one_turn_too_many)
    done = revline(*arguments)
    assert done.status == 1
    found = json.loads(done.out)["cross_check"]
    assert (found["agreed"], found["turns"]["differ_at_rad_s"]) == (False, [300.0])
    assert "error: cross-check failed at 1 of 2 frequencies: at 300 rad/s the phase is given as" in done.err


def test_turns_that_cannot_be_checked_are_said(revline: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turn_check, "MOST_ORBITS", 10)
    done = revline("response", "--throttle", 25, "--frequencies", "10,300", "--method", "exact", "--json")
    assert done.status == 0
    assert "turns" not in json.loads(done.out)["cross_check"]
    assert "warning: the whole turns of the phase were not checked: to count the turns" in done.err


def test_a_check_that_was_not_asked_for_is_not_there(revline: Command) -> None:
    done = revline("response", "--throttle", 25, "--frequencies", 10, "--method", "exact", "--check", "none", "--json")
    assert "cross_check" not in json.loads(done.out)


def test_what_could_not_be_checked_is_said(revline: Command) -> None:
    arguments = ("response", "--throttle", 5, "--amplitude", 0.5, "--frequencies", 10, "--method", "exact", "--check", "full", "--json")
    done = revline(*arguments)
    assert done.status == 0
    found = json.loads(done.out)["cross_check"]
    assert (found["agreed"], found["checked"], found["comparisons"]) == (True, False, [])
    assert "warning: exact small-signal response was not checked against harmonic balance at vanishing amplitude" in done.err
    assert "warning: the response was not checked by simulation: lee1995 is not open-loop stable" in done.err


def test_frequencies_that_the_full_check_lacks_are_said(revline: Command) -> None:
    """10 +- 5 deg stalls the engine near 2 rad/s, not at 0.5 or 50."""
    arguments = ("response", "--throttle", 10, "--frequencies", "0.5,2,50", "--method", "exact", "--check", "full", "--json")
    done = revline(*arguments)
    assert done.status == 0
    assert "warning: not all was checked by simulation: 2 of 3 frequencies are finished; missing: 2 rad/s" in done.err
    assert [row["frequency_rad_s"] for row in json.loads(done.out)["cross_check"]["comparisons"][1]["rows"]] == [0.5, 50.0]


def test_a_frequency_without_an_orbit_leaves_the_others_and_says_so(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "part.csv"
    arguments = ("response", "--throttle", 10, "--amplitude", 5, "--frequencies", "0.1,2,50", "--method", "harmonic-balance", "--out", path)
    done = revline(*arguments, "--json")
    assert done.status == 1
    record = json.loads(done.out)
    assert [row["frequency_rad_s"] for row in record["frequency_response"]] == [0.1, 50.0]
    assert (record["partial"], record["missing"][0]["frequency_rad_s"], record["cross_check"]["agreed"]) == (True, 2.0, True)
    assert "the response is partial: 2 of 3 frequencies are finished with 5 deg, each of them has an answer up to 3." in done.err
    assert " deg; missing: 2 rad/s (" in done.err
    assert "# partial: 2 of 3 frequencies are finished" in path.read_text()


def test_rough_orbits_are_said_to_be_rough(revline: Command) -> None:
    arguments = ("response", "--throttle", 60, "--amplitude", 20, "--frequencies", "1", "--method", "harmonic-balance", "--check", "none")
    done = revline(*arguments)
    assert done.status == 0
    assert "warning: at 1 rad/s the harmonics decay slowly, as where an orbit crosses a limit" in done.err


def test_routes_that_disagree_fail_with_the_numbers_and_leave_a_file_that_says_so(
    revline: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lags of the linear model are planted 1 % too long."""
    right = linearize.build_model
    monkeypatch.setattr(linearize, "build_model", lambda system, jacobians, lags: right(system, jacobians, 1.01 * lags))
    path = tmp_path / "wrong.csv"
    arguments = ("response", "--throttle", 25, "--frequencies", "10,50", "--method", "exact")
    done = revline(*arguments, "--out", path, "--json")
    assert done.status == 1
    assert json.loads(done.out)["cross_check"]["agreed"] is False
    last = done.err.splitlines()[-1]
    assert last.startswith("error: cross-check failed at 4 of 4 frequencies: engine_speed of lee1995 answers throttle at ")
    assert f"{path} holds the response and says so; --check none leaves the check out" in last
    assert "DISAGREES with harmonic balance at vanishing amplitude at 0 of 4 frequencies" in revline(*arguments).out
    assert "# cross_check_failed: cross-check failed at 4 of 4 frequencies" in path.read_text()
    fitted = revline("fit", path, "--zeros", 0, "--poles", 1)
    assert "holds a response that another route contradicts: cross-check failed" in fitted.err
    assert revline(*arguments, "--check", "none").status == 0
