"""An engine file of the user's own: checked, and what it changes about the built-in engine."""

from collections.abc import Mapping
from typing import Any

from revline.engine.air import ThesisEfficiency
from revline.engine.catalogue import build_engine
from revline.engine.lee1995 import lee1995_parameters
from revline.io.engine_files import parse_engine
from revline.units import unit_of


def read_engine_file(text: str, name: str) -> Mapping[str, Any]:
    """Check an engine file.

    Args:
        text: TOML, as `revline engines NAME` prints it.
        name: what messages call it.

    Returns:
        The engine's name, what of the built-in engine with the same equations it `changes`, and `state`: the keys of a state that show it.

    Raises:
        InvalidInputError: the text is no engine file; with line, key, value and remedy.
    """
    engine = parse_engine(text, place=name, name=name.removesuffix(".toml") or "engine")
    parameters = lee1995_parameters(engine)
    built_in = "lee1995" if isinstance(parameters.efficiency, ThesisEfficiency) else "lee1995-generic"
    usual = lee1995_parameters(build_engine(built_in))
    changes = []
    for section, part, other in zip(parameters._fields, parameters, usual, strict=True):
        changes += [
            {"key": f"{section}.{key}", "unit": unit_of(type(part), key), "value": value, "built_in": before}
            for key, value, before in zip(part._fields, part, other, strict=True)
            if value != before
        ]
    state = {"engine": built_in, "parameters": {entry["key"]: entry["value"] for entry in changes}}
    return {"kind": "engine", "name": engine.name, "changes": changes, "state": state}
