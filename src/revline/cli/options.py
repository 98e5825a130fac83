"""Arguments and options that several commands share, each defined once with its unit and its help."""

from pathlib import Path
from typing import Annotated

import typer


def complete_engine(incomplete: str) -> list[str]:
    """Engines that begin so, for the shell's completion."""
    from revline.engine.catalogue import engine_names

    return [name for name in engine_names() if name.startswith(incomplete)]


EngineOption = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="NAME|FILE",
        help="Engine: a name that `revline engines` lists, an engine file (.toml), or a vector of 24 numbers (.txt, .vec, .dat).",
        autocompletion=complete_engine,
    ),
]
ThrottleOption = Annotated[float, typer.Option("--throttle", metavar="DEG", help="Throttle angle of the operating point [deg], 0 to 90.")]
LoadOption = Annotated[float, typer.Option("--load", metavar="N_M", help="Load torque [N m].")]
TimeStepOption = Annotated[float, typer.Option("--time-step", metavar="S", help="Step of the simulation [s], shorter than every lag.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on stdout, and nothing else there.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no warnings on stderr.")]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="File to write; one of that name is replaced. `-` writes to stdout.", show_default=False),
]

DEFAULT_ENGINE = "lee1995"
