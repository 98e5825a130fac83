"""Engine files in TOML: every parameter by part, with unit, meaning and source; read with errors that name the line.

    schema = "revline.engine/1"

    [engine]
    name = "my engine"
    model = "lee1995"
    efficiency_model = "thesis"

    [throttle]
    max_flow = 0.1843 # kg/s; largest air flow through the throttle; ...

Numbers are written so that they read back to the last bit. All parameters stand in the file; only `engine.name` may be left
out, which is the file's own name then.
"""

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from revline.engine.catalogue import build_engine, engine_names
from revline.engine.lee1995 import GENERIC_EFFICIENCY, LEE_1995, EfficiencyModel, EngineParameters, lee1995, lee1995_parameters
from revline.errors import InvalidInputError, suggestion
from revline.io.engine_vectors import VECTOR_SUFFIXES, read_engine_vector
from revline.io.texts import read_text, write_text
from revline.io.toml_files import TomlFile, parse_toml
from revline.system import DelaySystem
from revline.units import meaning_of, unit_of

SCHEMA = "revline.engine/1"
"""Identifies the file format and its version."""

MODELS = ("lee1995",)
"""Engine models whose parameters a file can hold."""

ENGINE_KEYS = ("name", "model", "efficiency_model")
REMEDY = "`revline engines lee1995` prints a complete file"
TEMPLATES = MappingProxyType(
    {EfficiencyModel.THESIS: LEE_1995, EfficiencyModel.GENERIC: LEE_1995._replace(efficiency=GENERIC_EFFICIENCY)},
)
"""The parts that a file must give for each relation of the volumetric efficiency."""


def load_engine(name_or_path: str | Path) -> DelaySystem:
    """Find an engine by built-in name, or read it from a file.

    Args:
        name_or_path: name of a built-in engine; or path to an engine file (.toml) or to a vector of 24 numbers
            (.txt, .vec, .dat).

    Returns:
        The engine.

    Raises:
        InvalidInputError: it is neither; or the file is wrong, and the message names the line and the remedy.
    """
    given = str(name_or_path)
    if given in engine_names():
        return build_engine(given)
    path = Path(name_or_path)
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return read_engine(path)
    if suffix in VECTOR_SUFFIXES:
        return read_engine_vector(path)
    message = (
        f"there is no engine {given!r}{suggestion(given, engine_names())}; give a built-in engine ({', '.join(engine_names())}), "
        f"an engine file ending in .toml, or a vector of 24 numbers ending in {', '.join(VECTOR_SUFFIXES)}"
    )
    raise InvalidInputError(message, name=given)


def read_engine(path: Path) -> DelaySystem:
    """Read an engine file.

    Args:
        path: TOML file of the schema "revline.engine/1".

    Returns:
        The engine; its name is the file's `engine.name`, else the file's own name.

    Raises:
        InvalidInputError: the file cannot be read, is no TOML, is of another schema, or a key is missing, unknown, of a
            wrong type or out of range. The message names file, line, key, value and remedy.
    """
    return parse_engine(read_text(path, "engine file"), place=f"engine file {path}", name=path.stem)


def parse_engine(text: str, *, place: str = "engine file", name: str = "lee1995") -> DelaySystem:
    """Read an engine from the text of an engine file.

    Args:
        text: TOML of the schema "revline.engine/1".
        place: where the text comes from, for messages.
        name: the engine's name where the text gives none.

    Raises:
        InvalidInputError: as for `read_engine`, but for the file itself.
    """
    file = parse_toml(text, place=place, schema=SCHEMA, remedy=REMEDY)
    file.refuse_unknown("engine", ENGINE_KEYS)
    file.choice("engine", "model", MODELS)
    template = TEMPLATES[EfficiencyModel(file.choice("engine", "efficiency_model", tuple(model.value for model in EfficiencyModel)))]
    file.refuse_unknown("", ("schema", "engine", *template._fields))
    parameters = _read_parameters(file, template)
    try:
        engine = lee1995(parameters)
    except InvalidInputError as error:
        section, _, key = str(error.details["quantity"]).partition(".")
        raise file.error(section, key, str(error)) from error
    return replace(engine, name=file.line_of_text("engine", "name") if "name" in file.table("engine") else name)


def format_engine(engine: DelaySystem) -> str:
    """Write an engine as the text of an engine file.

    Args:
        engine: one that `lee1995` built, with any parameters.

    Raises:
        InvalidInputError: the engine has equations or signals of its own, which a file cannot hold.
    """
    parameters = lee1995_parameters(engine)
    model = next(model for model, template in TEMPLATES.items() if type(template.efficiency) is type(parameters.efficiency))
    choices = " or ".join(f'"{choice.value}"' for choice in EfficiencyModel)
    lines = [
        f'schema = "{SCHEMA}"',
        "",
        "[engine]",
        f"name = {_quote(engine.name)}",
        f'model = "{MODELS[0]}"',
        f'efficiency_model = "{model.value}" # {choices}: relation of the volumetric efficiency, with its own coefficients below',
    ]
    for section, part in zip(parameters._fields, parameters, strict=True):
        lines += ["", f"[{section}]"]
        for key, value in zip(part._fields, part, strict=True):
            meaning = meaning_of(type(part), key)
            lines.append(f"{key} = {value!r} # {unit_of(type(part), key)}; {meaning.text}; {meaning.source}")
    return "\n".join(lines) + "\n"


def write_engine(engine: DelaySystem, path: Path) -> None:
    """Write an engine file; a file of that name is replaced.

    Args:
        engine: one that `lee1995` built, with any parameters.
        path: file to write, ending in .toml for `load_engine` to know it.

    Raises:
        InvalidInputError: the engine has equations or signals of its own, or the file cannot be written.
    """
    write_text(path, format_engine(engine), "engine file")


def _read_parameters(file: TomlFile, template: EngineParameters) -> EngineParameters:
    parts = []
    for section, part in zip(template._fields, template, strict=True):
        file.refuse_unknown(section, part._fields)
        numbers = (file.number(section, key, unit_of(type(part), key)) for key in part._fields)
        parts.append(type(part)._make(numbers))
    return EngineParameters._make(parts)


def _quote(name: str) -> str:
    if not name.strip() or not name.isprintable():
        message = f"the engine's name {name!r} is no printable text of one line; give it another with dataclasses.replace(engine, name=...)"
        raise InvalidInputError(message)
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
