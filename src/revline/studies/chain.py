"""A study as a chain of steps that are kept: each is a function of frozen values, stored under the fingerprint of what it was made from.

A study that is interrupted keeps its finished steps; started again in the same folder with the same questions, it goes on from them.
"""

import functools
import hashlib
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import revline
from revline import __version__
from revline.errors import InvalidInputError
from revline.io.value_files import read_value, write_value
from revline.values import fingerprint

T = TypeVar("T")
Report = Callable[[str, float], None]
"""Told the name of the step under way, and which part of the whole study is done."""

FOLDER = "steps"
KEY = re.compile("[0-9a-f]{32}")
LIBRARIES = ("numpy", "scipy", "numba")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """Steps of a study in a folder.

    Attributes:
        folder: the study's folder; steps lie in its subfolder.
        origin: fingerprint of what all steps depend on: engine and questions.
        report: told how far the study is.
    """

    folder: Path
    origin: str
    report: Report = field(default=lambda _, __: None)

    def step(self, name: str, make: Callable[[], T], *made_from: object, share: tuple[float, float]) -> T:
        """Take a step's result from the folder if it was made from the same, else make and keep it.

        What is given is always what was read from the folder: a study that goes on computes with the same values as one that ran through.

        Args:
            name: of the step, also of its file.
            make: makes the result.
            made_from: results of earlier steps that it depends on.
            share: which part of the study is done before and after it, 0 to 1.

        Raises:
            InvalidInputError: the result is no value that can be kept, or the folder cannot be written.
        """
        self.report(name, share[0])
        path = self.folder / FOLDER / f"{name}-{fingerprint(self.origin, code_digest(), name, *made_from)}.json"
        kept = _read_kept(path)
        if not kept:
            write_value(_with_folder(path), make())
            kept = (read_value(path),)
            _remove_older(name, path)
        self.report(name, share[1])
        result: T = kept[0]
        return result


def _read_kept(path: Path) -> tuple[Any, ...]:
    """Read a kept result; nothing where there is none, or one that is damaged and will be made again."""
    try:
        return (read_value(path),) if path.is_file() else ()
    except InvalidInputError:
        return ()


def _with_folder(path: Path) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"folder {path.parent} cannot be made: {error.strerror}; give a folder that may be written"
        raise InvalidInputError(message, path=str(path.parent)) from error
    return path


def _remove_older(name: str, path: Path) -> None:
    """Remove what the step gave to other questions; a step whose name merely begins alike keeps its own."""
    for old in path.parent.glob(f"{name}-*.json"):
        if old != path and KEY.fullmatch(old.stem.removeprefix(f"{name}-")):
            old.unlink(missing_ok=True)


@functools.cache
def code_digest() -> str:
    """Digest of the package's own source and data, and of the numerical libraries' versions.

    A result made by other code is not taken for this code's.
    """
    digest = hashlib.sha256(__version__.encode())
    for library in LIBRARIES:
        digest.update(f"{library} {metadata.version(library)}".encode())
    root = Path(revline.__file__).parent
    for path in sorted(root.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:32]


@dataclass(frozen=True, slots=True)
class Stopwatch:
    """Wall time since it was made, in s."""

    start: float = field(default_factory=time.perf_counter)

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.start
