"""The command compare: what two studies have different."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import JsonOption, QuietOption
from revline.cli.shell import Facts, Grid, Shell

if TYPE_CHECKING:
    from revline.studies.comparison import Leaf

SHOWN = 20
"""Differences and one-sided entries that are shown to people; --json has all of them."""


def compare(
    *,
    first: Annotated[Path, typer.Argument(metavar="DIR1", help="Folder of a study, or its results.json.")],
    second: Annotated[Path, typer.Argument(metavar="DIR2", help="Folder of another.")],
    tolerance: Annotated[float, typer.Option("--tolerance", metavar="REL", help="Relative difference that counts as none.")] = 1e-9,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Compare the results of two studies: every number and outcome that differs, the largest difference first.

    Entries are matched by their names, such as controller and plant, or method and frequency. A difference is a result, not a failure:
    the exit status is 0 with or without any.
    """
    from revline.studies.comparison import compare_studies

    shell = Shell(json=json, quiet=quiet)
    found = compare_studies(first, second, tolerance=tolerance)
    record = {
        "same": found.same,
        "compared": found.compared,
        "tolerance": found.tolerance,
        "differences": [{"path": d.path, "first": d.first, "second": d.second, "relative": d.relative} for d in found.differences],
        "only_first": list(found.only_first),
        "only_second": list(found.only_second),
    }
    facts = (
        ("numbers and outcomes compared", f"{found.compared}", ""),
        ("different", f"{len(found.differences)}", f"by more than {found.tolerance:g} of themselves"),
        ("only in the first", f"{len(found.only_first)}", _some(found.only_first)),
        ("only in the second", f"{len(found.only_second)}", _some(found.only_second)),
    )
    rows = [(d.path, _word(d.first), _word(d.second), f"{d.relative:.2g}") for d in found.differences[:SHOWN]]
    parts: list[Facts | Grid | str] = [Facts(f"{first} and {second}: {'the same' if found.same else 'different'}", facts)]
    if rows:
        parts.append(Grid("Largest differences", ("where", "first", "second", "relative"), rows))
    shell.show(record, *parts)


def _some(paths: tuple[str, ...]) -> str:
    return ", ".join(paths[:2]) + (", ..." if len(paths) > 2 else "")


def _word(value: "Leaf") -> str:
    return str(value) if isinstance(value, bool | str) else f"{value:.8g}"
