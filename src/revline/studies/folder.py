"""The folder of a study: one study at a time works in it, and what an earlier one left there is not taken for this one's."""

import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from revline.errors import InvalidInputError
from revline.io.value_files import read_value, write_value
from revline.studies.chain import FOLDER

LOCK = ".lock"
WRITTEN = "written.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """What a study wrote into its folder.

    Attributes:
        questions: fingerprint of questions and engine.
        code: digest of the code that answered.
        is_whole: whether the study was finished.
        files: paths within the folder.
    """

    questions: str
    code: str
    is_whole: bool
    files: tuple[str, ...]


@contextmanager
def study_folder(folder: Path) -> Iterator[Path]:
    """Make a study's folder, see that it can be written before anything long is begun, and keep other studies out of it.

    Yields:
        The subfolder of the steps.

    Raises:
        InvalidInputError: it cannot be written, or another process works in it.
    """
    steps = folder / FOLDER
    try:
        steps.mkdir(parents=True, exist_ok=True)
        probe = folder / ".probe"
        probe.write_text("")
        probe.unlink()
        file = os.open(steps / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        message = f"the folder {folder} cannot be written: {error.strerror}; name one that may be written with --out"
        raise InvalidInputError(message, path=str(folder)) from error
    try:
        _lock(file, folder)
        yield steps
    finally:
        os.close(file)  # which opens the lock, as the end of a process does


def _lock(file: int, folder: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        message = f"another study is at work in {folder}; wait for its end, or name another folder with --out"
        raise InvalidInputError(message, path=str(folder)) from error
    except OSError:
        return  # a file system without locks: the steps, each named by what it was made from, still do not mix


def read_written(steps: Path) -> Written | None:
    """What an earlier study wrote; nothing where none did, or its note is damaged."""
    try:
        found = read_value(steps / WRITTEN) if (steps / WRITTEN).is_file() else None
    except InvalidInputError:
        return None
    return found if isinstance(found, Written) else None


def keep_written(steps: Path, written: Written) -> None:
    """Note what is written."""
    write_value(steps / WRITTEN, written)


def is_finished(folder: Path, earlier: Written | None, questions: str, code: str) -> bool:
    """Whether the very study that is asked for lies in the folder, whole."""
    return (
        earlier is not None
        and earlier.is_whole
        and (earlier.questions, earlier.code) == (questions, code)
        and all((folder / name).is_file() for name in earlier.files)
    )


def remove_files(folder: Path, names: Iterable[str]) -> None:
    """Remove files that a study wrote, by their paths within its folder; others are left alone."""
    inside = folder.resolve()
    for name in names:
        path = folder / name
        if path.is_file() and path.resolve().is_relative_to(inside):
            path.unlink()
