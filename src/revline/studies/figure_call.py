"""A figure of the study that is still to be drawn: the function that draws it, and its data."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class FigureCall(NamedTuple):
    """A function that draws, and its arguments."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    options: Mapping[str, Any]


def to_draw(function: Callable[..., Any], *arguments: Any, **options: Any) -> FigureCall:
    """Put a function that draws and its arguments together."""
    return FigureCall(function, arguments, options)
