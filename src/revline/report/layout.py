"""What page and paper share: cells padded to their decimal points, headings grouped, checks in words and numbers."""

import re
from typing import NamedTuple

from revline.report.blocks import Align, Check, Column, TableBlock
from revline.report.inline import Text
from revline.report.numbers import check_decimals, format_decimals, format_number, format_unit, share_of_tolerance

_NUMBER = re.compile(r"[+\u2212-]?\d+(\.\d+)?")


class Group(NamedTuple):
    """A heading above neighbouring columns; empty where they have none of their own."""

    heading: str
    columns: int


class ShownCheck(NamedTuple):
    """A check as its row shows it."""

    name: str
    measured: str
    expected: str
    tolerance: str
    unit: str
    percent: int
    passed: bool


def paddings(table: TableBlock) -> tuple[tuple[str, ...], ...]:
    """What each cell lacks at its right to stand by its column's decimal point: "" or, for "1" among "0.25", ".00"."""
    columns = tuple(_paddings_of_column(column, tuple(row[place] for row in table.rows)) for place, column in enumerate(table.columns))
    return tuple(zip(*columns, strict=True)) if table.rows else ()


def _paddings_of_column(column: Column, cells: tuple[Text, ...]) -> tuple[str, ...]:
    if column.align is not Align.DECIMAL:
        return ("",) * len(cells)
    fractions = [_fraction(cell) for cell in cells]
    longest = max((len(fraction) for fraction in fractions if fraction is not None), default=0)
    full = "." + "0" * (longest - 1) if longest else ""
    return tuple("" if fraction is None else full[len(fraction) :] for fraction in fractions)


def _fraction(cell: Text) -> str | None:
    """The decimal point and what follows; None where the cell is no plain number."""
    found = _NUMBER.fullmatch(cell) if isinstance(cell, str) else None
    return None if found is None else found[1] or ""


def groups(columns: tuple[Column, ...]) -> tuple[Group, ...]:
    """The headings above the headings; none where no column has one."""
    if not any(column.group for column in columns):
        return ()
    found: list[Group] = []
    for column in columns:
        if found and column.group and found[-1].heading == column.group:
            found[-1] = Group(column.group, found[-1].columns + 1)
        else:
            found.append(Group(column.group, 1))
    return tuple(found)


def shown_check(check: Check) -> ShownCheck:
    """A check with its numbers one digit finer than its tolerance; what should be 0 shows how near it is, a yes or no is 1 or 0."""
    measured, expected = _shown_numbers(check)
    return ShownCheck(
        name=check.name,
        measured=measured,
        expected=expected,
        tolerance=format_number(check.tolerance, 2) if check.tolerance else "0",
        unit=format_unit(check.unit),
        percent=round(100.0 * min(share_of_tolerance(check), 9.99)),
        passed=check.passed,
    )


def _shown_numbers(check: Check) -> tuple[str, str]:
    if check.expected == 0.0 and check.tolerance > 0.0:
        return format_number(check.measured, 2), "0"
    whole = check.tolerance == 0.0 and check.measured.is_integer() and check.expected.is_integer()
    decimals = 0 if whole else check_decimals(check)
    return format_decimals(check.measured, decimals), format_decimals(check.expected, decimals)


def checks_in_words(checks: tuple[Check, ...]) -> str:
    """How many hold: "All 25 checks hold", "24 of 25 checks hold"; empty where there are none."""
    if not checks:
        return ""
    passed = sum(check.passed for check in checks)
    if passed == len(checks):
        return "The one check holds" if passed == 1 else f"All {passed} checks hold"
    return f"{passed} of {len(checks)} checks hold"
