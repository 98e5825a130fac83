import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.errors import AnalysisError, InvalidInputError
from revline.report import figure_files
from revline.report.curves import plot_curves
from revline.report.figure_files import FigureTask, figure_task, render_figure, write_figures
from revline.report.parts import Curve
from revline.report.poles import PoleSet, plot_poles
from revline.report.style import DPI, TIME, Quantity

ROOT = Path(__file__).parents[2]
T = np.linspace(0.0, 1.0, 50)


def curve_task(name: str, factor: float = 1.0) -> FigureTask:
    return figure_task(name, plot_curves, (Curve(x=T, y=factor * T),), TIME, Quantity("speed", "rad/s"))


def bad_task(name: str) -> FigureTask:
    """A task whose arguments are found to be unusable only when it draws."""
    return figure_task(name, plot_poles, (PoleSet((float("nan"),), "G0"),))


def broken_task(name: str) -> FigureTask:
    """A task that fails for another reason than its input: text where numbers are due."""
    return figure_task(name, plot_poles, (PoleSet(("no number",), "G0"),))


def parts(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("workers", [1, 2])
def test_figures_are_written_in_both_forms(tmp_path: Path, workers: int) -> None:
    tasks = [curve_task(f"3.{k}", k + 1.0) for k in range(5)]
    told: list[tuple[int, int, str]] = []
    folder = tmp_path / "made" / "figures"
    files = write_figures(tasks, folder, workers=workers, progress=lambda *news: told.append(news))
    assert [file.name for file in files] == [task.name for task in tasks]
    assert all(file.is_new and file.png.stat().st_size > 8000 and file.svg.read_text().endswith("</svg>\n") for file in files)
    assert parts(folder) == sorted(f"3.{k}.{ending}" for k in range(5) for ending in ("png", "svg"))
    assert [(done, whole) for done, whole, _ in told] == [(k, 5) for k in range(1, 6)]
    assert {name for _, _, name in told} == {task.name for task in tasks}


def test_bytes_do_not_depend_on_the_process(tmp_path: Path) -> None:
    tasks = [curve_task(f"3.{k}", k + 1.0) for k in range(4)]
    here, there = (write_figures(tasks, tmp_path / str(workers), workers=workers) for workers in (1, 2))
    for one, other in zip(here, there, strict=True):
        assert one.png.read_bytes() == other.png.read_bytes()
        assert one.svg.read_bytes() == other.svg.read_bytes()


def test_what_is_written_is_kept_until_its_content_changes(tmp_path: Path) -> None:
    write_figures([curve_task("a"), curve_task("b")], tmp_path, workers=1)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    files = write_figures([curve_task("a"), curve_task("b", 2.0)], tmp_path, workers=1)
    assert [file.is_new for file in files] == [False, True]
    changed = {path.name for path, time in before.items() if path.stat().st_mtime_ns != time}
    assert changed == {"b.png", "b.svg"}


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_a_file_that_is_missing_or_cut_is_drawn_anew(tmp_path: Path, ending: str) -> None:
    task = curve_task("a")
    path = tmp_path / f"a.{ending}"
    whole = write_figures([task], tmp_path)[0].png.read_bytes(), (tmp_path / "a.svg").read_bytes()
    for damage in (path.unlink, lambda: path.write_bytes(path.read_bytes()[:-40])):
        damage()
        assert write_figures([task], tmp_path)[0].is_new
        assert ((tmp_path / "a.png").read_bytes(), (tmp_path / "a.svg").read_bytes()) == whole


def test_other_code_draws_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    before = curve_task("a").identity
    assert curve_task("a").identity == before
    monkeypatch.setattr(figure_files, "_drawing_code", lambda _file: "other code")
    assert curve_task("a").identity != before


def test_options_count_as_content() -> None:
    speed = Quantity("speed", "rad/s")
    tasks = [figure_task("a", plot_curves, (Curve(x=T, y=T),), TIME, speed, notes=notes) for notes in ((), ((0.0, 0.0, "start"),))]
    assert tasks[0].identity != tasks[1].identity
    assert tasks[0].options == (("notes", ()),)


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_names_its_figure_and_leaves_the_others(tmp_path: Path, workers: int) -> None:
    tasks = [*(curve_task(f"3.{k}", k + 1.0) for k in range(4)), bad_task("6.1")]
    with pytest.raises(
        InvalidInputError, match=r"1 of 5 figures could not be drawn, the others are written: figure 6\.1: poles of G0 cannot"
    ):
        write_figures(tasks, tmp_path, workers=workers)
    assert parts(tmp_path) == sorted(f"3.{k}.{ending}" for k in range(4) for ending in ("png", "svg"))
    assert not any(file.is_new for file in write_figures(tasks[:4], tmp_path))


def test_an_error_of_another_kind_names_its_figure_too(tmp_path: Path) -> None:
    with pytest.raises(AnalysisError, match=r"2 of 2 figures .* figure 6\.1: poles of G0 .*; figure 6\.2: ValueError: "):
        write_figures([broken_task("6.2"), bad_task("6.1")], tmp_path, workers=1)


def test_a_folder_that_refuses_files_names_the_figure(tmp_path: Path) -> None:
    (tmp_path / "a.png").mkdir()
    with pytest.raises(AnalysisError, match=r"figure a: IsADirectoryError"):
        write_figures([curve_task("a")], tmp_path)
    assert parts(tmp_path) == ["a.png"]


def test_a_worker_that_dies_is_reported(tmp_path: Path) -> None:
    deadly = FigureTask(name="6.1", function=os._exit, arguments=(1,), options=(), identity="deadly")
    with pytest.raises(AnalysisError, match="a process that drew figures died, perhaps for want of memory"):
        write_figures([*(curve_task(f"3.{k}") for k in range(4)), deadly], tmp_path)
    assert not any(name.endswith(".part") for name in parts(tmp_path))


INTERRUPTED = """
import os, signal, sys, threading
from pathlib import Path
from tests.report.test_figure_files import curve_task
from revline.report.figure_files import write_figures

if __name__ == "__main__":
    def press() -> None:
        for _ in range(2):
            os.killpg(0, signal.SIGINT)

    threading.Timer(float(sys.argv[2]), press).start()
    try:
        write_figures([curve_task(f"3.{k}", k + 1.0) for k in range(40)], sys.argv[1])
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.slow
@pytest.mark.parametrize("after", [0.0, 0.2, 1.5])
def test_an_interrupt_of_all_processes_twice_ends_the_drawing(tmp_path: Path, after: float) -> None:
    """As a terminal sends it: to this process and the workers alike, also while these start; none may be left waiting."""
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT / "src"), str(ROOT)))}
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, str(script), str(tmp_path / "figures"), str(after)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env=environment,
        start_new_session=True,
    )
    assert "interrupted" in done.stdout or "KeyboardInterrupt" in done.stderr
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.slow
def test_workers_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    """They hold its output open, so that reading that to its end waits for the last of them."""
    script = tmp_path / "killed.py"
    script.write_text(INTERRUPTED.replace("os.killpg(0, signal.SIGINT)", "os.kill(os.getpid(), signal.SIGKILL)"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT / "src"), str(ROOT)))}
    command = [sys.executable, str(script), str(tmp_path / "figures"), "2.5"]
    done = subprocess.run(command, capture_output=True, check=False, timeout=60, env=environment)  # noqa: S603 - our own program
    assert done.returncode == -signal.SIGKILL


def local_function() -> Callable[..., Figure]:
    def draw() -> Figure:
        return Figure()

    return draw


@pytest.mark.parametrize("function", [local_function(), Figure, print])
def test_a_function_that_others_cannot_import_is_refused(function: Callable[..., Figure]) -> None:
    with pytest.raises(InvalidInputError, match=r"figure 3\.2: .* cannot be imported by other processes; give a function of a module"):
        figure_task("3.2", function)


@pytest.mark.parametrize("name", ["", "../a", "a/b", ".hidden", "a b"])
def test_a_name_that_is_no_file_name_is_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=f"figure name {re.escape(repr(name))} is no file name"):
        curve_task(name)


def test_an_argument_without_content_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"figure 3\.2: no fingerprint for a value of type object"):
        figure_task("3.2", plot_curves, object())


def test_unusable_orders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="two figures are named a; each needs its own files"):
        write_figures([curve_task("a"), curve_task("b"), curve_task("a")], tmp_path)
    with pytest.raises(InvalidInputError, match="workers = 0 processes is outside 1 and above"):
        write_figures([curve_task("a")], tmp_path, workers=0)
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError, match=r"the folder .*file/figures for figures cannot be made: Not a directory"):
        write_figures([curve_task("a")], tmp_path / "file" / "figures")


def test_no_figures_are_no_work(tmp_path: Path) -> None:
    assert write_figures([], tmp_path) == ()


def test_rendering_leaves_the_figure_as_it_was() -> None:
    figure = plot_curves([Curve(x=T, y=T)], TIME, Quantity("speed", "rad/s"))
    first = render_figure(figure, "a")
    assert figure.dpi == DPI
    assert render_figure(figure, "a") == first
    assert b"<dc:identifier>a</dc:identifier>" in first[1]
    assert b"Fingerprint\0a" in first[0]


def test_workers_start_without_compiler_and_solvers() -> None:
    """What a worker imports to draw any figure: numba or scipy would double its start."""
    modules = ("bode", "curves", "figure_files", "loops", "poles", "responses", "spectrum", "steady")
    program = (
        f"import sys, {', '.join(f'revline.report.{name}' for name in modules)}; print('numba' in sys.modules, 'scipy' in sys.modules)"
    )
    environment = {"PYTHONPATH": str(Path(figure_files.__file__).parents[2])}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)  # noqa: S603 - our own program
    assert done.stdout.split() == ["False", "False"]
