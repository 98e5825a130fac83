"""Simulated runs as files: the samples as CSV, and beside it the state from which the run goes on, bit for bit.

The state file is NAME.csv.state.npz; it holds arrays and texts, nothing that could run.
"""

import contextlib
import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from revline.dde.kernel import STANDARD
from revline.dde.trajectory import Checkpoint, Run, Trajectory
from revline.errors import InvalidInputError
from revline.io.csv_text import format_csv
from revline.io.headers import header as column_header

SCHEMA = "revline.run/1"
MOST_SAMPLES = 10_000_000
"""Samples in one file: about 2 GB of text."""

ARRAYS = ("state", "nodes", "segments")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrigin:
    """What a run was made from, as the command line names it: engine, throttle in deg, load in N m, input text.

    Names of files in it begin in `folder`.
    """

    engine: str
    throttle: float
    load: float
    input: str
    folder: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SavedRun:
    """A run that can go on."""

    origin: RunOrigin
    checkpoint: Checkpoint


def state_path(path: Path) -> Path:
    """Name of the state file beside a run's CSV."""
    return path.with_name(f"{path.name}.state.npz")


def check_place(path: Path, continued: Path | None) -> None:
    """Refuse a place that cannot hold a run's two files, or would replace the run that is continued.

    Args:
        path: of the samples.
        continued: the run that goes on.

    Raises:
        InvalidInputError: as said.
    """
    if str(path) == "-":
        message = "a run has two files, its samples and its state; name a file after --out"
        raise InvalidInputError(message)
    if continued is not None and path.resolve() == continued.resolve():
        message = f"--out {path} would replace the run that is continued, whose samples would be lost; name another file"
        raise InvalidInputError(message, path=str(path))


def check_samples(duration: float, step: float, every: int) -> None:
    """Refuse a run of more samples than a file shall hold.

    Args:
        duration: of the run, in seconds.
        step: between grid points, in seconds.
        every: each how-manieth is stored.

    Raises:
        InvalidInputError: the message says with which `--every` it fits.
    """
    if not (math.isfinite(duration) and math.isfinite(step) and step > 0.0 and every > 0):
        return  # refused elsewhere, by name
    count = duration / step / every
    if count > MOST_SAMPLES:
        fitting = math.ceil(duration / step / MOST_SAMPLES)
        message = f"{count:.4g} samples are more than a file shall hold, {MOST_SAMPLES}; give --every {fitting} or more, or stop earlier"
        raise InvalidInputError(message, samples=count)


def format_run(trajectory: Trajectory, origin: RunOrigin, more: Mapping[str, str | float] | None = None) -> str:
    """Format a run's samples as CSV: time, inputs, states that are no output, outputs; every column names its unit.

    Args:
        trajectory: the run.
        origin: what it was made from, for the comment lines.
        more: further comment lines, by key.
    """
    columns = [("time_s", trajectory.times)]
    seen = {"time_s"}
    parts = (
        (trajectory.input_names, trajectory.input_units, trajectory.inputs),
        (trajectory.output_names, trajectory.output_units, trajectory.outputs),
        (trajectory.state_names, trajectory.state_units, trajectory.states),
    )
    for names, units, table in parts:
        for position, (name, unit) in enumerate(zip(names, units, strict=True)):
            header = column_header(name, unit)
            if header not in seen:
                seen.add(header)
                columns.append((header, table[:, position]))
    notes: dict[str, str | float] = {
        "engine": origin.engine,
        "throttle_deg": origin.throttle,
        "load_n_m": origin.load,
        "input": origin.input or "none",
        "step_s": trajectory.step,
    }
    return format_csv(columns, notes={**notes, **(more or {})})


def drop_run_state(path: Path) -> None:
    """Remove the state beside a run's CSV, if there is one."""
    with contextlib.suppress(OSError):
        state_path(path).unlink(missing_ok=True)


def write_run_state(path: Path, trajectory: Trajectory, origin: RunOrigin) -> None:
    """Write the state from which a run goes on, beside its CSV.

    Raises:
        InvalidInputError: the run was made with another than the standard method, or the file cannot be written.
    """
    checkpoint = trajectory.checkpoint
    if checkpoint.method != STANDARD:
        message = "only runs of the standard method can be kept; run it again with that"
        raise InvalidInputError(message)
    about = {
        "schema": SCHEMA,
        "system_digest": checkpoint.system_digest,
        "signal_digest": checkpoint.signal_digest,
        "engine": origin.engine,
        "throttle": origin.throttle,
        "load": origin.load,
        "input": origin.input,
        "folder": origin.folder,
    }
    run = checkpoint.run
    buffer = io.BytesIO()
    np.savez_compressed(buffer, about=np.array(json.dumps(about)), state=run.state, nodes=run.nodes, segments=run.segments)
    target = state_path(path)
    part = target.with_name(f".{target.name}.part")
    try:
        part.write_bytes(buffer.getvalue())
        part.replace(target)
    except OSError as error:
        message = f"the run's state {target} cannot be written: {error.strerror}; name a file in a folder that may be written"
        raise InvalidInputError(message, path=str(target)) from error


def read_run_state(path: Path) -> SavedRun:
    """Read the state of a run from beside its CSV.

    Raises:
        InvalidInputError: there is no such file, or it holds no run's state.
    """
    target = state_path(path)
    if not target.is_file():
        message = f"{path} cannot be continued: its state {target.name} does not lie beside it; run `revline simulate --out {path}` first"
        raise InvalidInputError(message, path=str(target))
    try:
        with np.load(io.BytesIO(target.read_bytes()), allow_pickle=False) as content:
            about = json.loads(str(content["about"]))
            state, nodes, segments = (content[name] for name in ARRAYS)
        _check_schema(about["schema"], target)
        origin = RunOrigin(
            engine=about["engine"], throttle=about["throttle"], load=about["load"], input=about["input"], folder=about["folder"]
        )
        checkpoint = Checkpoint(
            system_digest=about["system_digest"],
            signal_digest=about["signal_digest"],
            method=STANDARD,
            run=Run(state=state, nodes=nodes, segments=segments),
        )
        return SavedRun(origin=origin, checkpoint=checkpoint)
    except InvalidInputError:
        raise
    except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
        message = f"{target} holds no state of a run ({error}); it may be damaged or of another version: run it anew"
        raise InvalidInputError(message, path=str(target)) from error


def _check_schema(schema: object, target: Path) -> None:
    if schema != SCHEMA:
        message = f"{target} is of schema {schema!r}, and {SCHEMA} is wanted; run it anew with this version"
        raise InvalidInputError(message, path=str(target))
