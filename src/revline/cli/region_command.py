"""The command region: which (kp, ki) stabilise a loop at some derivative gains, its delay exact."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, TimeStepOption
from revline.cli.plants import EngineChoice, find_engine_trim, linearise_engine, refuse_engine
from revline.cli.plots import PlotOption, check_plot, write_plot
from revline.cli.shell import Facts, Grid, Shell
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.regions.gain_curve import Contour, LoopFamily
    from revline.design.regions.gain_slices import GainSlice, Mark, Question
    from revline.design.regions.nonlinear_boundary import BoundaryPoint, NonlinearBoundary

WANTING = "give a model file, or --throttle, the angle [deg] of the trim that the engine is linearised at"


class _Plant(NamedTuple):
    """What gains are sought for: a model file, or an engine at a trim."""

    model: Path | None
    choice: EngineChoice


class _Simulation(NamedTuple):
    """What is asked of the boundary by simulation."""

    rays: int
    step: float
    time_step: float
    workers: int


ModelArgument = Annotated[
    Path | None, typer.Argument(metavar="[MODEL.json]", help="Model file; without one, the engine's exact linear model at --throttle.")
]
ThrottleOption = Annotated[
    float | None, typer.Option("--throttle", metavar="DEG", help="Throttle angle of the engine's trim [deg]; a model needs none.")
]
KdOption = Annotated[
    str,
    typer.Option("--kd", metavar="KD,..", help="Derivative gains, a slice each [deg s/rad per rad/s for an engine]; 0 if none is given."),
]
KpMaxOption = Annotated[float | None, typer.Option("--kp-max", metavar="KP", help="Largest kp looked at; else chosen.")]
KiMaxOption = Annotated[float | None, typer.Option("--ki-max", metavar="KI", help="Largest ki looked at; else chosen.")]
MsOption = Annotated[str, typer.Option("--ms", metavar="MS,..", help="Peak sensitivities to draw contours of, such as 1.4,1.7,2.")]
DampingOption = Annotated[
    float | None, typer.Option("--damping", metavar="ZETA", help="Damping ratio: find the gains that damp all roots so.")
]
UpToOption = Annotated[
    float | None,
    typer.Option("--damping-up-to", metavar="W", help="Natural frequency up to which [rad/s]; else the highest of the boundary."),
]
MarkOption = Annotated[list[Path] | None, typer.Option("--mark", metavar="CONTROLLER.json", help="Controller to place; repeatable.")]
LargestKdOption = Annotated[bool, typer.Option("--largest-kd", help="Find the largest kd at which some gains stabilise.")]
OnEngineOption = Annotated[
    int, typer.Option("--on-engine", metavar="N", min=0, help="Bisect the boundary on the nonlinear engine along N rays.")
]
StepOption = Annotated[float, typer.Option("--step", metavar="DW", help="Step of the speed command for --on-engine [rad/s].")]
CsvOption = Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Boundaries and contours as CSV, units in the header.")]
WorkersOption = Annotated[int, typer.Option("--workers", min=1, max=64, help="Threads for --on-engine; results do not depend on them.")]


def region(
    *,
    model: ModelArgument = None,
    throttle: ThrottleOption = None,
    load: LoadOption = 0.0,
    kd: KdOption = "",
    kp_max: KpMaxOption = None,
    ki_max: KiMaxOption = None,
    ms: MsOption = "",
    damping: DampingOption = None,
    damping_up_to: UpToOption = None,
    mark: MarkOption = None,
    largest_kd: LargestKdOption = False,
    on_engine: OnEngineOption = 0,
    step: StepOption = 60.0,
    time_step: TimeStepOption = 1e-3,
    plot: PlotOption = None,
    csv: CsvOption = None,
    workers: WorkersOption = 2,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the (kp, ki) that stabilise the speed loop at a derivative gain, ki not negative, every delay exact.

    The boundary is the curve of gains at which a root lies on the imaginary axis; each of its points is exact.
    Controllers that are marked are placed in the slice of their own kd.
    """
    from revline.design.regions.gain_slices import find_largest_kd, find_slices
    from revline.io.json_files import format_json
    from revline.io.region_records import boundary_record, region_csv, slices_record

    shell = Shell(json=json, quiet=quiet)
    check_plot(plot)
    shell.prepare_each((out, "region"), (plot, "figure"), (csv, "table of gains"))
    plant = _Plant(model, EngineChoice(engine, throttle, load))
    marks = _marks(mark or [])
    question = _question(kd, ms, (damping, damping_up_to), (kp_max, ki_max), marked=bool(marks))
    simulation = _simulation(plant, on_engine, (step, time_step), workers)
    name, make, delayed = _maker(plant)
    slices = find_slices(make, question, marks=marks, delayed=delayed)
    largest = find_largest_kd(make) if largest_kd else None
    simulated = _simulate(shell, plant, simulation, [entry.region.family.kd for entry in slices])
    record = dict(slices_record(slices, largest=largest))
    if simulated:
        record["on_engine"] = [boundary_record(found) for found in simulated]
    shell.write(out, format_json(record), "region")
    shell.write(csv, region_csv(slices) if csv else "", "table of gains")
    _write_plot(plot, slices, simulated)
    shell.show(record, *_parts(name, slices, simulated), *_largest_words(record), text_on=out)


def _question(
    kd: str, ms: str, damping: tuple[float | None, float | None], reach: tuple[float | None, float | None], *, marked: bool
) -> "Question":
    from revline.design.regions.gain_slices import Question
    from revline.errors import out_of_range
    from revline.io.number_lists import parse_numbers

    for name, value in (("largest kp", reach[0]), ("largest ki", reach[1]), ("damping", damping[0]), ("natural frequency", damping[1])):
        if value is not None and not value > 0.0:
            raise out_of_range(name, value, "", "values above 0", "leave the option out to have it chosen")
    kds = tuple(float(k) for k in parse_numbers(kd, "--kd")) if kd else () if marked else (0.0,)
    return Question(
        kds=kds,
        peaks=tuple(float(m) for m in parse_numbers(ms, "--ms")) if ms else (),
        damping=damping[0] or 0.0,
        up_to=damping[1] or 0.0,
        kp_max=reach[0] or 0.0,
        ki_max=reach[1] or 0.0,
    )


def _marks(paths: Sequence[Path]) -> "tuple[Mark, ...]":
    from revline.design.regions.gain_slices import mark_controller
    from revline.io.controller_files import read_controller

    return tuple(mark_controller(path.stem, read_controller(path).feedback_gains) for path in paths)


def _simulation(plant: _Plant, rays: int, steps: tuple[float, float], workers: int) -> _Simulation | None:
    if rays == 0:
        return None
    if plant.model is not None:
        message = "--on-engine simulates the nonlinear engine; leave the model file out and give --throttle, or leave --on-engine out"
        raise InvalidInputError(message)
    return _Simulation(rays, *steps, workers)


def _maker(plant: _Plant) -> tuple[str, "Callable[[float, Contour], LoopFamily]", bool]:
    """The plant's name, what makes its families, and whether it has a delay."""
    from revline.design.regions.loop_family import family_of_model, family_of_system

    if plant.model is not None:
        refuse_engine(plant.choice)
        from revline.io.model_files import read_model

        file = read_model(plant.model)
        return file.name, lambda kd, contour: family_of_model(file.model, kd=kd, name=file.name, contour=contour), file.model.delay > 0.0
    name, linear = linearise_engine(plant.choice, WANTING)
    return name, lambda kd, contour: family_of_system(linear, kd=kd, name=name, contour=contour), bool(linear.lags.size)


def _simulate(shell: Shell, plant: _Plant, asked: _Simulation | None, kds: Sequence[float]) -> "list[NonlinearBoundary]":
    if asked is None:
        return []
    from revline.design.loops.closed_loop import Limits
    from revline.design.regions.nonlinear_boundary import BoundarySearch, StepCase, find_nonlinear_boundary
    from revline.engine.lee1995 import lee1995_parameters

    system, trim = find_engine_trim(plant.choice, WANTING)
    limits = Limits(0.0, lee1995_parameters(system).throttle.saturation_angle)
    found = []
    for kd in kds:
        with shell.progress(f"boundary of {system.name} at kd = {kd:g}") as progress:
            case = StepCase(command=asked.step, kd=kd, limits=limits)
            search = BoundarySearch(rays=asked.rays, step=asked.time_step)
            found.append(find_nonlinear_boundary(system, trim, case, search=search, workers=asked.workers, progress=progress))
        shell.warn(*(f"no boundary on the ray through kp = {r.kp:.4g}, ki = {r.ki:.4g}: {r.reason}" for r in found[-1].lost))
    return found


def _write_plot(plot: Path | None, slices: "Sequence[GainSlice]", simulated: "Sequence[NonlinearBoundary]") -> None:
    if plot is None:
        return
    from revline.report.gains import plot_gain_slices

    write_plot(plot, plot_gain_slices(slices, simulated=simulated), "region")


def _parts(name: str, slices: "Sequence[GainSlice]", simulated: "Sequence[NonlinearBoundary]") -> list[Facts | Grid]:
    from revline.io.region_records import describe_placed, describe_slice

    parts: list[Facts | Grid] = []
    for entry in slices:
        parts.append(Facts(f"Stabilising gains of {name}, kd = {entry.region.family.kd:g}", describe_slice(entry)))
        if entry.placed:
            header = ("controller", "where", "kp and ki together", "Ms")
            parts.append(Grid("Controllers with this kd", header, [describe_placed(entry, placed) for placed in entry.placed]))
    for found in simulated:
        title = f"By simulation, command {found.case.command:+g} rad/s, kd = {found.case.kd:g}, beside the linear boundary at its target"
        columns = ("kp", "ki", "settles at", "not at", "how it ends", "linear [rad/s]", "seen [rad/s]")
        parts.append(Grid(title, columns, [_point_cells(point) for point in found.points]))
    return parts


def _point_cells(point: "BoundaryPoint") -> tuple[float | str, ...]:
    seen = "" if point.observed_frequency is None else f"{point.observed_frequency:.5g}"
    return point.kp, point.ki, point.settled, point.unsettled, point.outcome.name, point.frequency, seen


def _largest_words(record: dict[str, object]) -> list[str]:
    found = record.get("largest_kd")
    if not isinstance(found, dict):
        return []
    if "lost" in found:
        return [f"largest kd at which some gains stabilise: {found['stabilised']:.5g} {found['unit']} (beyond: {found['reason']})"]
    return [f"some gains stabilise at every kd tried, up to {found['stabilised']:.4g} {found['unit']}"]
