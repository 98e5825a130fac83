import csv
import json
from pathlib import Path

import pytest

from .conftest import Command

FEW = ("linear-range", "--throttle", 25, "--frequencies", "1,10,100", "--amplitudes", "2.5,5,10")


@pytest.mark.reference
def test_the_engine_s_linear_range(revline: Command, tmp_path: Path) -> None:
    """Converged, tests/analysis/test_describing.py: within 5 % up to 8.911 deg at 10 rad/s and 6.513 deg at 100 rad/s."""
    path = tmp_path / "range.json"
    done = revline(*FEW, "--out", path)
    assert "narrowest: 6.513 deg at 100 rad/s" in done.out
    assert "holds at all amplitudes asked for" in done.out
    record = json.loads(path.read_text())
    slow, middle, fast = record["ranges"]
    assert (slow["amplitude_deg"], slow["ended_by"]) == (10.0, "amplitudes-asked-for")
    assert slow["linear_error"] < 0.05
    assert middle["amplitude_deg"] == pytest.approx(8.91091, abs=2e-5)
    assert fast["amplitude_deg"] == pytest.approx(6.51271, abs=2e-5)
    assert fast["ended_by"] == "error"
    assert fast["linear_error"] == pytest.approx(0.05, rel=2e-6)
    assert record["narrowest"] == fast
    assert (record["within"], record["largest_amplitude_deg"], record["warnings"]) == (0.05, 25.0, [])
    assert "distortion_within" not in record
    assert len(record["cells"]) == 9


def test_the_tables_have_units_and_their_numbers(revline: Command, tmp_path: Path) -> None:
    ranges, cells = tmp_path / "range.csv", tmp_path / "cells.csv"
    printed = json.loads(revline(*FEW, "--distortion-within", 3, "--json", "--out", ranges, "--cells", cells).out)
    rows = list(csv.DictReader(line for line in ranges.read_text().splitlines() if not line.startswith("#")))
    assert [float(row["amplitude_deg"]) for row in rows] == [entry["amplitude_deg"] for entry in printed["ranges"]]
    assert [float(row["ended_by_distortion"]) for row in rows] == [1.0, 1.0, 0.0]
    assert [float(row["ended_by_error"]) for row in rows] == [0.0, 0.0, 1.0]
    table = list(csv.DictReader(line for line in cells.read_text().splitlines() if not line.startswith("#")))
    assert [{name: float(value) for name, value in row.items()} for row in table] == printed["cells"]
    at_five = next(row for row in printed["cells"] if row["amplitude_deg"] == 5.0 and row["frequency_rad_s"] == 10.0)
    assert 5.0 * at_five["gain_rad_s_per_deg"] == pytest.approx(10.8232, abs=1e-4)
    assert at_five["phase_deg"] == pytest.approx(-116.793, abs=1e-3)
    assert printed["distortion_within"] == 0.03


def test_where_there_is_no_orbit_it_says_why(revline: Command) -> None:
    done = revline("linear-range", "--throttle", 10, "--frequencies", 1, "--amplitudes", "1,9", "--within", 90, "--json")
    record = json.loads(done.out)
    (entry,) = record["ranges"]
    assert entry["ended_by"] == "no-orbit"
    assert 1.0 < entry["amplitude_deg"] < entry["no_orbit_at_deg"] < 9.0
    assert entry["reason"]
    assert record["missing"][0]["amplitude_deg"] == 9.0
    assert "1 of 2 cells have no periodic answer" in " ".join(done.err.split())


def test_what_is_refused(revline: Command, tmp_path: Path) -> None:
    same = tmp_path / "x.csv"
    for arguments, status, words in (
        (
            ("--throttle", 25, "--amplitudes", "5,30"),
            2,
            "amplitude = 30 deg is outside 0 to 25 deg, without 0, which is as far as throttle",
        ),
        (("--throttle", 25, "--amplitudes", "5,4"), 2, "do not rise"),
        (("--throttle", 25, "--frequencies", "0,1"), 2, "frequency = 0 rad/s"),
        (("--throttle", 25, "--within", 0), 2, "--within = 0 % is outside 0.001 to 100; give a percentage such as 5"),
        (("--throttle", 25, "--within", 100), 2, "--within = 100 % is outside 0.001 to 100"),
        (("--throttle", 25, "--distortion-within", 0), 2, "--distortion-within = 0 % is outside 0.001 and above"),
        (("--throttle", 25, "--out", same, "--cells", same), 2, "must be a file of its own"),
        (("--throttle", 25, "--cells", "-"), 2, "must be a file of its own"),
        (("--throttle", 4), 1, "not open-loop stable"),
    ):
        done = revline("linear-range", *arguments)
        assert done.status == status
        assert words in " ".join(done.err.split())
        assert done.out == ""
