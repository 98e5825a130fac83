import json
from pathlib import Path

import pytest

from revline.analysis import threads

from .conftest import Command

SMALL = ("gain-map", "--throttle", "20,40", "--load", "0,20")


def test_the_map_as_json_and_for_people(revline: Command, tmp_path: Path) -> None:
    out, figure = tmp_path / "map.json", tmp_path / "map.png"
    done = revline(*SMALL, "--out", out, "--plot", figure)
    assert "All 4 points with a steady state" in done.out
    assert "largest kp" in done.out
    record = json.loads(out.read_text())
    assert record["schema"] == "revline.gain-map/1"
    assert [axis["unit"] for axis in record["axes"]] == ["deg", "N m"]
    assert record["ki_unit"] == "deg/(rad/s)/s"
    assert record["points"][0]["best"]["ms"] == pytest.approx(2.0, rel=2e-3)
    assert record["partial"] is False
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_fixed_gains_and_a_schedule(revline: Command, tmp_path: Path) -> None:
    figure = tmp_path / "schedule.png"
    asked = ("--fixed", "--floor-share", 0.2, "--prove", 0.2, "--schedule", "--plot", figure)
    done = revline("gain-map", "--throttle", "30,40", "--load", "0,20", *asked, "--json")
    record = json.loads(done.out)
    fixed = record["fixed"]
    assert fixed["worst_ms"] <= 2.0
    assert fixed["share_of_map"] == pytest.approx(1.0)
    assert "limit" not in fixed  # no box is larger than the map
    schedule = record["schedule"]
    assert schedule["worst_ms"] <= schedule["ms"] == 2.0
    assert schedule["axes"][0]["name"] == "engine_speed"
    assert len(schedule["kp"]) == 2
    assert len(schedule["kp"][0]) == 2
    assert figure.exists()


def test_points_without_gains_are_named_in_the_warnings(revline: Command) -> None:
    done = revline("gain-map", "--throttle", "3,10", "--load", 40)
    assert done.status == 0
    assert "no steady state at throttle = 3 deg, load_torque = 40 N m" in done.err
    assert "no kp and ki keep the peak" in done.err
    assert "nothing" in done.out


def test_what_is_wrong_is_said(revline: Command, tmp_path: Path) -> None:
    assert "does not rise strictly" in revline("gain-map", "--throttle", "3,2").err
    alone = revline(*SMALL, "--prove", 0.2)
    assert (alone.status, "give --fixed too" in alone.err) == (2, True)
    assert "give --fixed too" in revline(*SMALL, "--floor-ki", 0.5).err
    assert "give --fixed too" in revline(*SMALL, "--floor-share", 0.5).err
    assert "--prove = 0" in revline(*SMALL, "--fixed", "--prove", 0).err
    assert "share of the best ki = 2" in revline(*SMALL, "--fixed", "--floor-share", 2).err
    nothing = revline("gain-map", "--throttle", "10,10.5", "--load", "40", "--plot", tmp_path / "no.png")
    assert (nothing.status, "could be drawn" in nothing.err) == (2, True)


def test_an_interruption_keeps_the_finished_points(revline: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[bool] = []
    wait = threads._wait_for  # noqa: SLF001 - the only place where an interruption can be let in

    def interrupted(ended: object) -> object:
        if done:
            raise KeyboardInterrupt
        done.append(True)
        return wait(ended)  # type: ignore[arg-type]  # the queue, whatever its type

    monkeypatch.setattr(threads, "_wait_for", interrupted)
    out = tmp_path / "part.json"
    left = revline(*SMALL, "--out", out)
    assert left.status == 1
    assert "interrupted after 2 of 4 operating points" in left.err
    record = json.loads(out.read_text())
    assert record["partial"] is True
    assert [point["found"] for point in record["points"]].count(True) == 2
