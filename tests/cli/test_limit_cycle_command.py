"""The command limit-cycle: cycles with their evidence, loops that do not hunt, and what is refused."""

import json
from pathlib import Path

import pytest

from .conftest import Command


def controller(folder: Path, kp: float, ki: float, kd: float = 0.0) -> Path:
    path = folder / f"controller_{kp:g}_{ki:g}_{kd:g}.json"
    path.write_text(json.dumps({"kp": kp, "ki": ki, "kd": kd}))
    return path


@pytest.mark.reference
def test_c1_hunts_in_its_known_cycle(revline: Command, tmp_path: Path) -> None:
    """Converged simulation of Lee's C1: 291.147 to 310.074 rad/s in 0.208767 s; critical kp 1.927 at C1's ratio."""
    out = tmp_path / "cycle.json"
    done = revline("limit-cycle", controller(tmp_path, 2.153, 16.85), "--throttle", 25, "--onset", "--out", out)
    assert done.status == 0
    assert "hunts between 291.147 and 310.074 rad/s" in done.out
    assert "Onset of hunting" in done.out
    record = json.loads(out.read_text())
    cycle, onset = record["limit_cycle"], record["onset"]
    assert (cycle["low_rad_s"], cycle["high_rad_s"]) == pytest.approx((291.147, 310.074), abs=1e-3)
    assert cycle["period_s"] == pytest.approx(0.208767, abs=1e-6)
    assert cycle["stable"] is True
    assert cycle["leading_multiplier"] == pytest.approx(0.6217, abs=1e-4)
    assert record["simulated"]["period_s"] == pytest.approx(cycle["period_s"], rel=1e-5)
    assert record["agreement"]["largest_difference"] < record["agreement"]["tolerance"]
    assert (onset["kp"], onset["kind"]) == (pytest.approx(1.927, abs=5e-4), "soft")
    assert onset["branch"][0]["factor"] > onset["factor"] == onset["lowest_factor_with_cycle"]


def test_loops_that_do_not_hunt_say_how_they_end(revline: Command, tmp_path: Path) -> None:
    for kp, ki, outcome in ((0.8, 2.0, "settled"), (0.0, 0.0, "settled")):
        record = json.loads(revline("limit-cycle", controller(tmp_path, kp, ki), "--throttle", 25, "--command", 20, "--json").out)
        assert (record["outcome"], record["hunts"]) == (outcome, False)
        assert "limit_cycle" not in record
        assert "simulated" not in record


def test_a_cycle_that_is_not_resolved_is_given_as_simulated(revline: Command, tmp_path: Path) -> None:
    """Much derivative action at a small throttle: sharp swings from limit to limit."""
    done = revline("limit-cycle", controller(tmp_path, 6.0, 6.0, 0.05), "--throttle", 12, "--command", 5, "--json")
    assert done.status == 0, done.err
    record = json.loads(done.out)
    found = record["simulated_only"]
    assert "limit_cycle" not in record
    assert (found["low_rad_s"], found["period_s"]) == (record["simulated"]["low_rad_s"], record["simulated"]["period_s"])
    assert 0.0 <= found["period_spread_s"] < 1e-2 * found["period_s"]
    assert "is not resolved with" in found["reason"]
    assert "known from the simulation only" in " ".join(done.err.split())


def test_what_is_refused(revline: Command, tmp_path: Path) -> None:
    c1, zero, against = (controller(tmp_path, *gains) for gains in ((2.153, 16.85), (0.0, 0.0), (-1.0, -5.0)))
    for status, words, arguments in (
        (2, "absent.json", (tmp_path / "absent.json", "--throttle", 25)),
        (2, "throttle = 95 deg", (c1, "--throttle", 95)),
        (2, "command step = 0", (c1, "--throttle", 25, "--command", 0)),
        (2, "all gains are 0", (zero, "--throttle", 25, "--onset", "--command", 20)),
        (1, "no factor of the gains", (against, "--throttle", 25, "--onset", "--command", 20)),
    ):
        done = revline("limit-cycle", *arguments)
        assert done.status == status, done.err
        assert words in " ".join(done.err.split())
        assert done.out == ""
