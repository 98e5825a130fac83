"""The frame of the command line: help, version, errors, exit statuses, streams, and what a start costs."""

import inspect
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.testing import CliRunner

import revline as package
from revline import __version__
from revline.cli import COMMANDS, THREADS, app, main, run, tune_command
from revline.cli.model_commands import DelayChoice, WeightChoice
from revline.cli.tune_command import ObjectiveChoice
from revline.design.fitting.fit import DelayRule, Weight
from revline.design.tuning.fine_tuning import Objective
from revline.design.tuning.rules import TUNING_RULES
from revline.studies.response_routes import MethodChoice

from .conftest import Command

SOURCE = str(Path(package.__file__).parents[1])
PROGRAM = "from revline.cli import main; main()"


def test_help_lists_every_command(revline: Command) -> None:
    done = revline("-h")
    assert done.status == 0
    assert done.out == revline("--help").out
    for entry in COMMANDS:
        assert f"  {entry.name} " in done.out


@pytest.mark.parametrize("entry", COMMANDS, ids=lambda entry: entry.name)
def test_every_command_has_a_description_units_and_an_example(entry: Any, revline: Command) -> None:
    done = revline(entry.name, "--help")
    assert done.status == 0
    assert f"Example: {entry.example}" in " ".join(done.out.split())
    assert inspect.getdoc(entry.run)
    assert entry.example.startswith(f"revline {entry.name} ")
    for quantity in ("--throttle", "--load", "--step", "--until", "--amplitude", "--speed"):
        for line in done.out.split("\n  -"):
            if line.startswith(f"-{quantity.lstrip('-')} "):
                assert "[" in line.partition(" ")[2], f"{quantity} of {entry.name} names no unit"


@pytest.mark.parametrize("entry", COMMANDS, ids=lambda entry: entry.name)
def test_a_command_that_takes_a_throttle_takes_a_load_and_all_take_json_and_quiet(entry: Any) -> None:
    names = set(inspect.signature(entry.run).parameters)
    assert "throttle" not in names or {"load", "engine"} <= names
    assert {"json", "quiet"} <= names


def test_the_version_is_the_package_s(revline: Command) -> None:
    assert revline("--version") == (0, f"revline {__version__}\n", "")


def test_without_a_command_the_help_is_shown_and_the_status_says_wrong_input(revline: Command) -> None:
    done = revline()
    assert done.status == 2
    assert "Commands:" in done.out + done.err


def test_typer_s_own_runner_runs_it_too() -> None:
    result = CliRunner().invoke(app, ["engines", "--json"])
    assert result.exit_code == 0
    assert result.stdout.startswith("{")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nonsense",), "No such command 'nonsense'"),
        (("trim", "--angle", "3"), "No such option: --angle"),
        (("trim", "--throttle", "wide"), "Invalid value for '--throttle'"),
        (("linearize",), "Missing option '--throttle'"),
        (("map", "--points", "1"), "Invalid value for '--points'"),
        (("fit", "x.csv", "--zeros", "0", "--poles", "1", "--delay", "some"), "'some' is not one of 'none', 'phase-line', 'free'"),
    ],
)
def test_what_the_command_line_itself_refuses_exits_2(arguments: tuple[str, ...], message: str, revline: Command) -> None:
    done = revline(*arguments)
    assert done.status == 2
    assert done.out == ""
    assert message in done.err
    assert "Traceback" not in done.err


def test_choices_are_those_of_the_methods() -> None:
    assert get_args(DelayChoice) == tuple(rule.value for rule in DelayRule)
    assert get_args(WeightChoice) == tuple(weight.value for weight in Weight)
    assert get_args(ObjectiveChoice) == tuple(objective.value for objective in Objective)
    assert set(get_args(MethodChoice)) == {"peaks", "fourier", "harmonic-balance", "exact"}


def test_every_option_of_a_tuning_rule_is_an_option_of_tune() -> None:
    wanted = {option.name for rule in TUNING_RULES for option in rule.options}
    assert wanted
    assert wanted <= set(inspect.signature(tune_command.tune).parameters)


def test_quiet_stands_before_or_after_the_command(revline: Command) -> None:
    assert "warning: open-loop unstable" in revline("trim", "--throttle", 5).err
    assert revline("trim", "--throttle", 5, "-q").err == ""
    assert revline("-q", "trim", "--throttle", 5).err == ""


def test_an_unexpected_error_keeps_its_traceback_and_asks_for_a_report(revline: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: str) -> None:
        message = "planted"
        raise RuntimeError(message)

    monkeypatch.setattr("revline.io.engine_files.load_engine", fail)
    done = revline("trim", "--throttle", 25)
    assert done.status == 1
    assert "RuntimeError: planted" in done.err
    assert "please report it" in done.err
    assert done.out == ""


@pytest.mark.parametrize(
    ("raised", "message"),
    [
        (KeyboardInterrupt(), "interrupted"),
        (MemoryError(), "error: not enough memory"),
        (OSError(28, "No space left on device"), "error: [Errno 28] No space left on device"),
    ],
)
def test_interruption_and_lack_of_room_exit_1_in_a_line(
    raised: BaseException, message: str, revline: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: str) -> None:
        raise raised

    monkeypatch.setattr("revline.io.engine_files.load_engine", fail)
    done = revline("trim", "--throttle", 25)
    assert done.status == 1
    assert done.err.strip().splitlines() == [done.err.strip()]
    assert message in done.err


def test_python_warnings_are_one_line_each(revline: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def warn(_: str) -> None:
        warnings.warn("planted [deg]", RuntimeWarning, stacklevel=1)
        raise KeyboardInterrupt

    monkeypatch.setattr("revline.io.engine_files.load_engine", warn)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert "warning: planted [deg] (RuntimeWarning)\n" in revline("trim", "--throttle", 25).err


def test_a_reader_that_stops_reading_is_no_reason_to_complain() -> None:
    command = [sys.executable, "-c", PROGRAM, "engines", "lee1995"]
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write) as pipe:
        environment = {**os.environ, "PYTHONPATH": SOURCE}
        done = subprocess.run(command, text=True, env=environment, stdout=pipe, stderr=subprocess.PIPE, check=False)  # noqa: S603 - our own program
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device here")
def test_a_full_disk_is_told_in_a_line() -> None:
    with Path("/dev/full").open("w") as full:
        environment = {**os.environ, "PYTHONPATH": SOURCE}
        command = [sys.executable, "-c", PROGRAM, "engines", "lee1995"]
        done = subprocess.run(command, text=True, env=environment, stdout=full, stderr=subprocess.PIPE, check=False)  # noqa: S603 - our own program
    assert done.returncode == 1
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("arguments", [("--help",), ("loop", "--help"), ("--version",)])
def test_help_and_version_load_nothing_heavy(arguments: tuple[str, ...]) -> None:
    heavy = ("numba", "numpy", "scipy", "matplotlib", "rich.table")
    program = (
        "import sys\nfrom revline.cli import run\n"
        f"status = run({list(arguments)!r})\n"
        f"sys.exit(status or ' '.join(name for name in {heavy!r} if name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env={"PYTHONPATH": SOURCE}, check=False)  # noqa: S603 - our own program
    assert done.stderr.strip() == ""
    assert "revline" in done.stdout


def test_completion_is_offered_for_engines_and_rules(revline: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    from revline.cli.options import complete_engine  # noqa: PLC0415 - what the shell calls

    assert complete_engine("lee1995-") == ["lee1995-generic"]
    assert "pole-placement" in tune_command.rule_names()
    monkeypatch.setenv("_REVLINE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "revline trim --engine lee1995-")
    monkeypatch.setenv("COMP_CWORD", "3")
    assert "lee1995-generic" in revline().out


def test_run_leaves_the_process_alone() -> None:
    before = warnings.showwarning
    assert run(["--version"]) == 0
    assert warnings.showwarning is before


def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(THREADS[0], "3")
    monkeypatch.delenv(THREADS[1], raising=False)
    monkeypatch.setattr("sys.argv", ["revline", "--version"])
    with pytest.raises(SystemExit):
        main()
    assert [os.environ[name] for name in THREADS] == ["3", "1"]


@pytest.mark.filterwarnings("always::RuntimeWarning")
@pytest.mark.parametrize(("words", "count"), [((), 1), (("--quiet",), 0), (("-q",), 0)])
def test_quiet_leaves_out_the_libraries_warnings_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], count: int
) -> None:
    def engine_names() -> tuple[str, ...]:
        warnings.warn("no folder can be written", RuntimeWarning, stacklevel=1)
        return ("lee1995",)

    monkeypatch.setattr("revline.io.engine_files.engine_names", engine_names)
    assert run(["engines", "lee1995", *words]) == 0
    assert capsys.readouterr().err.count("warning: no folder can be written (RuntimeWarning)") == count
