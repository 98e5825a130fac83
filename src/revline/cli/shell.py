"""What all commands do alike: show results and warnings, progress, and write files; nothing here knows an engine.

Results go to stdout, as tables for people or as one JSON object; progress, warnings and errors go to stderr.
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from rich.console import Console

STDOUT = "-"
"""What `--out` calls stdout."""

PIPE_WIDTH = 200
"""Columns of tables where no terminal sets their width."""


class Facts(NamedTuple):
    """Quantities below each other: name, value, unit."""

    title: str
    rows: Sequence[tuple[str, float | str, str]]


class Grid(NamedTuple):
    """A table with a header."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[float | str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shell:
    """How one command talks.

    Attributes:
        json: whether the result is printed as JSON.
        quiet: whether progress and warnings are left out.
    """

    json: bool
    quiet: bool

    def show(self, record: Mapping[str, object], *parts: Facts | Grid | str, text_on: Path | None = None) -> None:
        """Print a result: the record as JSON, or the parts for people.

        Args:
            record: the result, as JSON has it.
            parts: the same for people.
            text_on: where the command has written its file; if that was stdout, the parts go to stderr.
        """
        if self.json:
            from revline.io.json_files import format_json

            sys.stdout.write(format_json(record))
            return
        console = make_console(stderr=is_stdout(text_on))
        for part in parts:
            show_part(console, part)
        if text_on is not None and not is_stdout(text_on):
            console.print(f"written: {text_on}", markup=False, highlight=False, soft_wrap=True)

    def warn(self, *warnings: str) -> None:
        """Print warnings on stderr."""
        if self.quiet or not warnings:
            return
        for warning in warnings:
            say(f"warning: {warning}", style="yellow")

    def prepare(self, out: Path | None, what: str) -> None:
        """Refuse a file that cannot be written, before any long work.

        Args:
            out: the file.
            what: what it is, for messages.

        Raises:
            InvalidInputError: it cannot be written, or JSON and file would both go to stdout.
        """
        if is_stdout(out):
            if self.json:
                message = f"the {what} and the JSON cannot both go to stdout; name a file after --out, or leave --json out"
                raise InvalidInputError(message)
            return
        if out is not None:
            from revline.io.atomic import check_writable

            check_writable(out, what)

    def prepare_each(self, *files: tuple[Path | None, str]) -> None:
        """Refuse files that cannot be written, and two results for one file, of which one would be lost.

        Args:
            files: each with what it is, for messages.

        Raises:
            InvalidInputError: as `prepare`, or two are the same file.
        """
        seen: dict[Path, str] = {}
        for path, what in files:
            self.prepare(path, what)
            key = None if path is None else path.absolute()
            if key in seen:
                message = f"the {seen[key]} and the {what} cannot both be written to {path}; name a file for each"
                raise InvalidInputError(message)
            if key is not None:
                seen[key] = what

    def write(self, out: Path | None, text: str, what: str) -> None:
        """Write a file whole or not at all, or to stdout; nowhere where no file is named."""
        if is_stdout(out):
            sys.stdout.write(text)
        elif out is not None:
            from revline.io.atomic import write_atomically

            write_atomically(out, text, what)

    @contextmanager
    def busy(self, text: str) -> Iterator[None]:
        """Show that a computation of unknown length goes on, where stderr is a terminal."""
        if self.quiet or not sys.stderr.isatty():
            yield
            return
        with make_console(stderr=True).status(text):
            yield

    @contextmanager
    def progress(self, text: str) -> Iterator[Callable[[float], None]]:
        """Show how far a long computation is, with the time it still needs, where stderr is a terminal.

        Args:
            text: what is computed.

        Yields:
            What the computation tells which part is done, 0 to 1.
        """
        if self.quiet or not sys.stderr.isatty():
            yield _ignore
            return
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        with Progress(*columns, console=make_console(stderr=True), transient=True) as bar:
            task = bar.add_task(text, total=1.0)
            yield lambda done: bar.update(task, completed=done)

    @contextmanager
    def stages(self, text: str) -> Iterator[Callable[[str, float], None]]:
        """Show the stage under way of a long computation, how far it is, and the time it still needs, where stderr is a terminal.

        Args:
            text: what is computed.

        Yields:
            What the computation tells the stage's name and which part of the whole is done, 0 to 1.
        """
        if self.quiet or not sys.stderr.isatty():
            yield lambda _, __: None
            return
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description:<28}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        with Progress(*columns, console=make_console(stderr=True), transient=True) as bar:
            task = bar.add_task(text, total=1.0)
            yield lambda stage, done: bar.update(task, completed=done, description=f"{text}: {stage}")


def is_stdout(out: Path | None) -> bool:
    """Whether a command's file is stdout."""
    return out is not None and str(out) == STDOUT


def make_console(*, stderr: bool) -> "Console":
    """Make a console as wide as the terminal, or wide enough where there is none."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, width=None if stream.isatty() else PIPE_WIDTH)


def say(text: str, *, style: str) -> None:
    """Print a line on stderr, its brackets and its length left alone."""
    make_console(stderr=True).print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def show_part(console: "Console", part: Facts | Grid | str) -> None:
    """Print one part of a result."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    if isinstance(part, str):
        console.print(part, markup=False, highlight=False, soft_wrap=True)
        return
    if part.title:  # not the table's own title, which a narrow table would break
        console.print(Text(part.title, style="italic"), soft_wrap=True)
    table = Table(box=box.SIMPLE, show_header=isinstance(part, Grid), pad_edge=False)
    if isinstance(part, Grid):
        for k, name in enumerate(part.header):
            numbers = any(not isinstance(row[k], str) for row in part.rows)
            table.add_column(Text(name), justify="right" if numbers else "left")
    else:
        for _ in range(3):
            table.add_column()
    for row in part.rows:
        table.add_row(*(Text(cell if isinstance(cell, str) else f"{cell:.6g}") for cell in row))
    console.print(table)


def show_roots(roots: Iterable[complex]) -> str:
    """Word roots: real ones without an imaginary part; "none" where there are none."""
    return ", ".join(f"{root.real:.5g}" if root.imag == 0.0 else f"{root:.5g}" for root in roots) or "none"


def _ignore(_: float) -> None:
    """Where nobody looks at progress."""
