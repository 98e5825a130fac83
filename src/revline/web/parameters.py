"""The parameters of an engine as the page lists them, and engines with some of them changed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from revline.engine.catalogue import build_engine, engine_names
from revline.engine.lee1995 import EngineParameters, check_parameters, lee1995_parameters
from revline.errors import InvalidInputError, suggestion
from revline.system import DelaySystem
from revline.units import meaning_of, unit_of

REACH: Final = 4.0
"""A page's slider goes from the built-in value over this number to the built-in value times it."""


THESIS: Final = (
    ("C1", 2.1536076099454657, 16.854635639338913, 0.0, "pole placement on the first-order model"),
    ("C2", 20.0, 98.37739731905917, 0.4, "tuned on the second-order model without delay"),
    ("C2d", 1.2, 2.167543650817529, 0.1, "tuned on the second-order model with delay"),
)
"""Controllers of Lee (1995), chapter 5, as the study finds them at 25 deg: name, kp, ki, kd, and what they are."""


def list_parameters(name: str) -> Mapping[str, Any]:
    """List what can be set about a built-in engine: parameters with the range that a page offers, and controllers to begin with.

    Args:
        name: of the engine.

    Raises:
        InvalidInputError: there is none of that name.
    """
    rows = []
    parameters = lee1995_parameters(build_engine(name))
    for section, part in zip(parameters._fields, parameters, strict=True):
        for key, value in zip(part._fields, part, strict=True):
            meaning = meaning_of(type(part), key)
            low, high = sorted((value / REACH, value * REACH))
            if key == "saturation_angle":
                high = 90.0
            rows.append(
                {
                    "key": f"{section}.{key}",
                    "section": section,
                    "name": key.replace("_", " "),
                    "unit": unit_of(type(part), key),
                    "meaning": meaning.text,
                    "source": meaning.source,
                    "value": value,
                    "low": low,
                    "high": high,
                }
            )
    controllers = [{"name": name, "kp": kp, "ki": ki, "kd": kd, "what": what} for name, kp, ki, kd, what in THESIS]
    return {"engine": name, "engines": list(engine_names()), "parameters": rows, "controllers": controllers}


def changed_engine(name: str, changed: Sequence[tuple[str, float]]) -> DelaySystem:
    """Build an engine with some parameters changed.

    Args:
        name: of the built-in engine.
        changed: parameters by "section.name", with their values.

    Raises:
        InvalidInputError: there is no such engine or parameter, or a value is out of range.
    """
    engine = build_engine(name)
    if not changed:
        return engine
    parameters = lee1995_parameters(engine)
    known = [f"{section}.{key}" for section, part in zip(parameters._fields, parameters, strict=True) for key in part._fields]
    for key, value in changed:
        if key not in known:
            message = f"the engine {name} has no parameter {key!r}{suggestion(key, known)}; leave it out"
            raise InvalidInputError(message, control=f"parameters.{key}")
        section, _, field = key.partition(".")
        parameters = parameters._replace(**{section: getattr(parameters, section)._replace(**{field: value})})
    _check(parameters)
    return replace(engine.with_parameters(parameters), name=f"{name}, changed")


def _check(parameters: EngineParameters) -> None:
    try:
        check_parameters(parameters)
    except InvalidInputError as error:
        raise InvalidInputError(str(error), **{**error.details, "control": f"parameters.{error.details['quantity']}"}) from error
