"""Two studies side by side: which of their numbers and outcomes differ, and by how much.

Entries of lists are matched by what names them (a controller and its plant, a method and its frequency), not by their place, so that a
study with more frequencies than another is compared at those that both have.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from revline.errors import InvalidInputError, out_of_range
from revline.io.json_files import Json, read_json
from revline.studies.record import SCHEMA
from revline.studies.writing import RESULTS

NAMING = (
    "name", "id", "step", "controller", "plant", "method", "input", "model", "throttle_deg", "step_deg", "frequency_rad_s",
)  # fmt: skip
"""Keys that tell one entry of a list from the others, in the order in which they are shown."""

LEFT_OUT = frozenset(
    {"schema", "seconds", "version", "figures", "guidelines", "warnings", "fine_tuning", "file", "form", "note", "cross_check"}
)
"""What tells of a run or words the numbers, and is no result by itself."""

Leaf = float | bool | str
"""What a record holds at its ends."""

NEGLIGIBLE = 1e-12
"""Numbers below this are rounding of 0, in any unit used here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One entry that differs.

    Attributes:
        path: where in results.json, entries of lists by their names.
        first, second: the values.
        relative: of numbers the distance by the larger magnitude; 1 for anything else.
    """

    path: str
    first: Leaf
    second: Leaf
    relative: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Two studies compared.

    Attributes:
        compared: how many numbers and outcomes both have.
        differences: those that differ by more than the tolerance, the largest first.
        only_first, only_second: entries that only one of them has.
        tolerance: largest relative difference that counts as none.
    """

    compared: int
    differences: tuple[Difference, ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]
    tolerance: float

    @property
    def same(self) -> bool:
        """Whether nothing differs and neither has what the other has not."""
        return not (self.differences or self.only_first or self.only_second)


def compare_studies(first: str | Path, second: str | Path, *, tolerance: float = 1e-9) -> Comparison:
    """Compare the results of two studies.

    Args:
        first: a study's folder, or its results.json.
        second: another.
        tolerance: largest relative difference that counts as none.

    Raises:
        InvalidInputError: a file is missing or holds no study's results, or the tolerance is out of range.
    """
    if not 0.0 <= tolerance < 1.0:
        raise out_of_range("tolerance", tolerance, "", "0 to 1", "give a relative difference such as 1e-9")
    one, two = (dict(_leaves(_read(path), "")) for path in (first, second))
    shared = [path for path in one if path in two]
    differences = [d for path in shared for d in _difference(path, one[path], two[path]) if d.relative > tolerance]
    return Comparison(
        compared=len(shared),
        differences=tuple(sorted(differences, key=lambda d: (-d.relative, d.path))),
        only_first=tuple(path for path in one if path not in two),
        only_second=tuple(path for path in two if path not in one),
        tolerance=tolerance,
    )


def _read(path: str | Path) -> Mapping[str, Json]:
    place = Path(path)
    record = read_json(place / RESULTS if place.is_dir() else place, "results of a study")
    record.require_schema(SCHEMA)
    if "operating_point" not in record.entries and not record.entries.get("partial"):
        message = f"{record.where} holds no study: there is no operating_point; give a folder that `revline study` wrote"
        raise InvalidInputError(message, path=str(place))
    return record.entries


def _leaves(value: Json, path: str) -> Iterator[tuple[str, Leaf]]:
    """Numbers and outcomes of a record with their places."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            if key not in LEFT_OUT:
                yield from _leaves(entry, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        labels = [_label(entry, position) for position, entry in enumerate(value)]
        for position, entry in enumerate(value):
            rest = {key: part for key, part in entry.items() if key not in NAMING} if isinstance(entry, Mapping) else entry
            earlier = labels[:position].count(labels[position])  # entries of one name are told apart, so that none hides another
            yield from _leaves(rest, f"{path}[{labels[position]}{f' #{earlier + 1}' if earlier else ''}]")
    elif isinstance(value, bool | int | float | str):
        yield path, value


def _label(entry: Json, position: int) -> str:
    """What names an entry of a list; its place where nothing does."""
    if not isinstance(entry, Mapping):
        return str(position)
    names = (entry[key] for key in NAMING if key in entry)
    return ", ".join(f"{name:g}" if isinstance(name, float) else str(name) for name in names) or str(position)


def _difference(path: str, first: Leaf, second: Leaf) -> Iterator[Difference]:
    numbers = not any(isinstance(value, bool | str) for value in (first, second))
    if numbers:
        largest = max(abs(float(first)), abs(float(second)))
        distance = abs(float(first) - float(second))
        relative = distance / largest if largest > NEGLIGIBLE and not math.isclose(distance, 0.0, abs_tol=NEGLIGIBLE) else 0.0
    else:
        relative = 0.0 if type(first) is type(second) and first == second else 1.0
    yield Difference(path=path, first=first, second=second, relative=relative)
