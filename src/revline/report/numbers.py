"""Numbers as a reader wants them: a stated number of significant digits, deviations in per cent, units as printed."""

import math
import re
from types import MappingProxyType

from revline.errors import InvalidInputError
from revline.report.blocks import Check

MINUS = "\u2212"
THIN = "\u202f"
"""A narrow space that does not break."""
NO_BREAK = "\u00a0"

_SUPERSCRIPTS = MappingProxyType(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
_LARGEST_PLAIN = 6
_SMALLEST_PLAIN = -4
_POWER = re.compile(r"(?<=[A-Za-z)])(-?\d+)")


def format_number(value: float, digits: int = 4) -> str:
    """Write a number with so many significant digits, trailing zeros kept; powers of ten beyond a million and below 1e-4.

    Args:
        value: finite.
        digits: significant digits, at least 1.

    Returns:
        For example "240.8", or "1.20" and its power of ten, raised; the minus sign is the typographic one.

    Raises:
        InvalidInputError: the number is not finite or there is no digit to show.
    """
    _require_finite("a number to be shown", value)
    if digits < 1:
        message = f"digits = {digits} shows nothing; give 1 or more"
        raise InvalidInputError(message, digits=float(digits))
    if value == 0.0:
        return "0"
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    exponent = int(power)
    if _SMALLEST_PLAIN <= exponent < max(_LARGEST_PLAIN, digits):
        return _with_minus(f"{float(f'{value:.{digits - 1}e}'):.{max(digits - 1 - exponent, 0)}f}")
    return f"{_with_minus(mantissa)}\u00d710{str(exponent).translate(_SUPERSCRIPTS)}"


def format_decimals(value: float, decimals: int) -> str:
    """Write a number with so many decimals, for columns whose numbers share a resolution.

    Raises:
        InvalidInputError: the number is not finite.
    """
    _require_finite("a number to be shown", value)
    text = f"{value:.{max(decimals, 0)}f}"
    return _with_minus(text if float(text) != 0.0 else text.lstrip("-"))


def format_quantity(value: float, unit: str, digits: int = 4) -> str:
    """Write a number and its unit, with a space that does not break: "240.8 rad/s"."""
    shown = format_unit(unit)
    number = format_number(value, digits)
    return f"{number}{THIN}{shown}" if shown else number


def format_unit(unit: str) -> str:
    """Print a unit symbol: powers raised, products held together; empty for a pure number.

    Args:
        unit: as in `revline.units`, such as "kg m2" or "1".

    Returns:
        For example "kg m²", with a space that does not break.
    """
    if unit in {"", "1"}:
        return ""
    return _POWER.sub(lambda found: found[1].translate(_SUPERSCRIPTS), unit).replace(" ", NO_BREAK)


def deviation_percent(measured: float, reference: float) -> float:
    """How far a number lies from its reference, in per cent of the reference.

    Raises:
        InvalidInputError: a number is not finite, or the reference is 0.
    """
    _require_finite("a measured number", measured)
    _require_finite("a reference", reference)
    if reference == 0.0:
        message = "a deviation from 0 has no per cent; show the difference instead"
        raise InvalidInputError(message, measured=measured)
    return 100.0 * (measured - reference) / abs(reference)


def format_deviation(measured: float, reference: float, decimals: int = 2) -> str:
    """Write a deviation with its sign, without the per cent sign, for a column whose unit is "%": "+0.12", "0.00"."""
    text = format_decimals(deviation_percent(measured, reference), decimals)
    return text if text.startswith(MINUS) or not text.strip("0.") else f"+{text}"


def check_decimals(check: Check) -> int:
    """Decimals that show a check's numbers one digit finer than its tolerance, at most 9; 4 significant digits where that is 0."""
    scale = check.tolerance or max(abs(check.expected), abs(check.measured)) * 1e-2
    return 0 if scale == 0.0 else min(max(1 - math.floor(math.log10(scale)), 0), 9)


def share_of_tolerance(check: Check) -> float:
    """How much of its tolerance a check uses: 0 is exact, above 1 it fails; a check without tolerance uses 0 or all and more."""
    deviation = abs(check.measured - check.expected)
    if check.tolerance > 0.0:
        return deviation / check.tolerance
    return 0.0 if deviation == 0.0 else 2.0


def _with_minus(text: str) -> str:
    return text.replace("-", MINUS)


def _require_finite(what: str, value: float) -> None:
    if not math.isfinite(value):
        message = f"{what} is {value}; show only finite numbers, and say in words what does not exist"
        raise InvalidInputError(message)
