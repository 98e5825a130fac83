"""The command nu-gap: how far two plants are apart as feedback sees them, and what a controller for one is sure to do on the other."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption
from revline.cli.plants import EngineChoice, linearise_engine, refuse_engine
from revline.cli.plots import check_plot, write_plot
from revline.cli.shell import Facts, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.stability.compared_plant import ComparedPlant


def nu_gap(
    *,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="MODEL.json [MODEL2.json]",
            help="Model file, and the one it is compared with; without a second, the engine's exact linear model at --throttle.",
        ),
    ],
    throttle: Annotated[
        float | None, typer.Option("--throttle", metavar="DEG", help="Throttle angle of the engine's trim [deg]; two models need none.")
    ] = None,
    load: LoadOption = 0.0,
    controller: Annotated[
        Path | None,
        typer.Option("--controller", metavar="CONTROLLER.json", help="Controller for the first model: weighs both plants, and is judged."),
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.png|svg", help="Figure to write; it needs --controller.")] = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the nu-gap between a model and another plant, every delay exact, and what it guarantees for a controller.

    A gap below the controller's margin on the first plant proves that it stabilises the second. A gap above proves nothing for this one
    plant, whose loop is therefore also counted by itself. --out writes the chord over frequency as CSV.
    """
    from revline.design.stability.nu_gap import find_nu_gap, judge_controller
    from revline.io.controller_files import read_controller
    from revline.io.nu_gap_records import describe_gap, describe_guarantee, format_gap, gap_record, guarantee_record, summarise

    shell = Shell(json=json, quiet=quiet)
    _check_plot(plot, controller)
    shell.prepare_each((out, "table of chords"), (plot, "figure"))
    gains = None if controller is None else read_controller(controller).feedback_gains
    first, second = _plants(files, EngineChoice(engine, throttle, load))
    if controller is None or gains is None:
        gap = find_nu_gap(first, second)
        record, rows, closing = gap_record(gap), describe_gap(gap), []
        unit = " to ".join(first.units)
        warning = f"the number depends on units, here {unit}; give --controller to compare the loops, which have none"
        record |= {"units": {"input": first.units[0], "output": first.units[1]}, "warnings": [warning]}
        shell.warn(warning)
        text = format_gap(gap)
    else:
        found = judge_controller(first, second, gains)
        record, rows, closing = guarantee_record(found, controller.stem), describe_guarantee(found), [summarise(found, controller.stem)]
        text = format_gap(found)
        if plot is not None:
            from revline.report.nu_gap import plot_nu_gap

            write_plot(plot, plot_nu_gap([(f"{controller.stem} from {first.name} to {second.name}", found)]), "nu-gap")
    shell.write(out, text, "table of chords")
    shell.show(record, Facts(f"{first.name} and {second.name}", rows), *closing, text_on=out)


def _check_plot(plot: Path | None, controller: Path | None) -> None:
    check_plot(plot)
    if plot is not None and controller is None:
        message = "--plot shows the chord beside a controller's margin; give --controller, or leave --plot out"
        raise InvalidInputError(message)


def _plants(files: list[Path], choice: EngineChoice) -> "tuple[ComparedPlant, ComparedPlant]":
    from revline.design.stability.compared_plant import plant_of_system

    if len(files) > 2:
        message = f"{len(files)} files were given; give one model file or two"
        raise InvalidInputError(message)
    if len(files) == 2:
        refuse_engine(choice, "two model files need none")
        return _of_model(files[0]), _of_model(files[1])
    first = _of_model(files[0])
    wanting = "one model is compared with an engine at --throttle, the angle [deg] of its trim; give that, or a second model file"
    name, linear = linearise_engine(choice, wanting)
    return first, plant_of_system(linear, name=name)


def _of_model(path: Path) -> "ComparedPlant":
    from revline.design.stability.compared_plant import plant_of_model
    from revline.io.model_files import read_model

    file = read_model(path)
    return plant_of_model(file.model, name=file.name)
