"""One look for all figures: colours, fonts, sizes, and the one place where matplotlib's settings are changed, for a moment.

Colours: Okabe and Ito (2008), Color Universal Design, told apart with every common form of colour blindness; each comes with its own
dashes, so that prints without colour can be read too.
"""

import functools
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.typing import RcKeyType

P = ParamSpec("P")

WIDTH: Final = 4.8
WIDE: Final = 6.4
HEIGHT: Final = 3.6
TALL: Final = 4.4
DPI: Final = 200

BLUE: Final = "#0072B2"
VERMILION: Final = "#D55E00"
GREEN: Final = "#009E73"
PURPLE: Final = "#CC79A7"
ORANGE: Final = "#E69F00"
SKY: Final = "#56B4E9"
BLACK: Final = "#1A1A1A"
GREY: Final = "#6E6E6E"
PALE: Final = "#D4D4D4"

SETTINGS: Final["MappingProxyType[RcKeyType, object]"] = MappingProxyType(
    {
        "font.family": ("DejaVu Sans",),
        "font.size": 9.0,
        "axes.labelsize": 9.0,
        "axes.linewidth": 0.8,
        "axes.edgecolor": GREY,
        "axes.labelcolor": BLACK,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.xmargin": 0.02,
        "axes.ymargin": 0.06,
        "axes.formatter.useoffset": False,
        "axes.formatter.limits": (-4, 5),
        "grid.color": "#DDDDDD",
        "grid.linewidth": 0.5,
        "xtick.color": GREY,
        "ytick.color": GREY,
        "xtick.labelcolor": BLACK,
        "ytick.labelcolor": BLACK,
        "xtick.direction": "out",
        "ytick.direction": "out",
        "xtick.major.width": 0.8,
        "ytick.major.width": 0.8,
        "lines.linewidth": 1.5,
        "lines.markersize": 4.5,
        "lines.solid_capstyle": "round",
        "legend.fontsize": 8.5,
        "legend.frameon": False,
        "legend.handlelength": 2.4,
        "legend.columnspacing": 1.6,
        "legend.borderpad": 0.0,
        "legend.borderaxespad": 0.7,
        "figure.constrained_layout.h_pad": 0.06,
        "figure.constrained_layout.w_pad": 0.06,
        "figure.dpi": DPI,
        "savefig.dpi": "figure",
        "svg.fonttype": "path",
        "svg.hashsalt": "revline",
    }
)
"""What differs from matplotlib's own defaults."""

_ONE_AT_A_TIME = threading.RLock()  # matplotlib's settings belong to the process: two threads must not change them at once


class Look(NamedTuple):
    """How a curve is drawn.

    Attributes:
        colour: as matplotlib knows it.
        dash: "-", "--", "-." or ":"; empty for points without a line.
        marker: "o", "s", "x" and so on; empty for a line without points.
        filled: whether markers are filled.
        width: of the line, in points.
    """

    colour: str
    dash: str = "-"
    marker: str = ""
    filled: bool = True
    width: float = 1.5


DATA: Final = Look(BLACK, "", "o", filled=False)
"""What was measured or simulated: open circles."""

PUBLISHED: Final = Look(VERMILION, "", "x")
"""What a source prints: crosses, that stay visible in circles."""

PLANT: Final = Look(BLACK, "-")
"""The nonlinear plant in time: a black line."""

MODELS: Final = (
    Look(BLUE, "-"),
    Look(VERMILION, "--", width=1.6),
    Look(GREEN, "-."),
    Look(PURPLE, ":", width=1.9),
    Look(ORANGE, "-"),
    Look(SKY, "--"),
)
"""Curves that are compared, in this order."""


class Quantity(NamedTuple):
    """What an axis shows, and its unit; "1" where it has none."""

    name: str
    unit: str

    @property
    def label(self) -> str:
        """The axis label: the name with the unit in brackets, a dash for none."""
        unit = "\N{EN DASH}" if self.unit == "1" else self.unit
        return f"{self.name} ({unit})"


TIME: Final = Quantity("time", "s")
FREQUENCY: Final = Quantity("frequency", "rad/s")
PHASE: Final = Quantity("phase", "deg")


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the project's look, whatever the user's settings are, and leave these as they were."""
    with _ONE_AT_A_TIME, mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(SETTINGS)
        yield


def drawn(function: Callable[P, Figure]) -> Callable[P, Figure]:
    """Make a function that draws a figure do so in the project's look."""

    @functools.wraps(function)
    def draw(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with styled():
            return function(*args, **kwargs)

    return draw


def new_figure(*, height: float = HEIGHT, width: float = WIDTH) -> Figure:
    """Begin a figure that stays legible when two share the width of a page; one of many panels is `WIDE` and stands alone."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish_layout(figure: Figure) -> None:
    """Lay a figure out once and for all, which costs as much as drawing it: PNG and SVG then come out alike."""
    engine = figure.get_layout_engine()
    if engine is None:
        return
    engine.execute(figure)
    long = [axes.yaxis.label for axes in figure.axes if axes.yaxis.label.get_window_extent().height > axes.get_window_extent().height]
    for label in long:
        label.set_text(label.get_text().replace(" (", "\n("))
    if long:
        engine.execute(figure)
    figure.set_layout_engine("none")


def label_axes(axes: Axes, x: Quantity | None, y: Quantity) -> None:
    """Write quantities and units beside the axes."""
    if x is not None:
        axes.set_xlabel(x.label)
    axes.set_ylabel(y.label)


def add_legend(figure: Figure, *, columns: int = 0) -> None:
    """Explain all labelled curves of a figure above its axes, where they cover nothing; each label once."""
    entries: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        figure.legend(
            entries.values(), entries.keys(), loc="outside upper center", ncols=columns or _columns(tuple(entries), figure.get_figwidth())
        )


def _columns(labels: tuple[str, ...], width: float) -> int:
    """As many columns as fit a width in inches; a character is 0.07 in wide on average, a handle with its gaps 0.56 in."""
    sizes = [len(label) for label in labels]
    for columns in range(len(labels), 1, -1):
        widths = [0.56 + 0.07 * float(part.max()) for part in np.array_split(sizes, columns)]  # as matplotlib fills them
        if sum(widths) < width - 0.2:
            return columns
    return 1


def use_log(axes: Axes, which: str) -> None:
    """Make an axis ("x" or "y") logarithmic, with plain numbers at its powers of ten; between them too where it spans little."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis.set_major_locator(LogLocator(numticks=12))
    axis.set_major_formatter(FuncFormatter(power_text))
    axis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=12))
    axis.set_minor_formatter(FuncFormatter(lambda value, _: _minor_text(value, axis.get_view_interval())))


def power_text(value: float, _position: int | None = None) -> str:
    """Write a power of ten: 0.001 to 10000 in full, beyond that as a power."""
    if 0.9e-4 < value < 1.1e4:
        return f"{value:g}"
    return f"$10^{{{math.log10(value):.0f}}}$" if value > 0.0 else ""


def _minor_text(value: float, view: tuple[float, float]) -> str:
    """Write what lies between powers of ten: twos and fives within a decade and a half, all within half a decade."""
    decades = math.log10(max(view) / min(view))
    digit = round(value / 10.0 ** math.floor(math.log10(value) + 1e-9))
    return f"{value:g}" if decades < 0.5 or (decades < 1.5 and digit in {2, 5}) else ""


def use_degrees(axes: Axes, span: float) -> None:
    """Put ticks of a vertical axis in degrees at round parts of a turn, at most seven over a span."""
    steps = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0, 180.0, 360.0, 720.0, 1800.0)
    fitting = [step for step in steps if span <= 6.5 * step]
    if fitting and span >= 4.0:
        axes.yaxis.set_major_locator(MultipleLocator(fitting[0]))
