"""The command fit: a linear model from a frequency response."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from revline import __version__
from revline.cli.options import JsonOption, OutOption, QuietOption
from revline.cli.shell import Facts, Shell, show_roots
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.fitting.fit import DelayRule, ModelFit

PROGRAM = f"revline {__version__}"
"""What files say of their origin."""

DelayChoice = Literal["none", "phase-line", "free", "fixed"]
WeightChoice = Literal["none", "relative"]


def fit(
    *,
    data: Annotated[
        Path, typer.Argument(metavar="FILE.csv", help="Frequency response: columns of frequency, magnitude or amplitude, phase.")
    ],
    zeros: Annotated[int, typer.Option("--zeros", min=0, help="Degree of the numerator.")],
    poles: Annotated[int, typer.Option("--poles", min=0, help="Degree of the denominator.")],
    delay: Annotated[
        DelayChoice, typer.Option("--delay", help="No delay; from a line through the phase left over; fitted with the rest; or known.")
    ] = "none",
    delay_s: Annotated[
        float | None, typer.Option("--delay-s", metavar="S", help="The known delay [s], for --delay fixed, for example angle / speed.")
    ] = None,
    weight: Annotated[WeightChoice, typer.Option("--weight", help="All frequencies alike, or relative to the magnitude there.")] = "none",
    columns: Annotated[
        str | None,
        typer.Option(
            "--columns",
            metavar="QUANTITY=COLUMN,..",
            help="Which column holds which quantity, where the header's names are others, for example "
            "frequency_hz=f,magnitude_db=gain,phase_deg=phase.",
        ),
    ] = None,
    amplitude: Annotated[
        float | None,
        typer.Option(
            "--amplitude", metavar="DEG", help="Amplitude of the input [deg], by which amplitudes are divided; else the file's, else 5."
        ),
    ] = None,
    name: Annotated[str | None, typer.Option("--name", help="Name of the model; else that of the file written, else of the data.")] = None,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Fit a transfer function, with or without delay, to a frequency response by output error, and judge it.

    Coefficients stand in ascending powers of s; the denominator's first is 1.
    """
    from revline.design.fitting.fit import Weight, fit_transfer_function
    from revline.design.fitting.model_choice import judge_model
    from revline.io.fit_records import fit_record
    from revline.io.json_files import format_json
    from revline.io.number_lists import parse_pairs
    from revline.io.response_files import read_response

    shell = Shell(json=json, quiet=quiet)
    shell.prepare(out, "model file")
    file = read_response(data, columns=parse_pairs(columns, "--columns") if columns is not None else None, amplitude=amplitude)
    found = fit_transfer_function(file.response, zeros=zeros, poles=poles, delay=_delay_of(delay, delay_s), weight=Weight(weight))
    verdict = judge_model(found)
    title = name or (out.stem if out is not None and str(out) != "-" else data.stem)
    record = fit_record(found, verdict, name=title, provenance={"program": PROGRAM, "data": data.name})
    shell.write(out, format_json(record), "model file")
    shell.warn(*file.notes, *_doubts(found))
    shell.show(record, Facts(f"Model {title} of {data.name}", _model_facts(found)), verdict.text, text_on=out)


def _delay_of(choice: DelayChoice, value: float | None) -> "DelayRule | float":
    from revline.design.fitting.fit import DelayRule

    if (choice == "fixed") != (value is not None):
        message = f"--delay {choice} with {'no --delay-s' if value is None else '--delay-s'}: give --delay fixed and --delay-s together"
        raise InvalidInputError(message)
    return DelayRule(choice) if value is None else value


def _doubts(found: "ModelFit") -> list[str]:
    from revline.design.fitting.determination import find_undetermined

    return [f"the data do not determine the model: {reason}" for reason in find_undetermined(found)]


def _model_facts(found: "ModelFit") -> list[tuple[str, float | str, str]]:
    """What a fit says, for people."""
    model = found.model
    return [
        ("numerator", ", ".join(f"{c:.6g}" for c in model.numerator), "ascending powers of s"),
        ("denominator", ", ".join(f"{c:.6g}" for c in model.denominator), "ascending powers of s"),
        ("delay", model.delay, "s"),
        ("gain at rest", model.numerator[0], f"{model.output_unit} per {model.input_unit}"),
        ("poles", show_roots(model.poles), "rad/s"),
        ("zeros", show_roots(model.zeros), "rad/s"),
        ("largest magnitude error", found.max_magnitude_error_db, "dB"),
        ("largest phase error", found.max_phase_error_deg, "deg"),
    ]
