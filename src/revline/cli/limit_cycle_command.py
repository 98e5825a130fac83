"""The command limit-cycle: the orbit that a closed speed loop hunts in, its stability, and how hunting begins."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption
from revline.cli.shell import Facts, Grid, Shell
from revline.studies.cycle_search import find_onset_of, find_orbit, run_until_decided

if TYPE_CHECKING:
    from revline.design.loops.hunting import HuntingOrbit, UnrefinedCycle
    from revline.design.loops.onset import HuntingOnset

REMEDY = "`loop` runs it and tells the cycle with its spread, `accept` the gains at which it begins"


def limit_cycle(
    *,
    controller: Annotated[Path, typer.Argument(metavar="CONTROLLER.json", help="Controller file.")],
    throttle: ThrottleOption,
    load: LoadOption = 0.0,
    command: Annotated[
        float, typer.Option("--command", metavar="RAD_S", help="Step of the speed command that the loop starts with [rad/s].")
    ] = 60.0,
    until: Annotated[
        float, typer.Option("--until", metavar="S", help="Stop time of the simulation [s]; made longer where it does not decide.")
    ] = 20.0,
    onset: Annotated[bool, typer.Option("--onset", help="Also find at which multiple of all gains hunting begins, and how.")] = False,
    engine: EngineOption = DEFAULT_ENGINE,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the limit cycle that a closed speed loop ends in after a step of its command, and whether it is stable.

    The loop is run as by `loop`. If it hunts, the cycle is computed as an orbit, its kinks at the throttle's limits met, and held against
    the run; that they disagree is an error. A cycle that cannot be computed so is given as the run shows it, with a warning. If it
    settles, diverges or stalls, that is the result.
    """
    from revline.analysis.trim import find_trim
    from revline.design.loops.closed_loop import LoopTask, describe_outcome
    from revline.io.controller_files import read_controller
    from revline.io.cycle_records import onset_record, run_record
    from revline.io.engine_files import load_engine
    from revline.io.json_files import format_json

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "limit cycle")
    file = read_controller(controller)
    plant = load_engine(engine)
    trim = find_trim(plant, inputs={"throttle": throttle, "load_torque": load})
    with shell.busy("running the loop; the first run of all compiles it, which takes some seconds"):
        run = run_until_decided(plant, trim, file, LoopTask(command=command, until=until), name=controller.name, remedy=REMEDY)
    record, parts = dict(run_record(run)), list[Facts | Grid | str]([describe_outcome(run)])
    with shell.busy("finding the cycle"):
        orbit = find_orbit(plant, trim, run)
    if orbit is not None:
        parts.append(_add_orbit(shell, record, orbit, f"Limit cycle of {plant.name} under {file.feedback_gains.rule}"))
    if onset:
        with shell.busy("following the cycles from where they begin"):
            begins = find_onset_of(plant, trim, run, orbit)
        record |= onset_record(begins)
        parts += _onset_parts(begins)
    shell.write(out, format_json(record), "limit cycle")
    shell.show(record, *parts, text_on=out)


def _add_orbit(shell: Shell, record: dict[str, object], orbit: "HuntingOrbit | UnrefinedCycle", title: str) -> Facts:
    from revline.design.loops.hunting import UnrefinedCycle
    from revline.io.cycle_records import describe_orbit, describe_unrefined, orbit_record, unrefined_record

    if isinstance(orbit, UnrefinedCycle):
        shell.warn(f"the cycle is known from the simulation only, its stability from that alone: {orbit.reason}")
        record |= unrefined_record(orbit)
        return Facts(title, describe_unrefined(orbit))
    record |= orbit_record(orbit)
    return Facts(title, describe_orbit(orbit))


def _onset_parts(onset: "HuntingOnset") -> "list[Facts | Grid | str]":
    from revline.io.cycle_records import describe_onset

    rows = [
        (p.factor, p.amplitude, p.period, ("stable" if p.stable else "unstable") if p.certain else "not certain", f"{p.largest:.4g}")
        for p in onset.points
    ]
    header = ("factor of all gains", "amplitude [rad/s]", "period [s]", "cycle", "largest multiplier")
    parts: list[Facts | Grid | str] = [Facts("Onset of hunting", describe_onset(onset)), Grid("Cycles from the onset on", header, rows)]
    if onset.unjudged:
        parts.append(f"not judged, stable or not: {len(onset.unjudged)} more cycles of the family (the first: {onset.unjudged[0].reason})")
    return parts
