import json
from pathlib import Path

import pytest

from .conftest import Command


@pytest.mark.reference
def test_the_engines_region(revline: Command, tmp_path: Path) -> None:
    """Converged: proportional control of the engine up to 2.106 deg per rad/s at 25 deg."""
    path = tmp_path / "region.json"
    done = revline("region", "--throttle", 25, "--out", path)
    assert "written" in done.out
    record = json.loads(path.read_text())
    assert record["bounded"] is True
    ((low, high),) = record["kp_intervals_without_integral"]
    assert (low, high) == pytest.approx((-0.0831, 2.106), abs=5e-4)
    assert len(record["boundary"]) > 100
    assert all(point["ki"] >= 0.0 for point in record["boundary"])
    assert record["kp_unit"] == "deg/(rad/s)"


def test_no_gains_stabilise_the_engine_with_too_much_derivative(revline: Command) -> None:
    record = json.loads(revline("region", "--throttle", 25, "--kd", 0.4, "--json").out)
    assert record["kp_intervals_without_integral"] == record["boundary"] == []


def test_a_model_s_region_within_a_window(revline: Command, g1: Path) -> None:
    record = json.loads(revline("region", g1, "--kp-max", 3, "--ki-max", 20, "--json").out)
    assert record["bounded"] is False
    assert (record["window"]["kp_high"], record["window"]["ki_high"]) == (3.0, 20.0)
    assert "go on beyond it" in revline("region", g1).out


def test_what_is_refused(revline: Command, g1: Path) -> None:
    for arguments, words in (
        ((), "give a model file, or --throttle"),
        ((g1, "--throttle", 25), "leave them out"),
        (("--throttle", 95), "throttle = 95 deg"),
        ((g1, "--ki-max", 0), "largest ki = 0"),
        ((g1.with_name("absent.json"),), "absent.json"),
    ):
        done = revline("region", *arguments)
        assert done.status == 2
        assert words in " ".join(done.err.split())
        assert done.out == ""
