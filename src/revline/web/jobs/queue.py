"""All jobs of a data folder: one runs, some wait, the others have ended. Several servers may share the folder."""

import fcntl
import os
import re
import secrets
import shutil
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final, NamedTuple

from revline.errors import InvalidInputError
from revline.web.jobs.folder import (
    ACTIVE,
    OUT,
    PROGRESS,
    RESUMABLE,
    Kind,
    Note,
    Status,
    job_record,
    list_files,
    read_note,
    status_of,
    write_note,
)
from revline.web.jobs.processes import Identity, has_ended, identify, lives, send, start_process
from revline.web.problems import make_problem

FOLDER: Final = "jobs"
NAME: Final = re.compile(r"\d{8}T\d{6}-[0-9a-f]{8}")
PATIENCE: Final = 5.0
"""Seconds that a cancelled process has to end by itself."""

WAITING: Final = 10
KEPT: Final = 200
"""Jobs that wait at most, and jobs that are kept at most."""


class JobError(Exception):
    """A wish about a job that cannot be met; `problem` says why."""

    def __init__(self, kind: str, title: str, detail: str, status: HTTPStatus) -> None:
        super().__init__(detail)
        self.problem = make_problem(kind, title, detail, status=status)


class Wish(NamedTuple):
    """A change of a job that some may have and others not.

    Attributes:
        among: how a job must stand.
        kind: of the refusal of others.
        title: of the refusal.
        remedy: what can be done.
    """

    among: frozenset[Status]
    kind: str
    title: str
    remedy: str


CANCEL: Final = Wish(ACTIVE, "job-ended", "the job has ended", "only a job that waits or runs can be cancelled")
RESUME: Final = Wish(RESUMABLE, "job-not-stopped", "the job was not stopped", "only one that was interrupted or cancelled can go on")
DELETE: Final = Wish(frozenset(Status) - ACTIVE, "job-active", "the job has not ended", "cancel it first")


class Jobs:
    """The jobs of a data folder.

    Args:
        data: the data folder; made when the first job is.
    """

    def __init__(self, data: Path) -> None:
        self._folder = data / FOLDER
        self._mine: list[int] = []
        self._guard = threading.Lock()

    def records(self) -> dict[str, Any]:
        """Describe all jobs, the newest first, and say which could not be read."""
        found, warnings = [], []
        for folder in sorted(self._folders(), reverse=True):
            try:
                found.append(job_record(folder, read_note(folder)))
            except InvalidInputError as error:
                warnings.append(str(error))
        return {"jobs": found, "warnings": warnings}

    def record(self, name: str) -> dict[str, Any]:
        """Describe a job.

        Raises:
            JobError: there is none of that name.
        """
        folder = self._find(name)
        return job_record(folder, read_note(folder))

    def create(self, kind: Kind, files: Mapping[str, str]) -> dict[str, Any]:
        """Put a job at the end of the queue.

        Args:
            kind: what it does.
            files: what its folder begins with, by name.

        Raises:
            JobError: too many wait, or too many are kept.
            InvalidInputError: the folder cannot be written.
        """
        with self._alone():
            stands = self._standing()
            waiting = sum(status is Status.QUEUED for _, _, status in stands)
            if waiting >= WAITING:
                detail = f"{waiting} jobs wait already, at most {WAITING} may; cancel one, or wait until one has ended"
                raise JobError("too-many-jobs", "too many jobs wait", detail, HTTPStatus.TOO_MANY_REQUESTS)
            if len(stands) >= KEPT:
                detail = f"{len(stands)} jobs are kept, at most {KEPT} may be; delete some that have ended"
                raise JobError("too-many-jobs", "too many jobs are kept", detail, HTTPStatus.INSUFFICIENT_STORAGE)
            now = datetime.now(UTC)
            name = f"{now:%Y%m%dT%H%M%S}-{secrets.token_hex(4)}"
            hidden, folder = self._folder / f".{name}", self._folder / name
            hidden.mkdir(mode=0o700)
            for key, text in files.items():
                (hidden / key).write_text(text, encoding="utf-8")
            write_note(hidden, Note(name=name, kind=kind, created=f"{now:%Y-%m-%dT%H:%M:%SZ}", revision=1, queued=time.time()))
            hidden.rename(folder)
            self._start_next()
            return job_record(folder, read_note(folder))

    def cancel(self, name: str, revision: int) -> dict[str, Any]:
        """Stop a job that waits or runs; what a study has finished is kept.

        Raises:
            JobError: there is none, it was changed meanwhile, or it has ended.
        """
        with self._alone():
            folder, note = self._expect(name, revision, CANCEL)
            write_note(folder, replace(note, cancelled=time.time(), revision=note.revision + 1))
            if note.process is not None:
                send(note.process, signal.SIGTERM)
            return job_record(folder, read_note(folder))

    def resume(self, name: str, revision: int) -> dict[str, Any]:
        """Put a job that was interrupted or cancelled at the end of the queue again; a study goes on from its finished steps.

        Raises:
            JobError: there is none, it was changed meanwhile, or it stands otherwise.
        """
        with self._alone():
            folder, note = self._expect(name, revision, RESUME)
            (folder / PROGRESS).unlink(missing_ok=True)
            write_note(folder, replace(note, cancelled=0.0, process=None, queued=time.time(), revision=note.revision + 1))
            self._start_next()
            return job_record(folder, read_note(folder))

    def delete(self, name: str, revision: int) -> None:
        """Remove a job that has ended, with its results.

        Raises:
            JobError: there is none, it was changed meanwhile, or it has not ended.
        """
        with self._alone():
            folder, _ = self._expect(name, revision, DELETE)
            gone = folder.rename(folder.with_name(f".gone-{name}"))
            shutil.rmtree(gone, ignore_errors=True)

    def file(self, name: str, file: str) -> Path:
        """Find a result by its name in the job's own list.

        Raises:
            JobError: there is no such job, or no such result.
        """
        folder = self._find(name)
        if file not in list_files(folder):
            raise JobError("not-found", "no such result", f"job {name} has no result {file[:100]!r}", HTTPStatus.NOT_FOUND)
        return folder / OUT / file

    def tend(self) -> None:
        """End what was cancelled and did not end by itself, note which processes have ended, and start the next job."""
        if not self._folder.is_dir():
            return
        with self._alone():
            self._mine = [pid for pid in self._mine if not has_ended(pid)]
            for _, note, status in self._standing():
                if status is Status.RUNNING and note.cancelled and note.process and time.time() > note.cancelled + PATIENCE:
                    send(note.process, signal.SIGKILL)
            self._start_next()

    def _start_next(self) -> None:
        stands = self._standing()
        waiting = [(note.queued, folder, note) for folder, note, status in stands if status is Status.QUEUED]
        if not waiting or any(note.process is not None and lives(note.process) for _, note, _ in stands):
            return
        _, folder, note = min(waiting, key=lambda entry: (entry[0], entry[1].name))
        pid = start_process(folder)
        self._mine.append(pid)
        identity = identify(pid) or Identity(pid, 0, "")  # it may have ended already
        write_note(folder, replace(note, process=identity, revision=note.revision + 1))

    def _standing(self) -> list[tuple[Path, Note, Status]]:
        found = []
        for folder in self._folders():
            try:
                note = read_note(folder)
            except InvalidInputError:  # told by records()
                continue
            found.append((folder, note, status_of(folder, note)))
        return found

    def _folders(self) -> list[Path]:
        if not self._folder.is_dir():
            return []
        return [path for path in self._folder.iterdir() if NAME.fullmatch(path.name) and path.is_dir()]

    def _find(self, name: str) -> Path:
        folder = self._folder / name
        if not NAME.fullmatch(name) or not folder.is_dir():
            raise JobError("not-found", "no such job", f"there is no job {name[:60]!r}; it may have been deleted", HTTPStatus.NOT_FOUND)
        return folder

    def _expect(self, name: str, revision: int, wish: Wish) -> tuple[Path, Note]:
        folder = self._find(name)
        note = read_note(folder)
        if note.revision != revision:
            detail = (
                f"job {name} was changed meanwhile, perhaps from another page: its revision is {note.revision}, "
                f"and the request was made for {revision}; look at the job again"
            )
            raise JobError("stale", "the job was changed meanwhile", detail, HTTPStatus.PRECONDITION_FAILED)
        status = status_of(folder, note)
        if status not in wish.among:
            raise JobError(wish.kind, wish.title, f"job {name} is {status}; {wish.remedy}", HTTPStatus.CONFLICT)
        return folder, note

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other threads and other servers out while jobs change."""
        with self._guard:
            try:
                self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
                file = os.open(self._folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            except OSError as error:
                message = f"the data folder {self._folder} cannot be written: {error.strerror}; name another with --data"
                raise InvalidInputError(message) from error
            try:
                fcntl.flock(file, fcntl.LOCK_EX)
                yield
            finally:
                os.close(file)
