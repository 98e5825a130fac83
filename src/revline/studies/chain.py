"""A study as a chain of steps that are kept: each is a function of frozen values, stored under the fingerprint of what it was made from.

A study that is interrupted keeps its finished steps; started again in the same folder with the same questions, it goes on from them.
"""

import functools
import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import revline
from revline import __version__
from revline.errors import InvalidInputError
from revline.io.value_files import read_value, write_value
from revline.values import fingerprint

T = TypeVar("T")
Report = Callable[[str, float], None]
"""Told the name of the step under way, and which part of the whole study is done."""

FOLDER = "steps"


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

        Args:
            name: of the step, also of its file.
            make: makes the result.
            made_from: results of earlier steps that it depends on.
            share: which part of the study is done before and after it, 0 to 1.
        """
        self.report(name, share[0])
        key = fingerprint(self.origin, code_digest(), name, *made_from)
        path = self.folder / FOLDER / f"{name}-{key}.json"
        if path.is_file():
            try:
                kept: T = read_value(path)
            except InvalidInputError:
                path.unlink()
            else:
                self.report(name, share[1])
                return kept
        result = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        for old in path.parent.glob(f"{name}-*.json"):
            old.unlink()
        write_value(path, result)
        self.report(name, share[1])
        return result


@functools.cache
def code_digest() -> str:
    """Digest of the package's own source: a result made by other code is not taken for this code's."""
    digest = hashlib.sha256(__version__.encode())
    root = Path(revline.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
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
