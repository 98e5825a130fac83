"""The command optimise: gains of least error under bounds, on a model or on the engine at one or several trims."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from revline import __version__
from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, OutOption, QuietOption
from revline.cli.plants import EngineChoice, linearise_engine
from revline.cli.plots import PlotOption, check_plot, write_plot
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.optimum.competitors import Comparison
    from revline.design.optimum.optimise import Optimum
    from revline.design.optimum.optimum_problem import Bounds
    from revline.design.tuning.tuning_plant import TuningPlant

FREE = "kp,ki,kd"

WANTED = "give a model file, or --throttle for the engine, for example `revline optimise --throttle 25 --ms 2 --out best.json`"

ModelArgument = Annotated[
    Path | None, typer.Argument(metavar="[MODEL.json]", help="Model file; the load then acts at its input. Without one, the engine.")
]
AnglesOption = Annotated[
    str | None, typer.Option("--throttle", metavar="A1,A2,..", help="Throttle angles of the engine's trims [deg]; the worst of all counts.")
]
LoadsOption = Annotated[str, typer.Option("--load", metavar="T1,T2,..", help="Load torques of the trims [N m]; each with each angle.")]
MsOption = Annotated[
    float | None, typer.Option("--ms", metavar="PEAK", help="Largest peak of the sensitivity, Ms; 2 where no bound is given.")
]
MtOption = Annotated[float | None, typer.Option("--mt", metavar="PEAK", help="Largest peak of the complementary sensitivity, Mt.")]
EffortOption = Annotated[
    float | None,
    typer.Option(
        "--effort", metavar="GAIN", help="Largest peak of |C S| [deg/(rad/s) of an engine]; needs --filter-time where kd is free."
    ),
]
SetpointOption = Annotated[
    float | None, typer.Option("--setpoint-iae", metavar="S", help="Largest integrated error after a unit step of the command [s].")
]
ObjectiveOption = Annotated[
    Literal["load", "setpoint", "both"], typer.Option("--objective", help="Which integrated absolute error is minimised.")
]
FreeOption = Annotated[str, typer.Option("--free", metavar="NAME,..", help="What may be chosen, of kp,ki,kd and the set-point weight b.")]
FilterOption = Annotated[float, typer.Option("--filter-time", metavar="S", help="Time of the derivative's filter [s]; 0 for none.")]
CompareOption = Annotated[
    list[Path] | None,
    typer.Option("--compare", metavar="CONTROLLER.json", help="Hold a controller against the optimum with its Ms; again for more."),
]
RulesOption = Annotated[bool, typer.Option("--compare-rules", help="Hold every tuning rule against the optimum likewise.")]


def optimise(
    *,
    model: ModelArgument = None,
    throttle: AnglesOption = None,
    load: LoadsOption = "0",
    ms: MsOption = None,
    mt: MtOption = None,
    effort: EffortOption = None,
    setpoint_iae: SetpointOption = None,
    objective: ObjectiveOption = "load",
    free: FreeOption = FREE,
    filter_time: FilterOption = 0.0,
    compare: CompareOption = None,
    compare_rules: RulesOption = False,
    plot: PlotOption = None,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the gains of least integrated absolute error under bounds on the peaks, every delay exact.

    The error is that after a unit step: of the load in N m for an engine, at the input for a model; of the command in its own unit. Of
    several trims the worst counts. The derivative acts on the measurement.
    """
    from revline.design.optimum.optimise import optimise as find_optimum
    from revline.design.optimum.optimum_problem import Objective, find_scale, make_grid
    from revline.io.json_files import format_json
    from revline.io.optimum_records import comparison_record, optimum_record

    shell = Shell(json=json, quiet=quiet)
    _check_plot(plot, compared=bool(compare) or compare_rules)
    shell.prepare_each((out, "controller file"), (plot, "figure"))
    plants = _plants(model, engine, throttle, load)
    grids = [make_grid(plant.plant, filter_time=filter_time) for plant in plants]
    scale = find_scale(plants[0])
    provenance = {"program": f"revline {__version__}"}
    given = {"ms": ms, "mt": mt, "effort": effort, "setpoint_iae": setpoint_iae}
    if compare or compare_rules:
        _refuse_wishes(given, free=free, objective=objective)
        found = _compare(plants, grids[0], scale, compare or [], rules=compare_rules)
        record = comparison_record(found, provenance=provenance)
        shell.write(out, format_json(record), "comparison")
        if plot is not None:
            from revline.report.optimum import plot_comparison

            units = ("rad per N m", "rad/s per N m") if model is None else ("model's units", "model's units")
            write_plot(plot, plot_comparison(found, unit=units[0], response_unit=units[1]), "optimise")
        shell.show(record, *_comparison_parts(found), text_on=out)
        return
    bounds = _bounds(given)
    names = tuple(name.strip() for name in free.split(","))
    with shell.busy("searching gains"):
        best = find_optimum(grids, scale, bounds, Objective(objective), free=names)
    record = optimum_record(best, plants, filter_time=filter_time, objective=objective, provenance=provenance)
    shell.write(out, format_json(record), "controller file")
    shell.show(record, *_parts(best, plants), text_on=out)


def _check_plot(plot: Path | None, *, compared: bool) -> None:
    check_plot(plot)
    if plot is not None and not compared:
        message = "--plot shows controllers beside their optimum; give --compare or --compare-rules, or leave --plot out"
        raise InvalidInputError(message)


def _plants(model: Path | None, engine: str, throttle: str | None, load: str) -> "list[TuningPlant]":
    from revline.design.tuning.tuning_plant import tuning_plant
    from revline.io.model_files import read_model
    from revline.io.number_lists import parse_numbers

    if model is not None:
        if throttle is not None or load != "0" or engine != DEFAULT_ENGINE:
            message = "--engine, --throttle and --load place an engine's trims; a model file has its own operating point, leave them out"
            raise InvalidInputError(message)
        file = read_model(model)
        return [tuning_plant(file.model, name=file.name)]
    if throttle is None:
        raise InvalidInputError(WANTED)
    places = product(parse_numbers(load, "--load [N m]"), parse_numbers(throttle, "--throttle [deg]"))
    named = [linearise_engine(EngineChoice(engine, angle, torque), WANTED) for torque, angle in places]
    return [tuning_plant(system, name=name) for name, system in named]


def _refuse_wishes(given: dict[str, float | None], *, free: str, objective: str) -> None:
    """A comparison takes its bounds from each controller; what says otherwise would be dropped."""
    wishes = [name for name, value in given.items() if value is not None]
    wishes += [name for name, value, default in (("free", free, FREE), ("objective", objective, "load")) if value != default]
    if wishes:
        message = (
            "a comparison bounds the optimum by each controller's own Ms and set-point error, for the least load error; "
            f"leave --{wishes[0].replace('_', '-')} out"
        )
        raise InvalidInputError(message, option=wishes[0])


def _bounds(given: dict[str, float | None]) -> "Bounds":
    from revline.design.optimum.optimum_problem import Bounds

    known = {name: value for name, value in given.items() if value is not None}
    return Bounds(**known) if known else replace(Bounds(), ms=2.0)


def _compare(plants: "list[TuningPlant]", grid: object, scale: object, files: list[Path], *, rules: bool) -> "Comparison":
    from revline.design.optimum.competitors import compare_with_competitors
    from revline.design.optimum.loop_cost import LoopGrid
    from revline.design.optimum.optimum_problem import Scale
    from revline.design.tuning.rule_comparison import compare_rules
    from revline.io.controller_files import read_controller

    if len(plants) != 1 or not isinstance(grid, LoopGrid) or not isinstance(scale, Scale):
        message = "controllers are compared at one operating point; give one throttle angle and one load"
        raise InvalidInputError(message)
    rivals = {path.stem: read_controller(path).gains for path in files}
    if rules:
        rivals |= {one.rule: one.gains for one in compare_rules(plants[0]).tuned}
    return compare_with_competitors(plants[0], grid, scale, rivals)


def _parts(best: "Optimum", plants: "list[TuningPlant]") -> list[Facts | Grid | str]:
    terms, plant = best.terms, plants[0]
    rows: list[tuple[str, float | str, str]] = [
        ("kp", terms.kp, f"{plant.input_unit}/({plant.output_unit})"),
        ("ki", terms.ki, f"{plant.input_unit}/({plant.output_unit})/s"),
        ("kd", terms.kd, f"{plant.input_unit}/({plant.output_unit}) s"),
        ("set-point weight", terms.b, ""),
        ("cost", best.cost, "worst of all points" if len(plants) > 1 else ""),
        ("searches that agree", f"{100.0 * best.agreement:.0f} %", ""),
    ]
    heads = ("operating point", "IAE load", "IAE set-point", "Ms", "Mt")
    table = [
        (one.name, f"{c.load:.5g}", f"{c.setpoint:.5g}", f"{c.sensitivity.max():.4f}", f"{c.complementary.max():.4f}")
        for one, c in zip(plants, best.costs, strict=True)
    ]
    words = [
        f"on its bound: {a.measure.value} = {a.bound:.5g} at point {a.point + 1}; the cost changes by {a.sensitivity:.3g} per unit of it"
        for a in best.active
    ]
    return [Facts("Gains of least error", rows), Grid("", heads, table), *words]


def _comparison_parts(found: "Comparison") -> list[Facts | Grid | str]:
    heads = ("controller", "Ms", "IAE set-point", "IAE load", "optimum's", "ratio", "kp", "ki", "kd", "on its bound")
    rows = [
        (
            one.name,
            f"{one.cost.sensitivity.max():.3f}",
            f"{one.cost.setpoint:.4g}",
            f"{one.cost.load:.4g}",
            f"{one.optimum.cost:.4g}",
            f"{one.ratio:.3f}",
            *(f"{value:.4g}" for value in one.optimum.terms[:3]),
            ", ".join(bound.measure.value for bound in one.optimum.active) or "none",
        )
        for one in found.competitors
    ]
    title = f"Load error on {found.plant}, of controllers and of the optimum with their Ms and set-point error as bounds"
    return [Grid(title, heads, rows), *(f"not {one.name}: {one.reason}" for one in found.left_out)]
