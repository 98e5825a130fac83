"""Drawing many figures at once and writing them as PNG and SVG, that carry the fingerprint of what they were drawn from."""

import functools
import hashlib
import inspect
import io
import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from revline.errors import AnalysisError, InvalidInputError, out_of_range
from revline.report.style import styled
from revline.values import fingerprint

Progress = Callable[[int, int, str], None]
"""Told after each figure: how many are done, how many there are, and the name of the last."""

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
KEY: Final = "Fingerprint"
HEAD: Final = 4096
"""Both formats carry the fingerprint within so many bytes."""

FEW: Final = 4
"""Fewer figures than this are drawn here: a worker's start costs as much as drawing four."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FigureTask:
    """A figure still to be drawn. Made by `figure_task`.

    Attributes:
        name: of the files, without their endings.
        function: draws it; of a module, so that other processes can import it.
        arguments: by position.
        options: by name.
        identity: fingerprint of all this and of the code that draws.
    """

    name: str
    function: Callable[..., Figure]
    arguments: tuple[object, ...]
    options: tuple[tuple[str, object], ...]
    identity: str

    def draw(self) -> Figure:
        """Draw the figure."""
        return self.function(*self.arguments, **dict(self.options))


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureFiles:
    """A figure that is written.

    Attributes:
        name: of the figure.
        png: its file of pixels.
        svg: its file of curves.
        is_new: whether it was drawn now; an older one of the same content is kept.
    """

    name: str
    png: Path
    svg: Path
    is_new: bool


class _Failure(NamedTuple):
    """Why a figure could not be drawn; errors themselves do not always pass from process to process."""

    name: str
    reason: str
    is_input: bool


def figure_task(name: str, function: Callable[..., Figure], *arguments: object, **options: object) -> FigureTask:
    """Describe a figure to be drawn, here or in another process.

    Args:
        name: of the files, without their endings.
        function: draws it; of a module, so that other processes can import it.
        arguments: for the function: numbers, texts, arrays, and tuples and frozen records of them.
        options: the same, by name.

    Raises:
        InvalidInputError: the name is no file name, the function is local, or an argument has no fingerprint.
    """
    if not NAME.fullmatch(name):
        message = f"figure name {name!r} is no file name; use letters, digits, points, hyphens and underscores"
        raise InvalidInputError(message)
    place = f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', '')}"
    if "<" in place or place.startswith("__main__") or not inspect.isfunction(function):
        message = f"figure {name}: {place} cannot be imported by other processes; give a function of a module"
        raise InvalidInputError(message)
    try:
        identity = fingerprint(place, _drawing_code(inspect.getfile(inspect.unwrap(function))), mpl.__version__, arguments, options)
    except InvalidInputError as error:
        message = f"figure {name}: {error}"
        raise InvalidInputError(message) from error
    return FigureTask(name=name, function=function, arguments=arguments, options=tuple(options.items()), identity=identity)


def write_figures(
    tasks: Sequence[FigureTask], folder: str | Path, *, workers: int = 2, progress: Progress | None = None
) -> tuple[FigureFiles, ...]:
    """Draw figures in parallel and write each as NAME.png and NAME.svg; those already there with the same content are kept.

    A file appears when it is whole. If some figures cannot be drawn, the others are written before the error is raised, and kept
    by the next call. Programs that call this guard their main module with `if __name__ == "__main__"`, as for all processes.

    Args:
        tasks: with different names.
        folder: made if it is missing.
        workers: processes; 1 draws in this one.
        progress: told after each figure.

    Returns:
        The files, in the order of the tasks.

    Raises:
        InvalidInputError: a name is used twice, the folder cannot be made, there is no worker, or a figure's input is unusable.
        AnalysisError: a figure could not be drawn for another reason, or a worker died.
    """
    target = _check(tasks, Path(folder), workers)
    pending = [task for task in tasks if not _is_written(task, target)]
    done = len(tasks) - len(pending)
    failures = []
    for name, failure in _draw_all(pending, target, workers if len(pending) >= FEW else 1):
        done += 1
        if failure is not None:
            failures.append(failure)
        if progress is not None:
            progress(done, len(tasks), name)
    if failures:
        reasons = "; ".join(f"figure {failure.name}: {failure.reason}" for failure in sorted(failures))
        message = f"{len(failures)} of {len(tasks)} figures could not be drawn, the others are written: {reasons}"
        raise (InvalidInputError if all(failure.is_input for failure in failures) else AnalysisError)(message)
    drawn = {task.name for task in pending}
    return tuple(
        FigureFiles(name=t.name, png=target / f"{t.name}.png", svg=target / f"{t.name}.svg", is_new=t.name in drawn) for t in tasks
    )


def render_figure(figure: Figure, identity: str) -> tuple[bytes, bytes]:
    """Render a figure as PNG and SVG; the same figure gives the same bytes on any day.

    Args:
        figure: drawn.
        identity: text that both formats carry.

    Returns:
        The content of a PNG and of an SVG file.
    """
    png, svg, dpi = io.BytesIO(), io.BytesIO(), figure.dpi
    try:
        with styled():  # not by savefig(), which draws twice
            FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": None, "Identifier": identity})  # type: ignore[no-untyped-call]  # the stubs leave it out
            figure.dpi = dpi
            FigureCanvasAgg(figure).print_png(png, metadata={"Software": None, KEY: identity})  # type: ignore[no-untyped-call]  # the stubs leave it out
    finally:
        figure.dpi = dpi
    return png.getvalue(), svg.getvalue()


def _check(tasks: Sequence[FigureTask], folder: Path, workers: int) -> Path:
    names = [task.name for task in tasks]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        message = f"two figures are named {twice[0]}; each needs its own files"
        raise InvalidInputError(message)
    if workers < 1:
        raise out_of_range("workers", workers, "processes", "1 and above", "give 1 to draw in this process")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"the folder {folder} for figures cannot be made: {error.strerror}; name one that may be written"
        raise InvalidInputError(message, path=str(folder)) from error
    return folder


def _draw_all(tasks: Sequence[FigureTask], folder: Path, workers: int) -> Iterator[tuple[str, _Failure | None]]:
    if workers == 1:
        for task in tasks:
            yield task.name, _draw_and_write(task, folder)
        return
    # Fresh processes, not forks: forks of a process with threads may hang, and compiled code starts threads.
    pool = ProcessPoolExecutor(
        min(workers, len(tasks)),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin_worker,
    )
    try:
        with _without_interrupts():
            running = {pool.submit(_draw_and_write, task, folder): task.name for task in tasks}
        for future in as_completed(running):
            yield running[future], future.result()
    except BrokenProcessPool as error:
        pool.shutdown()
        for task in tasks:
            for part in folder.glob(f".{task.name}.*.part"):
                part.unlink(missing_ok=True)
        message = (
            "a process that drew figures died, perhaps for want of memory, or because the main module is not guarded by "
            "`if __name__ == '__main__'`; what is written is kept: run again, with workers=1 if need be"
        )
        raise AnalysisError(message) from error
    finally:
        with _without_interrupts():  # a second one must not keep the workers from being told
            pool.shutdown(cancel_futures=True)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Hold interrupts back while workers start, which inherit that, or end: one cut off in between would leave this process waiting."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """Leave interrupts to the process that began this one, which lets it finish what it draws; but end with that process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _draw_and_write(task: FigureTask, folder: Path) -> _Failure | None:
    try:
        png, svg = render_figure(task.draw(), task.identity)
        for ending, content in (("png", png), ("svg", svg)):
            _replace(folder / f"{task.name}.{ending}", content)
    except InvalidInputError as error:
        return _Failure(task.name, str(error), is_input=True)
    except Exception as error:  # noqa: BLE001 - whatever it is, the message must name the figure
        return _Failure(task.name, f"{type(error).__name__}: {error}", is_input=False)
    return None


def _replace(path: Path, content: bytes) -> None:
    """Write beside and rename; a crash that leaves less than the whole is noticed by `_is_written`."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _is_written(task: FigureTask, folder: Path) -> bool:
    """Whether both files are whole and carry the task's fingerprint."""
    for ending, mark, tail in (
        ("png", f"{KEY}\0{task.identity}", b"IEND\xaeB`\x82"),
        ("svg", f"<dc:identifier>{task.identity}</dc:identifier>", b"</svg>"),
    ):
        path = folder / f"{task.name}.{ending}"
        content = path.read_bytes() if path.is_file() else b""
        if mark.encode() not in content[:HEAD] or not content.rstrip().endswith(tail):
            return False
    return True


@functools.cache
def _drawing_code(file: str) -> str:
    """Digest the code of this folder and of the file with a figure's function: other code draws another figure."""
    digest = hashlib.sha256()
    for path in (*sorted(Path(__file__).parent.glob("*.py")), Path(file)):
        digest.update(path.read_bytes())
    return digest.hexdigest()
