"""When and with what a study's results were made: kept beside them, so that a report made again says the same."""

import datetime as dt
import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata

from revline import __version__
from revline.errors import InvalidInputError
from revline.studies.chain import LIBRARIES, code_digest
from revline.studies.config import StudyConfig
from revline.studies.study_results import StudyResults
from revline.system import DelaySystem
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
        answers: fingerprint of the results.
        software: names and versions.
        seconds_of_numbers: wall time until all numbers were there; steps that were kept take none.
        seconds: wall time of the whole run, figures and reports included; 0 until it is known.
    """

    on: str
    version: str
    code: str
    questions: str
    answers: str
    software: tuple[tuple[str, str], ...]
    seconds_of_numbers: float
    seconds: float = 0.0


def describe_making(config: StudyConfig, engine: DelaySystem, results: StudyResults, seconds: float) -> Made:
    """Describe results that are made now.

    Args:
        config: the questions.
        engine: the study's.
        results: the answers.
        seconds: wall time until all numbers were there.
    """
    return Made(
        on=dt.datetime.now(tz=dt.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=__version__,
        code=code_digest(),
        questions=_questions(config, engine),
        answers=fingerprint(results),
        software=tuple(_software()),
        seconds_of_numbers=seconds,
    )


def check_making(config: StudyConfig, engine: DelaySystem, results: StudyResults, made: Made) -> None:
    """See that questions, engine and answers are those that were described.

    Raises:
        InvalidInputError: the answers were changed, or engine or questions are others by now.
    """
    if fingerprint(results) != made.answers:
        message = "the results were changed since they were made: their fingerprint is another; run the study again"
        raise InvalidInputError(message)
    if _questions(config, engine) != made.questions:
        message = "the engine or the questions are not those that the results were made from; run the study again"
        raise InvalidInputError(message)


def _questions(config: StudyConfig, engine: DelaySystem) -> str:
    return fingerprint(config, engine.content_digest)


def _software() -> Iterator[tuple[str, str]]:
    yield "Python", platform.python_version()
    yield from ((library, metadata.version(library)) for library in (*LIBRARIES, *DRAWING))
