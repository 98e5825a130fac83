"""What page and paper share."""

import pytest

from revline.report.blocks import Align, Check, Column, TableBlock
from revline.report.inline import Math, Text
from revline.report.layout import Group, checks_in_words, groups, paddings, shown_check


def column_of(*cells: Text, align: Align = Align.DECIMAL) -> tuple[str, ...]:
    table = TableBlock(caption="x", columns=(Column(heading="x", align=align),), rows=tuple((cell,) for cell in cells))
    return tuple(row[0] for row in paddings(table))


def test_numbers_are_padded_to_the_longest_fraction() -> None:
    assert column_of("1", "0.25", "\u221212.5", "+3.000") == (".000", "0", "00", "")


def test_what_is_no_number_is_not_padded() -> None:
    assert column_of("1.2\u00d710⁻⁵", "\u2013", (Math("x"),), "0.5") == ("", "", "", "")
    assert column_of("1", "2") == ("", "")


@pytest.mark.parametrize("align", [Align.LEFT, Align.CENTRE, Align.RIGHT])
def test_other_columns_are_not_padded(align: Align) -> None:
    assert column_of("1", "0.25", align=align) == ("", "")


def test_a_table_without_rows_needs_no_padding() -> None:
    assert column_of() == ()


def columns(*names: str) -> tuple[Column, ...]:
    return tuple(Column(heading="x", group=name) for name in names)


def test_neighbours_of_one_group_share_its_heading() -> None:
    assert groups(columns("", "a", "a", "b", "", "", "a")) == (
        Group("", 1),
        Group("a", 2),
        Group("b", 1),
        Group("", 1),
        Group("", 1),
        Group("a", 1),
    )
    assert groups(columns("", "")) == ()


def check(measured: float, tolerance: float = 0.01) -> Check:
    return Check(name="speed", measured=measured, expected=240.799, tolerance=tolerance, unit="rad/s")


def test_a_check_is_shown_finer_than_its_tolerance() -> None:
    shown = shown_check(check(240.8))
    assert (shown.measured, shown.expected, shown.tolerance, shown.percent, shown.passed) == ("240.800", "240.799", "0.010", 10, True)


def test_a_check_far_off_uses_no_more_than_999_per_cent() -> None:
    assert (shown_check(check(300.0)).percent, shown_check(check(300.0)).passed) == (999, False)


def test_a_check_without_tolerance_shows_none() -> None:
    assert shown_check(check(240.799, 0.0)).tolerance == "0"


def test_what_should_be_nothing_shows_how_near_it_is() -> None:
    """Decimals would show 0.0000000 for a residual of 1e-15, which says nothing."""
    shown = shown_check(Check(name="residual", measured=1.23e-15, expected=0.0, tolerance=1e-6))
    assert (shown.measured, shown.expected) == ("1.2\N{MULTIPLICATION SIGN}10⁻¹⁵", "0")


def test_a_yes_or_no_is_a_whole_number() -> None:
    shown = shown_check(Check(name="stable (1) or not (0)", measured=1.0, expected=1.0, tolerance=0.0))
    assert (shown.measured, shown.expected) == ("1", "1")


def test_checks_are_counted_in_words() -> None:
    good, bad = check(240.8), check(300.0)
    assert checks_in_words(()) == ""
    assert checks_in_words((good,)) == "The one check holds"
    assert checks_in_words((good, good)) == "All 2 checks hold"
    assert checks_in_words((good, bad)) == "1 of 2 checks hold"
