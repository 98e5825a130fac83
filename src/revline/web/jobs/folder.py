"""A job as a folder: what is asked, how far it is, how it ended, and its results.

What the server writes, the process does not, and conversely.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from revline.errors import InvalidInputError
from revline.io.json_files import read_json, write_json
from revline.web.jobs.processes import Identity, lives

SCHEMA: Final = "revline.job/1"
JOB, PROGRESS, END, LOG = "job.json", "progress.json", "end.json", "log.txt"
"""The server's note of a job; the process's note of how far it is, and of how it ended; what it said."""

STATE, QUESTIONS, ENGINE = "state.json", "study.toml", "engine.toml"
OUT: Final = "out"
"""Where the results go."""

SHOWN: Final = (".html", ".json", ".csv", ".png", ".svg", ".pdf")
"""Endings of files that are results."""

HIDDEN: Final = "steps"
"""Folder of what a study keeps for itself."""

KNOWN_PART: Final = 0.02
"""Part of a job that must be done before the time that it still needs is told."""


class Kind(StrEnum):
    """What a job does."""

    STUDY = "study"
    SINESTREAM = "sinestream"


class Status(StrEnum):
    """How a job stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"
    INTERRUPTED = "interrupted"


ACTIVE: Final = frozenset({Status.QUEUED, Status.RUNNING})
RESUMABLE: Final = frozenset({Status.INTERRUPTED, Status.CANCELLED})


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """What the server knows of a job.

    Attributes:
        name: the job's identifier, the name of its folder.
        kind: what it does.
        created: when it was asked for, in UTC.
        revision: rises with each change that a client or the queue makes.
        queued: when it came to the end of the queue, in s since 1970.
        cancelled: when it was cancelled, in s since 1970; 0 where it was not.
        process: that works on it, or did.
    """

    name: str
    kind: Kind
    created: str
    revision: int
    queued: float
    cancelled: float = 0.0
    process: Identity | None = None


def read_note(folder: Path) -> Note:
    """Read what the server knows of a job.

    Raises:
        InvalidInputError: there is no such job, or its note is damaged.
    """
    record = read_json(folder / JOB, "job")
    record.require_schema(SCHEMA)
    try:
        process = record.entries.get("process")
        return Note(
            name=folder.name,
            kind=Kind(record.text("kind", "")),
            created=record.text("created", ""),
            revision=int(record.number("revision")),
            queued=record.number("queued"),
            cancelled=record.number("cancelled"),
            process=Identity(int(process["pid"]), int(process["start"]), str(process["boot"])) if process else None,
        )
    except (KeyError, TypeError, ValueError) as error:
        message = f"job {folder.name} is damaged: {error}; remove its folder {folder}"
        raise InvalidInputError(message) from error


def write_note(folder: Path, note: Note) -> None:
    """Write what the server knows of a job, whole or not at all."""
    record: dict[str, Any] = {
        "schema": SCHEMA,
        "kind": str(note.kind),
        "created": note.created,
        "revision": note.revision,
        "queued": note.queued,
        "cancelled": note.cancelled,
    }
    if note.process is not None:
        record["process"] = note.process._asdict()
    write_json(folder / JOB, record, "job")


def status_of(folder: Path, note: Note) -> Status:
    """Tell how a job stands: by its end if it has one, else by its process."""
    running = note.process is not None and lives(note.process)  # asked first: a process that has ended wrote its end before
    end = _entries(folder / END)
    if end:
        return Status(str(end["status"]))
    if running:
        return Status.RUNNING
    if note.cancelled:
        return Status.CANCELLED
    return Status.QUEUED if note.process is None else Status.INTERRUPTED


def job_record(folder: Path, note: Note) -> dict[str, Any]:
    """Describe a job as the interface shows it."""
    status, progress = status_of(folder, note), _entries(folder / PROGRESS)
    done = 1.0 if status is Status.DONE else float(progress.get("done", 0.0))
    began, told = (float(progress.get(key, 0.0)) for key in ("began", "told"))
    seconds = max((time.time() if status is Status.RUNNING and began else told) - began, 0.0)
    record: dict[str, Any] = {
        "id": note.name,
        "kind": str(note.kind),
        "status": str(status),
        "created": note.created,
        "revision": note.revision,
        "progress": done,
        "stage": "waiting" if status is Status.QUEUED else str(progress.get("stage", "starting")),
        "seconds": seconds,
        "files": list_files(folder),
        "state": _entries(folder / STATE),
    }
    if status is Status.RUNNING and done > KNOWN_PART:
        record["remaining_s"] = max((told - began) / done - seconds, 0.0)
    problem = _entries(folder / END).get("error")
    return record if problem is None else {**record, "error": problem}


def list_files(folder: Path) -> list[str]:
    """Names of a job's results, in a fixed order; a link is none."""
    out = folder / OUT
    found = (path for path in out.rglob("*") if path.suffix in SHOWN and path.is_file() and not path.is_symlink())
    names = (path.relative_to(out) for path in found if path.resolve().is_relative_to(out.resolve()))
    return sorted(name.as_posix() for name in names if HIDDEN not in name.parts and not name.name.startswith("."))


def _entries(path: Path) -> Mapping[str, Any]:
    """What a file holds; nothing where it is not there yet, or damaged."""
    try:
        return read_json(path, "job").entries if path.is_file() else {}
    except InvalidInputError:
        return {}
