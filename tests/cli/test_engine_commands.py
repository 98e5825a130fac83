import csv
import json
import tomllib
from pathlib import Path

import pytest

from .conftest import Command


def test_engines_are_listed(revline: Command) -> None:
    assert "lee1995" in revline("engines").out
    listed = json.loads(revline("engines", "--json").out)["engines"]
    assert [entry["name"] for entry in listed] == ["lee1995", "lee1995-generic"]


def test_a_printed_engine_file_can_be_changed_and_used(revline: Command, tmp_path: Path) -> None:
    text = revline("engines", "lee1995").out
    assert tomllib.loads(text) == json.loads(revline("engines", "lee1995", "--json").out)
    path = tmp_path / "heavy.toml"
    path.write_text(text.replace("inertia = 0.1454", "inertia = 0.2").replace('name = "lee1995"', 'name = "heavy"'))
    record = json.loads(revline("trim", "--engine", path, "--throttle", 25, "--json").out)
    assert record["engine"] == "heavy"
    assert record["speed_rad_s"] == pytest.approx(240.799, abs=1e-3)


@pytest.mark.reference
def test_trim_at_25_deg(revline: Command) -> None:
    """Lee (1995), chapter 4, converged: 240.79901 rad/s, 35.80718 kPa, 12.02944 rad/s per deg."""
    record = json.loads(revline("trim", "--throttle", 25, "--json").out)
    assert record["speed_rad_s"] == pytest.approx(240.79901, abs=1e-4)
    assert record["pressure_kpa"] == pytest.approx(35.80718, abs=1e-4)
    assert record["gain_rad_s_per_deg"] == pytest.approx(12.02944, abs=1e-4)
    assert record["residual"] < 1e-9
    assert record["stable"] is True
    assert record["lags_s"]["charge"] == pytest.approx(5.48 / 240.79901, rel=1e-6)
    assert record["speed_rpm"] == pytest.approx(240.79901 * 9.5492966, rel=1e-6)


def test_trim_for_people_names_units(revline: Command) -> None:
    out = revline("trim", "--throttle", 25).out
    for part in ("240.799", "rad/s = 2299.46 rpm", "35.8072", "kPa", "rad/s per deg", "deg", "N m"):
        assert part in out


def test_trim_by_speed_finds_the_throttle_under_a_load(revline: Command) -> None:
    by_angle = json.loads(revline("trim", "--throttle", 30, "--load", 10, "--json").out)
    by_speed = json.loads(revline("trim", "--speed", by_angle["speed_rad_s"], "--load", 10, "--json").out)
    assert by_speed["throttle_deg"] == pytest.approx(30.0, abs=1e-6)
    assert by_speed["load_n_m"] == 10.0


def test_a_trim_beyond_saturation_says_that_the_throttle_does_nothing(revline: Command) -> None:
    done = revline("trim", "--throttle", 80, "--json")
    record = json.loads(done.out)
    assert record["gain_rad_s_per_deg"] == 0.0
    assert record["warnings"][0] == "rate of manifold_pressure does not answer to throttle here: a limit is active"
    assert f"warning: {record['warnings'][0]}" in done.err


def test_a_speed_out_of_reach_names_the_nearest(revline: Command) -> None:
    assert "the nearest steady state met has engine_speed = 825.947 rad/s" in revline("trim", "--speed", 850).err


def test_an_unstable_trim_is_named(revline: Command) -> None:
    done = revline("trim", "--throttle", 5, "--json")
    record = json.loads(done.out)
    assert record["stable"] is False
    assert record["unstable_roots"] == 2
    assert record["warnings"] == ["open-loop unstable: 2 characteristic roots in the right half-plane"]
    assert "warning: open-loop unstable" in done.err


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ((), 2, "give either --throttle or --speed"),
        (("--throttle", 25, "--speed", 200), 2, "give either --throttle or --speed"),
        (("--throttle", 95), 2, "throttle = 95 deg is outside 0 to 90 deg"),
        (("--throttle", -1), 2, "throttle = -1 deg is outside 0 to 90 deg"),
        (("--throttle", "nan"), 2, "throttle = nan deg"),
        (("--throttle", 25, "--engine", "lee"), 2, "there is no engine 'lee', did you mean lee1995?"),
        (("--throttle", 25, "--engine", "absent.toml"), 2, "engine file absent.toml does not exist"),
        (("--speed", 1200), 1, "no trim at"),
        (("--throttle", 25, "--load", 500), 1, "no trim at"),
    ],
)
def test_what_trim_refuses(arguments: tuple[object, ...], status: int, message: str, revline: Command) -> None:
    done = revline("trim", *arguments)
    assert (done.status, done.out) == (status, "")
    assert done.err.startswith("error: ")
    assert message in done.err
    assert len(done.err.splitlines()) == 1


def test_map_writes_its_table_and_names_where_it_ends(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    done = revline("map", "--from", 3, "--to", 12, "--points", 10, "--out", path, "--json")
    record = json.loads(done.out)
    rows = list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))
    assert [float(row["throttle_deg"]) for row in rows] == [4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0]
    assert [row["stable"] for row in rows[:3]] == ["0", "0", "1"]
    assert float(rows[6]["speed_rad_s"]) == pytest.approx(64.46696, abs=2e-4)
    assert [row["speed_rad_s"] for row in record["steady_map"]] == [float(row["speed_rad_s"]) for row in rows]
    assert [row["stable"] for row in record["steady_map"][:3]] == [False, False, True]
    assert record["ends"][0]["throttle_deg"] == pytest.approx(3.99, abs=0.01)
    assert record["ends"][0]["speed_rad_s"] == pytest.approx(10.0, abs=1e-4)
    assert "warning: no steady state below throttle = 3.99" in done.err
    assert path.read_text().startswith("# engine: lee1995\n# load_n_m: 0.0\nthrottle_deg,speed_rad_s,pressure_kpa,")


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--from", 30, "--to", 20), 2, "--from 30 is not below --to 20: the angles must rise; give the lower one first"),
        (("--to", "inf"), 2, "error: --to inf is no angle; give a number of degrees"),
        (("--from", 20, "--to", 100), 2, "throttle = 100 deg is outside 0 to 90 deg"),
        (("--from", 0, "--to", 2, "--points", 3), 1, "no steady state at any throttle"),
        (("--out", "absent/map.csv"), 2, "its folder absent does not exist; make it first"),
        (("--out", "."), 2, "it is a folder; name a file in it"),
        (("--out", "/proc/map.csv"), 2, "cannot be written"),
        (("--out", "-", "--json"), 2, "cannot both go to stdout"),
    ],
)
def test_what_map_refuses(arguments: tuple[object, ...], status: int, message: str, revline: Command) -> None:
    done = revline("map", *arguments)
    assert (done.status, done.out) == (status, "")
    assert message in done.err


def test_a_map_on_stdout_is_the_file_and_nothing_else(revline: Command, tmp_path: Path) -> None:
    arguments = ("map", "--from", 20, "--to", 30, "--points", 3)
    done = revline(*arguments, "--out", "-")
    revline(*arguments, "--out", tmp_path / "map.csv")
    assert done.out == (tmp_path / "map.csv").read_text()
    assert "Steady states of lee1995" in done.err


def test_linearize_writes_the_exact_model(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "linear.json"
    done = revline("linearize", "--throttle", 25, "--out", path, "--json")
    record = json.loads(done.out)
    assert record == json.loads(path.read_text())
    assert record["states"] == ["manifold_pressure", "engine_speed"]
    assert record["channels"] == ["charge", "spark_influence"]
    assert {len(record[name]) for name in ("A", "Bu", "Bz")} == {2}
    assert len(record["Cy"]) == len(record["outputs"]) == len(record["Dyu"]) == len(record["Dyz"])
    assert len(record["Cz"]) == len(record["Dzu"]) == len(record["Dzz"]) == len(record["lags_s"]) == 2
    assert record["operating_point"]["speed_rad_s"] == pytest.approx(240.799, abs=1e-3)
    assert record["stable"] is True
    assert record["residual"] < 1e-9


def test_a_linear_model_at_a_limit_warns(revline: Command) -> None:
    done = revline("linearize", "--throttle", 85)
    assert done.status == 0
    assert "warning: " in done.err
    assert "throttle" in done.err


def test_a_printed_vector_reads_back_as_the_engine(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "mine.vec"
    path.write_text(revline("engines", "lee1995", "--vector").out)
    assert revline("engines", path).out.replace('name = "mine"', 'name = "lee1995"') == revline("engines", "lee1995").out
    numbers = json.loads(revline("engines", path, "--vector", "--json").out)["vector"]
    assert (len(numbers), numbers[7], numbers[12], numbers[23]) == (24, -3.1e4, 0.0, 0.1454)


def test_a_vector_says_what_it_cannot_hold(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "high.toml"
    path.write_text(revline("engines", "lee1995").out.replace("ambient_pressure = 100.0", "ambient_pressure = 95.0"))
    done = revline("engines", path, "--vector")
    assert done.status == 0
    assert "warning: throttle.ambient_pressure = 95.0 kPa is not in the vector: reading it back gives 100.0 kPa" in done.err
    assert "cannot hold the generic efficiency" in revline("engines", "lee1995-generic", "--vector").err
    assert revline("engines", "--vector").status == 2


def test_roots_are_listed_by_number_or_right_of_a_line(revline: Command) -> None:
    done = revline("linearize", "--throttle", 25, "--roots", 2, "--json")
    assert [round(pair[0], 3) for pair in json.loads(done.out)["roots_rad_s"]] == [-2.072, -20.617]
    done = revline("linearize", "--throttle", 4, "--roots-right-of", 0.0)
    assert "root                     0.54774+1.9838j" in done.out
    done = revline("linearize", "--throttle", 25, "--roots", 3, "--roots-right-of", -5)
    assert done.status == 2
    assert "give either --roots or --roots-right-of" in done.err


def test_a_step_of_the_linear_model_is_written(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "step.csv"
    done = revline("linearize", "--throttle", 25, "--step-out", path, "--until", 4.0, "--json")
    record = json.loads(done.out)["step"]
    assert record["final"]["engine_speed"] == pytest.approx(12.0294, abs=5e-3)
    assert record["errors"]["engine_speed"] < 1e-9
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert lines[0].startswith("time_s,engine_speed_rad_s,")
    assert len(lines) == 1002
    assert float(lines[-1].split(",")[1]) == record["final"]["engine_speed"]
    assert revline("linearize", "--throttle", 25, "--step-out", path, "--until", 0).status == 2


def test_a_step_that_would_be_lost_or_is_not_asked_for_is_refused(revline: Command, tmp_path: Path) -> None:
    path = tmp_path / "both.json"
    done = revline("linearize", "--throttle", 25, "--out", path, "--step-out", path)
    assert (done.status, path.exists()) == (2, False)
    assert "must be a file of its own; name another than that of --out" in " ".join(done.err.split())
    done = revline("linearize", "--throttle", 25, "--until", 3)
    assert (done.status, done.out) == (2, "")
    assert "--until 3 is how long --step-out lasts; name a file with --step-out, or leave --until out" in " ".join(done.err.split())
