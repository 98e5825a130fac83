"""When and how a study's numbers were made: a report made again later still says it of the numbers, not of itself."""

import contextlib
import datetime as dt
from dataclasses import dataclass
from pathlib import Path

from revline.errors import InvalidInputError
from revline.io.value_files import read_value, write_value
from revline.studies.study_results import StudyResults
from revline.values import fingerprint

MAKING = "making.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Making:
    """When and how a study's numbers were made: what a report says of them however often it is made again.

    Attributes:
        results: fingerprint of the results that it is about.
        made_on: when they were finished, in UTC.
        seconds: wall time of the run that finished them.
        kept: how many steps that run took from earlier ones.
    """

    results: str
    made_on: str
    seconds: float
    kept: int


def keep_making(path: Path, results: StudyResults, seconds: float, kept: int) -> None:
    """Note how results were made; those that were there already keep their note.

    Args:
        path: file to write.
        results: that were made.
        seconds: wall time of the run that finished them.
        kept: steps that it took from earlier runs.
    """
    about = fingerprint(results)
    with contextlib.suppress(InvalidInputError):  # a damaged note is written anew
        if path.is_file() and read_making(path).results == about:
            return
    now = dt.datetime.now(tz=dt.UTC).strftime("%Y-%m-%d %H:%M UTC")
    write_value(path, Making(results=about, made_on=now, seconds=seconds, kept=kept))


def read_making(path: Path) -> Making:
    """Read the note.

    Raises:
        InvalidInputError: the file cannot be read, or holds another value.
    """
    making = read_value(path)
    if not isinstance(making, Making):
        message = f"{path} does not say how a study was made; run `revline study` again into its folder"
        raise InvalidInputError(message, path=str(path))
    return making
