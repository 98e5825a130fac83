"""When and with what a study's results were made: kept beside them, so that a report made again says the same."""

import datetime as dt
import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata

from revline import __version__
from revline.studies.chain import LIBRARIES, code_digest
from revline.studies.config import StudyConfig
from revline.values import fingerprint

DRAWING = ("matplotlib",)
"""Libraries that shape the figures, not the numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """How the results of a study were made.

    Attributes:
        on: date and time in UTC.
        version: of revline.
        code: digest of its source and of the libraries' versions.
        questions: fingerprint of the questions and of the engine.
        software: names and versions.
        seconds_of_numbers: wall time until all numbers were there; steps that were kept take none.
        seconds: wall time of the whole run, figures and reports included; 0 until it is known.
    """

    on: str
    version: str
    code: str
    questions: str
    software: tuple[tuple[str, str], ...]
    seconds_of_numbers: float
    seconds: float = 0.0


def describe_making(config: StudyConfig, seconds: float) -> Made:
    """Describe results that are made now.

    Args:
        config: the questions.
        seconds: wall time until all numbers were there.
    """
    return Made(
        on=dt.datetime.now(tz=dt.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=__version__,
        code=code_digest(),
        questions=fingerprint(config, config.load_engine().content_digest),
        software=tuple(_software()),
        seconds_of_numbers=seconds,
    )


def _software() -> Iterator[tuple[str, str]]:
    yield "Python", platform.python_version()
    yield from ((library, metadata.version(library)) for library in (*LIBRARIES, *DRAWING))
