"""Commands about engines at rest: engines, trim, linearize."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from revline.cli.options import DEFAULT_ENGINE, EngineOption, JsonOption, LoadOption, OutOption, QuietOption, ThrottleOption
from revline.cli.shell import Facts, Grid, Shell, show_roots
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.lti.state_space import DelayStateSpace

StepTimeOption = Annotated[
    float | None, typer.Option("--until", metavar="S", help="Time that --step-out covers [s], in 1000 intervals; 5 if left out.")
]

STEP_TIME = 5.0
"""Seconds that a step response covers unless told otherwise."""


def engines(
    *,
    name: Annotated[str | None, typer.Argument(metavar="[NAME|FILE]", help="Engine whose parameters to print.", show_default=False)] = None,
    vector: Annotated[
        bool, typer.Option("--vector", help="Print the vector of 24 numbers instead (a file ending in .txt, .vec or .dat).")
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """List the built-in engines, or print one's parameters as an engine file (TOML) with units, meanings and sources.

    The file printed is complete: change a number and give the file to any command as --engine.
    """
    import tomllib

    from revline.engine.catalogue import ENGINES
    from revline.io.engine_files import format_engine, load_engine

    shell = Shell(json=json, quiet=quiet)
    if vector:
        _show_vector(shell, name)
        return
    if name is None:
        record: dict[str, object] = {"engines": [{"name": entry.name, "description": entry.description} for entry in ENGINES]}
        shell.show(record, Grid("", ("engine", "what it is"), [(entry.name, entry.description) for entry in ENGINES]))
        return
    text = format_engine(load_engine(name))
    shell.show(tomllib.loads(text), text.rstrip("\n"))


def _show_vector(shell: Shell, name: str | None) -> None:
    from revline.io.engine_files import load_engine
    from revline.io.engine_vectors import format_engine_vector

    if name is None:
        message = "--vector prints one engine's numbers; name the engine, for example `revline engines lee1995 --vector`"
        raise InvalidInputError(message)
    found = format_engine_vector(load_engine(name))
    shell.warn(*found.notes)
    shell.show({"vector": list(found.numbers), "notes": list(found.notes)}, found.text.rstrip("\n"))


def trim(
    *,
    throttle: Annotated[float | None, typer.Option("--throttle", metavar="DEG", help="Throttle angle [deg], 0 to 90.")] = None,
    speed: Annotated[float | None, typer.Option("--speed", metavar="RAD_S", help="Engine speed [rad/s]; the throttle is found.")] = None,
    load: LoadOption = 0.0,
    engine: EngineOption = DEFAULT_ENGINE,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the steady operating point at a throttle angle or at a speed, under a load, and say whether it is stable."""
    from revline.analysis.linearize import linearize as linearize_system
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine
    from revline.io.point_records import trim_record, trim_warnings
    from revline.units import speed_to_rpm

    shell = Shell(json=json, quiet=quiet)
    plant = load_engine(engine)
    if throttle is not None and speed is None:
        point = find_trim(plant, inputs={"throttle": throttle, "load_torque": load})
    elif speed is not None and throttle is None:
        point = find_trim(plant, inputs={"load_torque": load}, outputs={"engine_speed": speed}, free=("throttle",))
    else:
        message = "give either --throttle or --speed: one is known, the other is found"
        raise InvalidInputError(message)
    linear = linearize_system(plant, point)
    model, remarks = linear.model, [*trim_warnings(point), *(str(kink) for kink in linear.kinks)]
    shell.warn(*remarks)
    found = point.output("engine_speed")
    rows: list[tuple[str, float | str, str]] = [
        ("throttle", point.input("throttle"), "deg"),
        ("load torque", point.input("load_torque"), "N m"),
        ("engine speed", found, f"rad/s = {speed_to_rpm(found):.6g} rpm"),
        ("manifold pressure", point.output("manifold_pressure"), "kPa"),
        ("gain at rest", model.static_gain("throttle", "engine_speed"), "rad/s per deg"),
        *((f"lag of {v.name.replace('_', ' ')}", point.lag(v.name), "s") for v in point.channel_variables),
        ("stable", "yes" if point.stable else f"no, {point.unstable_count} unstable roots", ""),
        ("residual", point.residual, "1/s"),
    ]
    shell.show({**trim_record(point, model), "warnings": remarks}, Facts(f"Trim of {point.system}", rows))


def linearize(
    *,
    throttle: ThrottleOption,
    load: LoadOption = 0.0,
    engine: EngineOption = DEFAULT_ENGINE,
    roots: Annotated[int | None, typer.Option("--roots", metavar="N", min=1, help="List the N right-most characteristic roots.")] = None,
    roots_right_of: Annotated[
        float | None,
        typer.Option("--roots-right-of", metavar="RAD_S", help="List all roots with a larger real part [rad/s], their number proven."),
    ] = None,
    step: Annotated[
        Path | None,
        typer.Option("--step-out", metavar="FILE.csv", help="Write how all outputs answer a throttle step of 1 deg, delays exact."),
    ] = None,
    until: StepTimeOption = None,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Linearise an engine exactly about its trim: matrices and delays, nothing approximated.

    dx/dt = A x + Bu u + Bz zd, y = Cy x + Dyu u + Dyz zd, z = Cz x + Dzu u + Dzz zd, zd_i(t) = z_i(t - lag_i).
    """
    from revline.analysis.linearize import linearize as linearize_system
    from revline.analysis.trim import find_trim
    from revline.io.engine_files import load_engine
    from revline.io.json_files import format_json
    from revline.io.point_records import linearization_record

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "linear model")
    _prepare_step(shell, step, out, until)
    plant = load_engine(engine)
    point = find_trim(plant, inputs={"throttle": throttle, "load_torque": load})
    found = linearize_system(plant, point)
    listed = _list_roots(found.model, roots, roots_right_of)
    record = {**linearization_record(found, point), **listed, **_write_step(shell, step, found.model, until)}
    shell.write(out, format_json(record), "linear model")
    shell.warn(*record["warnings"])
    model = found.model
    rows: list[tuple[str, float | str, str]] = [
        ("states", ", ".join(f"{s.name} [{s.unit}]" for s in model.states), ""),
        ("inputs", ", ".join(f"{s.name} [{s.unit}]" for s in model.inputs), ""),
        *((f"lag of {c.name.replace('_', ' ')}", float(lag), "s") for c, lag in zip(model.channels, model.lags, strict=True)),
        ("gain at rest", model.static_gain("throttle", "engine_speed"), "rad/s per deg"),
        ("right-most root", show_roots(point.roots.roots[:1]), "rad/s"),
        *(("root", show_roots([complex(*pair)]), "rad/s") for pair in listed.get("roots_rad_s", ())),
        ("stable", "yes" if point.stable else f"no, {point.unstable_count} unstable roots", ""),
        ("residual", found.residual, "1/s"),
        *(
            ("nearest limit", f"{m['argument']} = {m['at']:.6g}", f"{m['unit']}, {m['change']:+.4g} from here")
            for m in record["limits"][:1]
        ),
    ]
    shell.show(record, Facts(f"Linear model of {point.system} at {throttle:g} deg, {load:g} N m", rows), text_on=out)


def _list_roots(model: "DelayStateSpace", count: int | None, right_of: float | None) -> Mapping[str, Any]:
    """Roots by number or right of a line, as a record; nothing where none are asked for."""
    from revline.io.point_records import region_roots_record, roots_record
    from revline.lti.root_regions import Region, find_roots_in
    from revline.lti.roots import characteristic_roots

    if count is not None and right_of is not None:
        message = "give either --roots or --roots-right-of: roots are listed by number or right of a line"
        raise InvalidInputError(message)
    if count is not None:
        return roots_record(characteristic_roots(model, count=count))
    return region_roots_record(find_roots_in(model, Region(left=right_of))) if right_of is not None else {}


def _prepare_step(shell: Shell, step: Path | None, out: Path | None, until: float | None) -> None:
    """Refuse a step response that would be lost, or that is described but not asked for."""
    if step is None and until is not None:
        message = f"--until {until:g} is how long --step-out lasts; name a file with --step-out, or leave --until out"
        raise InvalidInputError(message)
    if step is not None and out is not None and step.absolute() == out.absolute():
        message = f"--step-out {step} must be a file of its own; name another than that of --out"
        raise InvalidInputError(message)
    shell.prepare(step, "step response")


def _write_step(shell: Shell, path: Path | None, model: "DelayStateSpace", until: float | None) -> Mapping[str, Any]:
    """Write the step response where a file is named, and give its summary as a record."""
    from revline.io.step_records import STEP_INTERVALS, format_step, step_record
    from revline.lti.time_response import sample_times, step_response

    if path is None:
        return {}
    found = step_response(model, sample_times(STEP_TIME if until is None else until, STEP_INTERVALS), input_name="throttle")
    shell.write(path, format_step(found), "step response")
    return {"step": step_record(found)}
