"""The vector of 24 numbers in which Lee (1995) keeps an engine's parameters, read from and written to plain text.

Constants outside the vector (ambient pressure, gas constant, exponent of the pressure ratio) keep their published values.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

from revline.engine.air import ThesisEfficiency
from revline.engine.lee1995 import LEE_1995, EngineParameters, lee1995, lee1995_parameters
from revline.errors import InvalidInputError
from revline.io.texts import read_text, write_text
from revline.system import DelaySystem
from revline.units import meaning_of, unit_of

VECTOR_SUFFIXES = (".txt", ".vec", ".dat")
"""Endings by which a file is taken for a vector."""

RESERVE = ("efficiency", "reserve")
"""The seventh efficiency coefficient, which no relation uses: always 0."""

VECTOR = (
    ("manifold", "volume"),
    ("manifold", "temperature"),
    ("throttle", "saturation_angle"),
    ("throttle", "angle_slope"),
    ("throttle", "angle_offset"),
    ("throttle", "max_flow"),
    ("efficiency", "mass_squared_speed"),
    ("efficiency", "mass_squared"),
    ("efficiency", "mass_speed"),
    ("efficiency", "mass"),
    ("efficiency", "speed"),
    ("efficiency", "constant"),
    RESERVE,
    ("cylinders", "pumping"),
    ("mixture", "angle_per_ratio"),
    ("mixture", "best_ratio"),
    ("spark", "best_torque_angle"),
    ("spark", "exponent"),
    ("delays", "intake_to_torque"),
    ("delays", "spark_to_torque"),
    ("combustion", "torque_constant"),
    ("friction", "constant"),
    ("friction", "viscous"),
    ("rotation", "inertia"),
)
"""What each number is, as part and parameter. Source: Lee (1995), the parameter file of its program."""

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EngineVector:
    """An engine as the text of a vector file, and what the vector could not hold.

    Attributes:
        text: 24 numbers, one per line, each with a comment.
        numbers: the same.
        notes: one sentence per parameter that is outside the vector and differs from what reading it back gives.
    """

    text: str
    numbers: tuple[float, ...]
    notes: tuple[str, ...]


def read_engine_vector(path: Path) -> DelaySystem:
    """Read an engine from a vector of 24 numbers.

    Args:
        path: text file; numbers stand apart by blanks, commas or new lines; a comment runs from # or % to the line's end.

    Returns:
        The engine, named after the file.

    Raises:
        InvalidInputError: the file cannot be read, holds no 24 numbers, a nonzero reserve, or a parameter out of range.
    """
    return parse_engine_vector(read_text(path, "engine vector"), place=f"engine vector {path}", name=path.stem)


def parse_engine_vector(text: str, *, place: str = "engine vector", name: str = "lee1995") -> DelaySystem:
    """Read an engine from the text of a vector file.

    Args:
        text: as `read_engine_vector` describes.
        place: where the text comes from, for messages.
        name: the engine's name.

    Raises:
        InvalidInputError: as for `read_engine_vector`, but for the file itself.
    """
    found = _numbers(text, place)
    if len(found) != len(VECTOR):
        message = f"{place} holds {len(found)} numbers where the vector has {len(VECTOR)}, from manifold volume to inertia; complete it"
        raise InvalidInputError(message, found=len(found))
    values = dict(zip(VECTOR, (value for _, value in found), strict=True))
    lines = dict(zip(VECTOR, (line for line, _ in found), strict=True))
    if values[RESERVE] != 0.0:
        message = f"{place}, line {lines[RESERVE]}: number 13, the reserve, is {values[RESERVE]:g}; nothing uses it, so give 0"
        raise InvalidInputError(message, value=values[RESERVE])
    parts = (
        part._replace(**{key: values[section, key] for key in part._fields if (section, key) in values})
        for section, part in zip(LEE_1995._fields, LEE_1995, strict=True)
    )
    try:
        engine = lee1995(EngineParameters._make(parts))
    except InvalidInputError as error:
        section, _, key = str(error.details["quantity"]).partition(".")
        message = f"{place}, line {lines[section, key]}: number {VECTOR.index((section, key)) + 1}: {error}"
        raise InvalidInputError(message, **error.details) from error
    return replace(engine, name=name)


def format_engine_vector(engine: DelaySystem) -> EngineVector:
    """Write an engine as the text of a vector file.

    Args:
        engine: one that `lee1995` built with the thesis's volumetric efficiency.

    Returns:
        The text, and a note for each parameter that it cannot hold: show them to the user.

    Raises:
        InvalidInputError: the engine has the generic efficiency, or equations or signals of its own.
    """
    parameters = lee1995_parameters(engine)
    if not isinstance(parameters.efficiency, ThesisEfficiency):
        message = f"engine {engine.name}: the vector of 24 numbers cannot hold the generic efficiency; write an engine file (.toml)"
        raise InvalidInputError(message)
    lines = [f"# The {len(VECTOR)} parameters of an engine, in the order of Lee (1995)."]
    numbers = tuple(0.0 if entry == RESERVE else getattr(getattr(parameters, entry[0]), entry[1]) for entry in VECTOR)
    for position, ((section, key), number) in enumerate(zip(VECTOR, numbers, strict=True), start=1):
        part = type(getattr(parameters, section))
        what = "reserve, always 0" if (section, key) == RESERVE else f"{section}.{key}, {unit_of(part, key)}; {meaning_of(part, key).text}"
        lines.append(f"{number!r} # {position}: {what}")
    return EngineVector(text="\n".join(lines) + "\n", numbers=numbers, notes=_lost(parameters))


def write_engine_vector(engine: DelaySystem, path: Path) -> EngineVector:
    """Write a vector file; a file of that name is replaced.

    Args:
        engine: one that `lee1995` built with the thesis's volumetric efficiency.
        path: file to write, ending in .txt, .vec or .dat for `load_engine` to know it.

    Returns:
        What was written, with its notes: show them to the user.

    Raises:
        InvalidInputError: as for `format_engine_vector`, or the file cannot be written.
    """
    vector = format_engine_vector(engine)
    write_text(path, vector.text, "engine vector")
    return vector


def _numbers(text: str, place: str) -> list[tuple[int, float]]:
    """Read all numbers with their lines."""
    found = []
    for line, content in enumerate(text.split("\n"), start=1):
        bare = re.split("[#%]", content, maxsplit=1)[0].strip().removesuffix(",")
        if not bare.strip():
            continue
        for word in re.split(r"\s*,\s*|\s+", bare.strip()):
            if not NUMBER.fullmatch(word):
                message = f"{place}, line {line}: {word!r} is no number; give {len(VECTOR)} numbers apart by blanks, commas or new lines"
                raise InvalidInputError(message, line=line)
            found.append((line, float(word)))
    return found


def _lost(parameters: EngineParameters) -> tuple[str, ...]:
    """Name what is outside the vector and differs from the published value, which reading gives."""
    notes = []
    for section, part, published in zip(parameters._fields, parameters, LEE_1995, strict=True):
        for key, value, default in zip(part._fields, part, published, strict=True):
            if (section, key) not in VECTOR and value != default:
                unit = unit_of(type(part), key)
                notes.append(f"{section}.{key} = {value!r} {unit} is not in the vector: reading it back gives {default!r} {unit}")
    return tuple(notes)
