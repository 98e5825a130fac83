import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from .conftest import Command


@pytest.fixture
def c2d(tmp_path: Path) -> Path:
    path = tmp_path / "c2d.json"
    path.write_text('{"kp": 1.2, "ki": 2.0, "kd": 0.1}')
    return path


@pytest.fixture
def g2d(revline: Command, table: Path, tmp_path: Path) -> Path:
    path = tmp_path / "g2d.json"
    assert revline("fit", table, "--zeros", 0, "--poles", 2, "--delay", "phase-line", "--out", path, "-q").status == 0
    return path


@pytest.mark.reference
def test_proportional_control_of_the_engine_has_its_critical_gain(revline: Command, tmp_path: Path) -> None:
    """Converged: 2.106 deg per rad/s at 25 deg, 2.794 at 30 deg, oscillating at 29.8 and 38.0 rad/s."""
    path = tmp_path / "p.json"
    path.write_text('{"kp": 1.0, "ki": 0.0, "kd": 0.0}')
    for angle, gain, frequency in ((25, 2.106, 29.8), (30, 2.794, 38.0)):
        record = json.loads(revline("margins", path, "--throttle", angle, "--json").out)
        assert record["gain_margin"] == pytest.approx(gain, abs=5e-4)
        assert record["phase_crossovers"][0]["frequency_rad_s"] == pytest.approx(frequency, abs=0.05)
        assert (record["stable"], record["unstable_poles"]) == (True, 0)


def test_an_unstable_loop_says_so_first(revline: Command, g2d: Path, c1: Path) -> None:
    done = revline("margins", g2d, c1)
    assert done.out.splitlines()[0].strip() == "g2d under pole-placement: UNSTABLE"
    assert json.loads(revline("margins", g2d, c1, "--json").out)["unstable_poles"] == 2


def test_a_model_without_delay_lets_the_gain_rise_without_end(revline: Command, g1: Path, c1: Path) -> None:
    record = json.loads(revline("margins", g1, c1, "--json").out)
    assert "gain_margin" not in record
    assert record["phase_crossovers_found"] == 0
    assert "none up to" in revline("margins", g1, c1).out


def test_the_record_is_written(revline: Command, c2d: Path, tmp_path: Path) -> None:
    path = tmp_path / "margins.json"
    done = revline("margins", c2d, "--throttle", 25, "--load", 10, "--out", path)
    assert done.status == 0
    record = json.loads(path.read_text())
    assert record["loop"].startswith("lee1995 at 25 deg, 10 N m")
    assert record["ms"] > 1.0
    assert len(record["phase_crossovers"]) == 12 < record["phase_crossovers_found"]


def test_a_loop_with_infinitely_many_unstable_poles_is_improper(revline: Command, tmp_path: Path) -> None:
    model, gains = tmp_path / "lag.json", tmp_path / "pd.json"
    model.write_text('{"numerator": [2.0], "denominator": [1.0, 1.0], "delay_s": 0.1}')
    gains.write_text('{"kp": 1.0, "ki": 0.0, "kd": 0.9}')
    done = revline("margins", model, gains)
    assert done.status == 2
    assert "improper" in done.err
    assert "filter the derivative" in done.err


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ((), "needs --throttle"),
        (("--throttle", 95), "throttle = 95 deg"),
        (("--throttle", 25, "--load", 500), "no trim at"),
    ],
)
def test_what_is_refused(revline: Command, c2d: Path, extra: tuple[object, ...], words: str) -> None:
    done = revline("margins", c2d, *extra)
    assert done.status in {1, 2}
    assert words in " ".join(done.err.split())
    assert done.out == ""


def test_a_model_takes_no_trim_and_no_third_file(revline: Command, g1: Path, c1: Path) -> None:
    assert "leave them out" in revline("margins", g1, c1, "--throttle", 25).err
    assert "3 files were given" in revline("margins", g1, g1, c1).err


def test_a_controller_that_samples_drops_no_option_and_no_file(revline: Command, g1: Path, tmp_path: Path) -> None:
    sampled = tmp_path / "sampled.json"
    sampled.write_text('{"kp": 0.4, "ki": 0.6, "kd": 0, "sampling": {"kind": "fixed-rate", "period_s": 0.01}}')
    assert "are for a frequency response" in " ".join(revline("margins", sampled, "--throttle", 25, "--delay", 5).err.split())
    assert "3 files were given" in revline("margins", g1, g1, sampled, "--throttle", 25).err


def test_a_model_is_sampled_by_the_crank_at_the_speed_of_its_trim(revline: Command, g1: Path, tmp_path: Path) -> None:
    """At 25 deg the engine turns with 240.799 rad/s: half a turn takes 13.05 ms."""
    crank, timer = tmp_path / "crank.json", tmp_path / "timer.json"
    gains = '{"kp": 0.4, "ki": 0.6, "kd": 0, "sampling": '
    crank.write_text(gains + '{"kind": "crank-synchronous", "angle_rad": 3.14159265}}')
    timer.write_text(gains + f'{{"kind": "fixed-rate", "period_s": {math.pi / 240.799014}}}}}')
    alone = revline("margins", g1, crank)
    assert (alone.status, alone.out) == (2, "")
    assert "needs the speed: give --throttle" in " ".join(alone.err.split())
    by_crank = json.loads(revline("margins", g1, crank, "--throttle", 25, "--json").out)
    by_timer = json.loads(revline("margins", g1, timer, "--json").out)
    assert by_crank["gain_margin"] == pytest.approx(by_timer["gain_margin"], rel=1e-6)


def test_a_controller_without_gains_has_no_margins(revline: Command, g1: Path, tmp_path: Path) -> None:
    nothing = tmp_path / "zero.json"
    nothing.write_text('{"kp": 0, "ki": 0, "kd": 0}')
    for plant in ((g1, nothing), (nothing, "--throttle", 25)):
        done = revline("margins", *plant)
        assert (done.status, done.out) == (2, "")
        assert "is 0 at every frequency, so that there are no margins; give the controller a gain" in " ".join(done.err.split())


@pytest.fixture
def proportional(tmp_path: Path) -> Path:
    path = tmp_path / "p.json"
    path.write_text('{"kp": 1.0, "ki": 0.0, "kd": 0.0}')
    return path


@pytest.mark.reference
def test_a_table_of_the_response_stands_for_the_plant(revline: Command, table: Path, proportional: Path) -> None:
    """Table 4.1 gives 2.2135 under proportional control; its samples prove no stability, and the output claims none."""
    done = revline("margins", table, proportional)
    assert done.status == 0
    assert done.out.splitlines()[0].strip() == "table_4_1 under by hand: sampled"
    record = json.loads(revline("margins", table, proportional, "--json").out)
    assert record["sampled"] is True
    assert record["samples"] == 42
    assert record["gain_margin"] == pytest.approx(2.2135, abs=5e-4)
    assert "stable" not in record


@pytest.mark.parametrize("delay", [0.25, 0.5])
def test_a_sampled_lag_with_dead_time_has_its_closed_form(revline: Command, proportional: Path, tmp_path: Path, delay: float) -> None:
    """exp(-s T) / (s + 1): the phase crosses -180 deg where w T + atan w = pi, and the gain may rise by (1 + w^2)^0.5 there."""
    omega = brentq(lambda w: w * delay + math.atan(w) - math.pi, 0.1, 20.0)
    rows = [(w, 1.0 / math.hypot(1.0, w), -math.degrees(math.atan(w) + w * delay)) for w in np.geomspace(0.01, 20.0, 80)]
    path = tmp_path / "lag.csv"
    path.write_text("frequency_rad_s,magnitude,phase_deg\n" + "".join(f"{w!r},{m!r},{p!r}\n" for w, m, p in np.array(rows).tolist()))
    record = json.loads(revline("margins", path, proportional, "--json").out)
    assert record["gain_margin"] == pytest.approx(math.hypot(1.0, omega), rel=1e-3)


def test_a_table_takes_no_trim_and_no_number(revline: Command, table: Path, proportional: Path, tmp_path: Path) -> None:
    done = revline("margins", table, proportional, "--throttle", 25)
    assert (done.status, done.out) == (2, "")
    assert "leave them out" in done.err
    broken = tmp_path / "broken.csv"
    broken.write_text("frequency_rad_s,magnitude,phase_deg\n1,nan,-3\n")
    done = revline("margins", broken, proportional)
    assert (done.status, done.out) == (2, "")
    assert "'nan' is no finite number" in done.err
