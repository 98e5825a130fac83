import json
from pathlib import Path

import numpy as np
import pytest

from revline.io.csv_table import read_csv_table

from .conftest import Command

POINT = ("spectra", "--throttle", 25, "--amplitude", 5)


@pytest.mark.reference
def test_the_speed_follows_the_throttle(revline: Command, tmp_path: Path) -> None:
    """Lee (1995), Figs 4.3-4.9; amplitude, mean and distortion at 5 rad/s converged by harmonic balance: 22.06655, 243.01912, 3.659 %."""
    path = tmp_path / "spectra.csv"
    record = json.loads(revline(*POINT, "--frequencies", "5,50", "--out", path, "--json").out)
    first, second = record["spectra"]
    assert first["peak_rad_s"] == pytest.approx(5.0, abs=1e-9)
    assert first["peak_amplitude_rad_s"] == pytest.approx(22.06655, rel=1e-5)
    assert first["zero_line_rad_s"] == pytest.approx(243.01912 - 240.79901, abs=1e-4)
    assert first["distortion"] == pytest.approx(0.036592, abs=1e-5)
    assert (first["follows"], second["follows"], first["periods"]) == (True, True, 8)
    assert first["resolution_rad_s"] == pytest.approx(5.0 / 8.0)
    assert record["linearity"]["ranges_rad_s"] == [[5.0, 50.0]]
    table = read_csv_table(path)
    rows = table.numbers("input_frequency_rad_s") == 50.0
    lines, sizes = table.numbers("frequency_rad_s")[rows], table.numbers("amplitude_rad_s")[rows]
    assert lines[1 + np.argmax(sizes[1:])] == pytest.approx(second["peak_rad_s"])
    assert "no window" in table.metadata["scaling"]


def test_more_periods_resolve_more_and_the_verdict_has_the_limit_asked_for(revline: Command) -> None:
    done = revline(*POINT, "--frequencies", "5,50", "--periods", 16, "--distortion-limit", 0.03, "--json")
    record = json.loads(done.out)
    assert [row["resolution_rad_s"] for row in record["spectra"]] == pytest.approx([5.0 / 16.0, 50.0 / 16.0])
    assert record["linearity"]["ranges_rad_s"] == [[50.0, 50.0]]
    assert record["linearity"]["follows"] is False


def test_spectra_for_people_end_in_the_verdict(revline: Command) -> None:
    out = revline(*POINT, "--frequencies", "20").out
    assert "line at zero [rad/s]" in out
    assert "the speed follows the only frequency looked at: distortion is 2.6 % at most, at 20 rad/s (limit 5 %)" in out


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--frequencies", "0,1"), 2, "frequency = 0 rad/s is outside"),
        (("--frequencies", "x"), 2, "'x' is no finite number"),
        (("--amplitude", 70), 2, "goes too far"),
        (("--distortion-limit", 1), 2, "distortion limit = 1 of the fundamental is outside"),
        (("--load", 500), 1, "no trim at"),
    ],
)
def test_what_spectra_refuses(arguments: tuple[object, ...], status: int, message: str, revline: Command) -> None:
    done = revline(*POINT, *arguments)
    assert (done.status, done.out) == (status, "")
    assert message in done.err
