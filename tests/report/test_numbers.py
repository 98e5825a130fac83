"""Numbers as a reader wants them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.report.blocks import Check
from revline.report.numbers import (
    check_decimals,
    deviation_percent,
    format_decimals,
    format_deviation,
    format_number,
    format_quantity,
    format_unit,
    share_of_tolerance,
)

TO_ASCII = str.maketrans("\u2212⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "--0123456789")


def check(measured: float, expected: float, tolerance: float) -> Check:
    return Check(name="speed", measured=measured, expected=expected, tolerance=tolerance)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (240.79901, 4, "240.8"),
        (240.79901, 6, "240.799"),
        (0.0344, 4, "0.03440"),
        (-1.4, 3, "\u22121.40"),
        (9.9996, 4, "10.00"),
        (498636.0, 6, "498636"),
        (498636.0, 3, "499000"),
        (1234567.0, 3, "1.23\u00d710⁶"),
        (1.2e-5, 2, "1.2\u00d710⁻⁵"),
        (0.0, 4, "0"),
    ],
)
def test_numbers_have_the_digits_asked_for(value: float, digits: int, text: str) -> None:
    assert format_number(value, digits) == text


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(1, 12))
def test_a_number_reads_back_within_its_digits(value: float, digits: int) -> None:
    text = format_number(value, digits).translate(TO_ASCII).replace("\u00d710", "e")
    assert float(text) == float(f"{value:.{digits - 1}e}")


def test_numbers_without_a_form_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="a number to be shown is nan"):
        format_number(math.nan)
    with pytest.raises(InvalidInputError, match="digits = 0 shows nothing"):
        format_number(1.0, 0)


def test_decimals_drop_the_sign_of_zero() -> None:
    assert format_decimals(-0.001, 2) == "0.00"
    assert format_decimals(-0.126, 2) == "\u22120.13"


@pytest.mark.parametrize(("unit", "shown"), [("1", ""), ("rad/s", "rad/s"), ("kg m2", "kg\u00a0m²"), ("rad/s2", "rad/s²"), ("m3", "m³")])
def test_units_are_printed_with_raised_powers(unit: str, shown: str) -> None:
    assert format_unit(unit) == shown


def test_a_quantity_holds_together() -> None:
    assert format_quantity(240.79901, "rad/s") == "240.8\u202frad/s"
    assert format_quantity(0.5, "1", 2) == "0.50"


def test_deviations_are_in_per_cent_of_the_references_size() -> None:
    assert deviation_percent(-1.01, -1.0) == pytest.approx(-1.0)
    assert format_deviation(1.0012, 1.0) == "+0.12"
    assert format_deviation(0.986, 1.0) == "\u22121.40"
    assert format_deviation(1.000001, 1.0) == "0.00"


def test_a_deviation_from_nothing_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="a deviation from 0 has no per cent"):
        deviation_percent(1.0, 0.0)


@pytest.mark.parametrize(("tolerance", "decimals"), [(0.001, 4), (0.5, 2), (2.0, 1), (30.0, 0), (1e-12, 9)])
def test_a_check_is_shown_finer_than_its_tolerance(tolerance: float, decimals: int) -> None:
    assert check_decimals(check(1.0, 1.0, tolerance)) == decimals


def test_a_check_without_tolerance_is_shown_by_its_size() -> None:
    assert check_decimals(check(42.0, 42.0, 0.0)) == 2
    assert check_decimals(check(0.0, 0.0, 0.0)) == 0


def test_the_share_of_the_tolerance_tells_how_close_a_check_is() -> None:
    assert share_of_tolerance(check(1.5, 1.0, 1.0)) == 0.5
    assert share_of_tolerance(check(1.0, 1.0, 0.0)) == 0.0
    assert share_of_tolerance(check(1.1, 1.0, 0.0)) > 1.0
