import csv
import json
from pathlib import Path

import pytest

from .conftest import Command


def controller(folder: Path, name: str, kp: float, ki: float, kd: float) -> Path:
    path = folder / f"{name}.json"
    path.write_text(json.dumps({"kp": kp, "ki": ki, "kd": kd}))
    return path


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
    assert record["boundary"][-1]["kp"] == pytest.approx(high, rel=1e-12)
    assert record["boundary"][-1]["frequency_rad_s"] == pytest.approx(29.8, abs=0.05)
    assert len(record["boundary"]) > 100
    assert all(point["ki"] >= 0.0 for point in record["boundary"])
    assert record["kp_unit"] == "deg/(rad/s)"
    assert record["area_in_window"]["error"] < 1e-4 * record["area_in_window"]["value"]


def test_no_gains_stabilise_the_engine_with_too_much_derivative(revline: Command) -> None:
    record = json.loads(revline("region", "--throttle", 25, "--kd", 0.4, "--damping", 0.1, "--json").out)
    assert record["kp_intervals_without_integral"] == record["boundary"] == []
    assert "damped" not in record


def test_a_model_s_region_within_a_window(revline: Command, g1: Path) -> None:
    record = json.loads(revline("region", g1, "--kp-max", 3, "--ki-max", 20, "--json").out)
    assert record["bounded"] is False
    assert (record["window"]["kp_high"], record["window"]["ki_high"]) == (3.0, 20.0)
    assert "go on beyond it" in revline("region", g1).out


def test_slices_contours_damping_controllers_figure_and_table(revline: Command, tmp_path: Path) -> None:
    c1, c2d = controller(tmp_path, "c1", 2.153, 16.85, 0.0), controller(tmp_path, "c2d", 1.2, 2.0, 0.1)
    figure, table = tmp_path / "region.png", tmp_path / "region.csv"
    asked = ("--ms", "1.7,3", "--damping", 0.1, "--mark", c1, "--mark", c2d, "--plot", figure, "--csv", table, "--largest-kd")
    record = json.loads(revline("region", "--throttle", 25, *asked, "--json").out)
    first, second = record["slices"]
    assert (first["kd"], second["kd"]) == (0.0, 0.1)
    assert record["boundary"] == first["boundary"]
    (placed,) = first["controllers"]
    assert placed["name"] == "c1"
    assert placed["inside"] is False
    assert placed["unstable_roots"] == 2
    assert placed["fall"]["factor"] * 2.153 == pytest.approx(1.240, abs=1e-3)
    assert "ms" not in placed
    (placed,) = second["controllers"]
    assert placed["inside"] is placed["damped"] is True
    assert placed["ms"] == pytest.approx(3.264, abs=1e-3)
    assert [contour["ms"] for contour in first["ms_contours"]] == [1.7, 3.0]
    assert first["ms_contours"][0]["points"]
    assert second["ms_contours"][0]["points"] == []
    assert first["damped"]["up_to_rad_s"] == pytest.approx(29.8, abs=0.05)
    assert record["largest_kd"]["stabilised"] == pytest.approx(0.1846, abs=5e-4)
    assert figure.read_bytes().startswith(b"\x89PNG")
    lines = [line for line in table.read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert set(rows[0]) == {"kd_deg_rad_s_s", "damping_1", "inverse_ms_1", "frequency_rad_s", "kp_deg_rad_s", "ki_deg_rad_s_s"}
    assert {float(row["kd_deg_rad_s_s"]) for row in rows} == {0.0, 0.1}
    words = revline("region", "--throttle", 25, *asked, "--quiet").out
    for text in (
        "largest ki with Ms = 1.7",
        "no gains are so gentle",
        "outside, 2 unstable roots",
        "inside, damped at least 0.1",
        "largest kd at which",
    ):
        assert text in words


def test_a_plant_without_limit_says_so(revline: Command, g1: Path, tmp_path: Path) -> None:
    figure = tmp_path / "g1.svg"
    mark = controller(tmp_path, "c", 2.0, 10.0, 0.0)
    done = revline("region", g1, "--largest-kd", "--mark", mark, "--damping", 0.3, "--plot", figure)
    assert done.status == 0
    assert "some gains stabilise at every kd tried" in done.out
    assert "no crossing" in done.out
    assert figure.read_text().startswith("<?xml")


def test_the_boundary_on_the_engine(revline: Command, tmp_path: Path) -> None:
    figure = tmp_path / "region.svg"
    record = json.loads(revline("region", "--throttle", 25, "--on-engine", 1, "--plot", figure, "--json").out)
    (found,) = record["on_engine"]
    (point,) = found["points"]
    assert found["throttle_at_target_deg"] == pytest.approx(30.0, abs=0.01)
    assert point["settled_factor"] < 1.01 < 1.03 * point["unsettled_factor"]
    assert point["outcome"] == "limit-cycle"
    assert point["frequency_rad_s"] == pytest.approx(point["linear_frequency_rad_s"], rel=0.02)
    assert "lost" not in found


def test_what_is_refused(revline: Command, g1: Path, tmp_path: Path) -> None:
    mark = controller(tmp_path, "c", 1.0, -1.0, 0.0)
    for arguments, words in (
        ((), "give a model file, or --throttle"),
        ((g1, "--throttle", 25), "leave them out"),
        (("--throttle", 95), "throttle = 95 deg"),
        ((g1, "--ki-max", 0), "largest ki = 0"),
        ((g1, "--damping", 0), "damping = 0"),
        ((g1, "--damping-up-to", 10), "but no ratio"),
        ((g1, "--ms", "1"), "peak of the sensitivity = 1"),
        ((g1, "--ms", "x"), "--ms"),
        ((g1, "--kd", "0,0"), "some of them alike"),
        ((g1, "--plot", tmp_path / "a.pdf"), "is written as .png or .svg"),
        ((g1, "--on-engine", 4), "leave the model file out"),
        ((g1, "--mark", mark), "ki of c = -1"),
        (("--throttle", 25, "--on-engine", 2, "--step", 0), "command step = 0"),
        ((g1.with_name("absent.json"),), "absent.json"),
    ):
        done = revline("region", *arguments)
        assert done.status == 2, (arguments, done.err)
        assert words in " ".join(done.err.split())
        assert done.out == ""


def test_a_speed_that_cannot_be_held_ends_with_1(revline: Command) -> None:
    done = revline("region", "--throttle", 25, "--on-engine", 2, "--step", 900)
    assert done.status == 1
    assert "no trim at engine_speed" in done.err
