"""The built-in engines, as data: a further engine is one more entry."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from revline.engine.lee1995 import GENERIC_EFFICIENCY, LEE_1995, lee1995
from revline.errors import InvalidInputError, suggestion
from revline.system import DelaySystem


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueEntry:
    """An engine that is built in.

    Attributes:
        name: as the command line and study files give it.
        description: one line for people.
        build: makes the engine with its published parameters.
    """

    name: str
    description: str
    build: Callable[[], DelaySystem]


def _lee1995_generic() -> DelaySystem:
    return replace(lee1995(LEE_1995._replace(efficiency=GENERIC_EFFICIENCY)), name="lee1995-generic")


ENGINES = (
    CatalogueEntry(
        name="lee1995",
        description="3.8-litre spark-ignition engine of Lee (1995): manifold pressure and speed, intake and spark delays",
        build=lee1995,
    ),
    CatalogueEntry(
        name="lee1995-generic",
        description="the same with the generic volumetric efficiency, a function of speed alone",
        build=_lee1995_generic,
    ),
)
"""All built-in engines."""


def engine_names() -> tuple[str, ...]:
    """Name the built-in engines, in the catalogue's order."""
    return tuple(entry.name for entry in ENGINES)


def build_engine(name: str) -> DelaySystem:
    """Build a built-in engine.

    Args:
        name: one of `engine_names()`.

    Returns:
        The engine with its published parameters; its `name` is the one given.

    Raises:
        InvalidInputError: there is no such engine; the message lists those there are and the nearest name.
    """
    for entry in ENGINES:
        if entry.name == name:
            return entry.build()
    message = f"there is no built-in engine {name!r}{suggestion(name, engine_names())}; there are {', '.join(engine_names())}"
    raise InvalidInputError(message, name=name)
