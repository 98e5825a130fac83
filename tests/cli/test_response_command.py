import json
from pathlib import Path

import pytest

from revline.io.response_files import read_response

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
        (("--frequencies", "1e9"), 2, "frequency = 1e+09 rad/s is outside what"),
        (("--frequencies-file", "absent.csv"), 2, "cannot read absent.csv"),
        (("--frequencies", "1", "--amplitude", 0), 2, "sine amplitude = 0"),
        (("--frequencies", "1", "--amplitude", 70), 2, "goes too far: throttle = -45 deg is outside 0 to 90 deg"),
        (("--frequencies", "1", "--time-step", -1), 2, "max_step = -1 s is outside"),
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
