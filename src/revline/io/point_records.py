"""Steady states and linear models about them as records for JSON and CSV, named as the engine's users name them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from revline.analysis.linearize import Linearization
from revline.analysis.operating_range import ErrorMeasure, LineFit, OperatingRange
from revline.analysis.steady_map import Boundary, SteadyMap
from revline.analysis.trim import Trim
from revline.io.csv_text import format_csv
from revline.lti.root_regions import RootsInRegion
from revline.lti.roots import RightmostRoots
from revline.lti.state_space import DelayStateSpace, Signal
from revline.units import speed_to_rpm

MAP_COLUMNS = (
    ("throttle_deg", "throttle"),
    ("speed_rad_s", "engine_speed"),
    ("pressure_kpa", "manifold_pressure"),
    ("indicated_torque_n_m", "indicated_torque"),
    ("friction_torque_n_m", "friction_torque"),
    ("cylinder_air_rate_kg_s", "cylinder_air_rate"),
)
"""Columns of a map's file, and the signal of each."""


def trim_record(trim: Trim, model: DelayStateSpace) -> Mapping[str, object]:
    """Give a steady operating point of an engine as a record.

    Args:
        trim: the point.
        model: linearised there; it gives the gain at rest.

    Raises:
        InvalidInputError: the system lacks the signals of an engine.
        AnalysisError: the model integrates, so that it has no gain at rest.
    """
    speed = trim.output("engine_speed")
    return {
        "engine": trim.system,
        "throttle_deg": trim.input("throttle"),
        "load_n_m": trim.input("load_torque"),
        "speed_rad_s": speed,
        "speed_rpm": speed_to_rpm(speed),
        "pressure_kpa": trim.output("manifold_pressure"),
        "gain_rad_s_per_deg": model.static_gain("throttle", "engine_speed"),
        "residual": trim.residual,
        "stable": trim.stable,
        "unstable_roots": trim.unstable_count,
        "rightmost_roots_rad_s": _pairs(trim.roots.roots),
        "lags_s": {variable.name: trim.lag(variable.name) for variable in trim.channel_variables},
        "outputs": {v.name: {"value": trim.output(v.name), "unit": v.unit} for v in trim.output_variables},
        "alternatives": [_alternative(other) for other in trim.alternatives],
        "warnings": trim_warnings(trim),
    }


def trim_warnings(trim: Trim) -> list[str]:
    """Say what else a reader of an engine's trim should know: that it is unstable, other steady states, states left out."""
    found = [str(entry) for entry in trim.left_out]
    if not trim.stable:
        found.insert(0, f"open-loop unstable: {trim.unstable_count} characteristic roots in the right half-plane")
    for other in trim.alternatives:
        kind = "stable" if other.stable else "unstable"
        found.append(f"there is another, {kind} steady state at {other.output('engine_speed'):.6g} rad/s")
    return found


def map_record(steady_map: SteadyMap, *, load: float) -> Mapping[str, object]:
    """Give a steady-state map of an engine over its throttle as a record.

    Args:
        steady_map: swept over the throttle.
        load: torque at which it was made, in N m.
    """
    return {
        "engine": steady_map.system,
        "load_n_m": load,
        "steady_map": [
            {
                "throttle_deg": trim.input("throttle"),
                "speed_rad_s": trim.output("engine_speed"),
                "pressure_kpa": trim.output("manifold_pressure"),
                **{name: trim.output(signal) for name, signal in MAP_COLUMNS[3:]},
                "stable": trim.stable,
            }
            for trim in steady_map.trims
        ],
        "ends": [_end_record(end) for end in steady_map.boundaries],
        "warnings": list(steady_map.warnings),
    }


def _end_record(end: Boundary) -> Mapping[str, object]:
    """Where steady states end; with `undecided_to_deg` where the end lies somewhere between the two."""
    open_to = {"undecided_to_deg": end.without.value} if end.undecided else {}
    return {"throttle_deg": end.value, "speed_rad_s": end.trim.output("engine_speed"), **open_to}


def format_map(steady_map: SteadyMap, *, load: float) -> str:
    """Format a steady-state map of an engine over its throttle as CSV; the column `stable` is 1 or 0.

    Args:
        steady_map: swept over the throttle.
        load: torque at which it was made, in N m.
    """
    columns: list[tuple[str, ArrayLike]] = [
        (name, [trim.input(signal) if signal == "throttle" else trim.output(signal) for trim in steady_map.trims])
        for name, signal in MAP_COLUMNS
    ]
    stable = ("stable", [trim.stable for trim in steady_map.trims])
    return format_csv([*columns, stable], notes={"engine": steady_map.system, "load_n_m": load})


def line_record(line: LineFit) -> Mapping[str, object]:
    """Give a straight line through the steady speeds of an engine over a range of its throttle as a record.

    Args:
        line: of a map swept over the throttle.
    """
    return {
        "low_deg": line.low,
        "high_deg": line.high,
        "slope_rad_s_per_deg": line.slope,
        "intercept_rad_s": line.intercept,
        "max_error_rad_s": line.max_error,
        "max_error_at_deg": line.max_error_at,
        **({"max_error_of_span": line.max_error_fraction} if line.span else {}),
    }


def operating_range_record(found: OperatingRange) -> Mapping[str, object]:
    """Give the widest range of an engine's throttle in which a straight line holds as a record.

    Args:
        found: on a map swept over the throttle.
    """
    return {
        **line_record(found.line),
        "centre_deg": found.centre,
        "tolerance": found.tolerance,
        "tolerance_is": "part of the span" if found.measure is ErrorMeasure.FRACTION else "rad/s",
        "limited_by": found.limited_by.value,
    }


def linearization_record(linearization: Linearization, trim: Trim) -> Mapping[str, Any]:
    """Give an exact linear model about a steady state as a record: dx = A x + Bu u + Bz zd, y = Cy x + .., z = Cz x + ...

    Args:
        linearization: of an engine.
        trim: the steady state.
    """
    model, limits = linearization.model, linearization.find_limits()
    blocks = {name: getattr(model, name) for name in ("A", "Bu", "Bz", "Cy", "Dyu", "Dyz", "Cz", "Dzu", "Dzz")}
    return {
        "schema": "revline.linearization/1",
        "states": _names(model.states),
        "inputs": _names(model.inputs),
        "outputs": _names(model.outputs),
        "channels": _names(model.channels),
        "units": {kind: [signal.unit for signal in getattr(model, kind)] for kind in ("states", "inputs", "outputs", "channels")},
        "lags_s": model.lags,
        **blocks,
        "operating_point": trim_record(trim, model),
        "residual": trim.residual,
        "stable": trim.stable,
        "kinks": [
            {"result": k.result, "argument": k.argument, "below": k.below, "above": k.above, "used": k.used, "side": k.side}
            for k in linearization.kinks
        ],
        "limits": [
            {"results": list(m.results), "argument": m.argument, "at": m.at, "change": m.change, "unit": m.unit, "share": m.share}
            for m in limits
        ],
        **({"spectral_abscissa_rad_s": trim.roots.spectral_abscissa} if trim.roots.roots.size else {}),
        "warnings": [*trim_warnings(trim), *linearization.warnings(limits)],
    }


def roots_record(roots: RightmostRoots) -> Mapping[str, Any]:
    """Give right-most characteristic roots as a record.

    Args:
        roots: of a linear model.
    """
    return {"roots_rad_s": _pairs(roots.roots), "root_errors_rad_s": roots.errors, "unstable_roots": roots.unstable_count}


def region_roots_record(found: RootsInRegion) -> Mapping[str, Any]:
    """Give all characteristic roots right of a line as a record.

    Args:
        found: in a region that is open to the right.
    """
    return {
        "roots_rad_s": _pairs(found.roots),
        "root_errors_rad_s": found.errors,
        "roots_right_of_rad_s": found.region.left,
        "roots_counted": found.counted,
    }


def _pairs(roots: ArrayLike) -> list[list[float]]:
    return [[root.real, root.imag] for root in np.asarray(roots, dtype=complex).tolist()]


def _alternative(trim: Trim) -> Mapping[str, object]:
    return {
        "throttle_deg": trim.input("throttle"),
        "speed_rad_s": trim.output("engine_speed"),
        "pressure_kpa": trim.output("manifold_pressure"),
        "stable": trim.stable,
    }


def _names(signals: tuple[Signal, ...]) -> list[str]:
    return [signal.name for signal in signals]
