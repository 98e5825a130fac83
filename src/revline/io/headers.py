"""Column names that carry the unit: `engine_speed_rad_s`, `indicated_torque_n_m`, `manifold_pressure_kpa`."""

import re

from revline.system import Variable


def header_of(variable: Variable) -> str:
    """Name the column of a signal, with its unit: `rad/s^2` becomes `rad_s2`, and the unit 1 of what has none is `1`.

    Args:
        variable: the signal.
    """
    return header(variable.name, variable.unit)


def header(name: str, unit: str) -> str:
    """Name the column of a quantity with a unit."""
    return f"{name}_{re.sub(r'[^a-z0-9]+', '_', unit.lower().replace('^', '')).strip('_')}"
