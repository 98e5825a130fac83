"""The command line `revline`: a thin shell over the package's functions.

A command reads, converts at the edge, calls one function and shows the result. What a command needs it imports when it runs, so that
help costs next to nothing. Exit status: 0 done, 2 the input is wrong, 1 the analysis could not be completed.
"""

import os
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated, NamedTuple, TextIO

import typer

from revline import __version__
from revline.cli import (
    accept_command,
    compare_command,
    engine_commands,
    export_command,
    gain_map_command,
    limit_cycle_command,
    linear_range_command,
    loop_command,
    map_command,
    margins_command,
    mid_ranging_command,
    model_commands,
    nu_gap_command,
    optimise_command,
    region_command,
    relay_command,
    response_command,
    serve_command,
    simulate_command,
    spectra_command,
    study_commands,
    tune_command,
)
from revline.cli.shell import say
from revline.errors import RevlineError

FAILED = 1
INTERRUPTED = 130
"""What the argument parser makes of an interruption."""

THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Threads of what numpy's linear algebra runs on. The matrices here are small: more threads than one only wait for each other."""

QUIET = frozenset({"--quiet", "-q"})
"""Either leaves out the warnings that Python's libraries give, as it does those of the commands."""


class Entry(NamedTuple):
    """A command: its name, its function, a line for the list of commands, and a worked example for its own help."""

    name: str
    run: Callable[..., None]
    summary: str
    example: str


COMMANDS = (
    Entry(
        "engines", engine_commands.engines, "List the engines, or print one's parameter file.", "revline engines lee1995 > my_engine.toml"
    ),
    Entry(
        "simulate",
        simulate_command.simulate,
        "An engine in time, under an input.",
        "revline simulate --throttle 25 --input step:5@0.5 --until 5 --out run.csv",
    ),
    Entry("trim", engine_commands.trim, "Steady operating point at a throttle or a speed.", "revline trim --throttle 25"),
    Entry("map", map_command.steady_map, "Steady states over the throttle.", "revline map --from 4 --to 60 --points 57 --out map.csv"),
    Entry("linearize", engine_commands.linearize, "Exact linear model at a trim.", "revline linearize --throttle 25 --out linear.json"),
    Entry(
        "response",
        response_command.response,
        "Frequency response from throttle to speed.",
        "revline response --throttle 25 --amplitude 5 --frequencies 0.1,1,5,10,20,50,100 --method peaks --out response.csv",
    ),
    Entry(
        "linear-range",
        linear_range_command.linear_range,
        "Up to which amplitude the linear model holds.",
        "revline linear-range --throttle 25 --within 5 --frequencies 0.1,1,5,10,20,50,100 --out range.csv",
    ),
    Entry(
        "spectra",
        spectra_command.spectra,
        "Whether the speed follows the throttle's frequency.",
        "revline spectra --throttle 25 --amplitude 5 --frequencies 0.5,5,20,50 --out spectra.csv",
    ),
    Entry(
        "fit",
        model_commands.fit,
        "Fit a transfer function to a frequency response.",
        "revline fit response.csv --zeros 0 --poles 2 --delay phase-line --out g2d.json",
    ),
    Entry(
        "tune",
        tune_command.tune,
        "Tune a controller for a model by a rule.",
        "revline tune g1.json --rule pole-placement --natural-frequency 18.85 --damping 1.25 --out c1.json",
    ),
    Entry(
        "margins",
        margins_command.margins,
        "Margins of a loop, its delay exact.",
        "revline margins g2d.json controller.json",
    ),
    Entry(
        "nu-gap",
        nu_gap_command.nu_gap,
        "How far a model is from another, or from the engine, and what that guarantees.",
        "revline nu-gap g2d.json --throttle 25 --controller c2d.json --out chords.csv",
    ),
    Entry(
        "region",
        region_command.region,
        "Gains that stabilise a loop, its delay exact.",
        "revline region --throttle 25 --kd 0.1 --out region.json",
    ),
    Entry(
        "gain-map",
        gain_map_command.gain_map,
        "Gains over a map of operating points, and what holds at all.",
        "revline gain-map --throttle 15,25,35,45 --load 0,20,40 --out map.json --plot map.png",
    ),
    Entry(
        "loop",
        loop_command.loop,
        "Closed speed loop in time, and how it ends.",
        "revline loop c1.json --throttle 25 --step 60 --until 20 --out loop.csv",
    ),
    Entry(
        "limit-cycle",
        limit_cycle_command.limit_cycle,
        "The orbit that a speed loop hunts in, and its onset.",
        "revline limit-cycle c1.json --throttle 25 --onset",
    ),
    Entry(
        "mid-ranging",
        mid_ranging_command.mid_ranging,
        "Speed by spark and throttle against a step of the load.",
        "revline mid-ranging --throttle 12 --spark -20 --load-step 4 --out idle.csv",
    ),
    Entry(
        "optimise",
        optimise_command.optimise,
        "Gains of least error under bounds, its delay exact.",
        "revline optimise --throttle 25 --ms 2 --out best.json",
    ),
    Entry(
        "relay",
        relay_command.relay,
        "Ultimate gain by a relay, by the exact model and by bisection.",
        "revline relay --throttle 25 --amplitude 1",
    ),
    Entry(
        "accept",
        accept_command.accept,
        "A controller's verdict on the sampled, noisy engine.",
        "revline accept c2d.json --throttle 15,25,35 --load 0,20 --out verdict.json",
    ),
    Entry(
        "export",
        export_command.export,
        "A controller as C, MATLAB, python-control or JSON.",
        "revline export c2d.json --format c,json --throttle 25 --out code",
    ),
    Entry("serve", serve_command.serve, "The workbench: the whole chain live in a browser.", "revline serve --port 8765"),
    Entry("study", study_commands.study, "The whole study into a folder, with its report.", "revline study --out out"),
    Entry("report", study_commands.report, "Make a study's report again.", "revline report out"),
    Entry("compare", compare_command.compare, "What two studies have different.", "revline compare out other"),
)
"""All commands, in the order of the work."""


def build_app() -> typer.Typer:
    """Build the command line from its table."""
    made = typer.Typer(
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback()(_top)
    for entry in COMMANDS:
        made.command(entry.name, short_help=entry.summary, epilog=f"Example: {entry.example}")(entry.run)
    return made


def _show_version(value: bool) -> None:  # noqa: FBT001 - the form of an option's callback
    if value:
        typer.echo(f"revline {__version__}")
        raise typer.Exit


def _top(
    context: typer.Context,
    *,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)] = False,  # noqa: ARG001 - its callback acts
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no warnings on stderr.")] = False,
) -> None:
    """Engine speed control with the transport delay kept exact: from nonlinear simulation to proven gains.

    Angles are in deg, speeds in rad/s, pressures in kPa, torques in N m, times in s. Each command has a --help with an example.
    """
    if quiet:
        context.default_map = {entry.name: {"quiet": True} for entry in COMMANDS}


def main() -> None:
    """Run the command line with the process's arguments, and end the process."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Run the command line.

    Args:
        arguments: those after the program's name.

    Returns:
        The exit status: 0 done, 2 the input is wrong, 1 the analysis could not be completed.
    """
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        if QUIET.intersection(arguments):
            warnings.simplefilter("ignore")
        try:
            status = _run_app(arguments)
            sys.stdout.flush()
        except BrokenPipeError:
            _close_stdout()
            status = FAILED
        except RevlineError as error:
            say(f"error: {error}", style="bold red")
            status = error.exit_status
        except MemoryError:
            say("error: not enough memory; ask for fewer samples or points", style="bold red")
            status = FAILED
        except OSError as error:
            say(f"error: {error}", style="bold red")
            status = FAILED
        except Exception:  # noqa: BLE001 - the last resort says what to do with the traceback
            traceback.print_exc()
            say("error: this is a fault in revline; please report it with the lines above and the command", style="bold red")
            status = FAILED
    return status


def _run_app(arguments: Sequence[str]) -> int:
    try:
        app(args=list(arguments), prog_name="revline")
    except SystemExit as end:
        if end.code == INTERRUPTED:
            say("interrupted", style="bold red")
            return FAILED
        return end.code if isinstance(end.code, int) else 0
    return 0


def _close_stdout() -> None:
    """Point stdout to nowhere, so that the interpreter's last flush finds no broken pipe."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: TextIO | None = None, line: str | None = None
) -> None:
    del filename, lineno, file, line
    say(f"warning: {message} ({category.__name__})", style="yellow")


app = build_app()
