"""How far a linear model may be trusted, as a record for JSON and as tables."""

from collections.abc import Mapping, Sequence

import numpy as np

from revline.analysis.describing import DescribingFunctions
from revline.analysis.linear_range import HoldsThroughout, HoldsUpTo, LinearRange, LinearRanges
from revline.io.csv_text import format_csv

ENDS = ("error", "distortion", "input-limits", "amplitudes-asked-for", "no-orbit")
"""What a range may end by."""


def ended_by(entry: LinearRange) -> str:
    """Tell what a range ends by, as one of `ENDS`."""
    if isinstance(entry, HoldsUpTo):
        return entry.reached
    if isinstance(entry, HoldsThroughout):
        return "input-limits" if entry.to_input_limits else "amplitudes-asked-for"
    return "no-orbit"


def linear_range_record(found: LinearRanges) -> Mapping[str, object]:
    """Give ranges of amplitude, and the describing functions they were found from, as a record; angles in degrees, speeds in rad/s.

    Args:
        found: of an engine's speed under its throttle.
    """
    grid, limits = found.grid, found.limits
    record: dict[str, object] = {
        "schema": "revline.linear-range/1",
        "within": limits.error,
        "largest_amplitude_deg": grid.largest,
        "amplitudes_deg": grid.amplitudes.tolist(),
        "ranges": [_range_record(entry) for entry in found.ranges],
        "narrowest": _range_record(found.narrowest),
        "cells": cell_rows(grid),
        "missing": [{"frequency_rad_s": cell.omega, "amplitude_deg": cell.amplitude, "reason": cell.reason} for cell in grid.missing],
        "orbits_beyond_the_grid": found.orbits,
    }
    if np.isfinite(limits.distortion):
        record["distortion_within"] = limits.distortion
    return record


def cell_rows(grid: DescribingFunctions) -> list[Mapping[str, float]]:
    """List the describing functions cell by cell, those without an orbit left out."""
    error, phase, size = grid.linear_error, grid.phase_deg, np.abs(grid.gain)
    return [
        {
            "frequency_rad_s": float(grid.omega[j]),
            "amplitude_deg": float(grid.amplitudes[i]),
            "gain_rad_s_per_deg": float(size[i, j]),
            "phase_deg": float(phase[i, j]),
            "linear_error": float(error[i, j]),
            "distortion": float(grid.distortion[i, j]),
            "mean_shift_rad_s": float(grid.mean_shift[i, j]),
            "gain_error": float(grid.error[i, j]),
        }
        for i, j in np.argwhere(grid.found)
    ]


def format_ranges(found: LinearRanges, notes: Mapping[str, str | float]) -> str:
    """Format ranges as CSV: one row for each frequency, and columns of 1 and 0 for what a range ends by.

    Args:
        found: of an engine's speed under its throttle.
        notes: what the comment lines say.
    """
    columns: list[tuple[str, Sequence[float]]] = [
        ("frequency_rad_s", [entry.omega for entry in found.ranges]),
        ("amplitude_deg", [entry.amplitude for entry in found.ranges]),
        ("linear_error", [entry.error for entry in found.ranges]),
        ("distortion", [entry.distortion for entry in found.ranges]),
    ]
    columns += [(f"ended_by_{name.replace('-', '_')}", [float(ended_by(entry) == name) for entry in found.ranges]) for name in ENDS]
    return format_csv(columns, notes=notes)


def format_cells(grid: DescribingFunctions, notes: Mapping[str, str | float]) -> str:
    """Format describing functions as CSV: one row for each cell with an orbit.

    Args:
        grid: of an engine's speed under its throttle.
        notes: what the comment lines say.
    """
    rows = cell_rows(grid)
    names = list(rows[0]) if rows else ["frequency_rad_s", "amplitude_deg"]
    return format_csv([(name, [row[name] for row in rows]) for name in names], notes=notes)


def _range_record(entry: LinearRange) -> Mapping[str, object]:
    record: dict[str, object] = {
        "frequency_rad_s": entry.omega,
        "amplitude_deg": entry.amplitude,
        "ended_by": ended_by(entry),
        "linear_error": entry.error,
        "distortion": entry.distortion,
    }
    if isinstance(entry, HoldsUpTo):
        record["gain_error"] = entry.gain_error
    elif not isinstance(entry, HoldsThroughout):
        record |= {"no_orbit_at_deg": entry.refused_at, "reason": entry.reason}
    return record
