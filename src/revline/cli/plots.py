"""Figures that commands write: --plot FILE.png or FILE.svg."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".png", ".svg")

PlotOption = Annotated[Path | None, typer.Option("--plot", metavar="FILE.png|svg", help="Figure to write.")]


def check_plot(plot: Path | None) -> Path | None:
    """Give a figure's file back; one of another form is refused.

    Raises:
        InvalidInputError: the file's ending is neither .png nor .svg.
    """
    if plot is not None and plot.suffix not in ENDINGS:
        message = f"--plot {plot}: a figure is written as {' or '.join(ENDINGS)}; give the file one of these endings"
        raise InvalidInputError(message)
    return plot


def write_plot(plot: Path, figure: "Figure", command: str) -> None:
    """Write a figure whole or not at all, in the form that the file's ending says."""
    from revline.report.figure_files import render_figure
    from revline.report.files import write_whole

    png, svg = render_figure(figure, f"revline {command}")
    write_whole(plot, png if plot.suffix == ".png" else svg, "figure")
