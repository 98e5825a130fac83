"""Commands about linear models: fit, tune."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from revline import __version__
from revline.cli.options import JsonOption, OutOption, QuietOption
from revline.cli.shell import Facts, Grid, Shell, show_roots
from revline.errors import InvalidInputError

if TYPE_CHECKING:
    from revline.design.fit import DelayRule, ModelFit

PROGRAM = f"revline {__version__}"
"""What files say of their origin."""

DelayChoice = Literal["none", "phase-line", "free", "fixed"]
WeightChoice = Literal["none", "relative"]
ObjectiveChoice = Literal["setpoint-error", "load-error"]


def rule_names() -> list[str]:
    """Names of the tuning rules, for the shell's completion."""
    from revline.design.rules import TUNING_RULES

    return [rule.name for rule in TUNING_RULES]


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
    from revline.design.fit import Weight, fit_transfer_function
    from revline.design.model_choice import judge_model
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
    shell.warn(*file.notes)
    shell.show(record, Facts(f"Model {title} of {data.name}", _model_facts(found)), verdict.text, text_on=out)


def _delay_of(choice: DelayChoice, value: float | None) -> "DelayRule | float":
    from revline.design.fit import DelayRule

    if (choice == "fixed") != (value is not None):
        message = f"--delay {choice} with {'no --delay-s' if value is None else '--delay-s'}: give --delay fixed and --delay-s together"
        raise InvalidInputError(message)
    return DelayRule(choice) if value is None else value


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


StartOption = Annotated[
    Path | None,
    typer.Option("--start", metavar="CONTROLLER.json", help="Gains that fine tuning begins from; else those of ziegler-nichols."),
]
FreeOption = Annotated[
    str | None, typer.Option("--free", metavar="GAIN,..", help="Gains that fine tuning may move, of kp,ki,kd; ki by default.")
]
LimitOption = Annotated[
    float | None,
    typer.Option("--overshoot-limit", metavar="FRACTION", help="Largest overshoot that fine tuning allows, of the command; else 0.1."),
]
ObjectiveOption = Annotated[
    ObjectiveChoice | None,
    typer.Option(
        "--objective",
        help="What fine tuning minimises: the integral of the absolute error after a step of the command (the default), "
        "or the integrated error after a step of a load, 1/ki.",
    ),
]
HorizonOption = Annotated[
    float | None, typer.Option("--horizon", metavar="S", help="Time over which fine tuning judges a loop [s]; 4 by default.")
]


def tune(
    *,
    model: Annotated[Path | None, typer.Argument(metavar="MODEL.json", help="Model file, for example from `revline fit`.")] = None,
    rule: Annotated[str | None, typer.Option("--rule", help="Name of the rule; --list shows them.", autocompletion=rule_names)] = None,
    natural_frequency: Annotated[
        float | None, typer.Option("--natural-frequency", metavar="RAD_S", help="Natural frequency of the closed loop [rad/s].")
    ] = None,
    damping: Annotated[float | None, typer.Option("--damping", metavar="RATIO", help="Damping ratio of the closed loop.")] = None,
    start: StartOption = None,
    free: FreeOption = None,
    overshoot_limit: LimitOption = None,
    objective: ObjectiveOption = None,
    horizon: HorizonOption = None,
    listed: Annotated[bool, typer.Option("--list", help="List the rules with their options and sources.")] = False,
    out: OutOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Tune a PI or PID controller for a model by a rule; the gains are in deg of throttle per rad/s for an engine's model."""
    from revline.design.rules import tune_by_rule
    from revline.io.controller_files import controller_record, read_controller
    from revline.io.json_files import format_json
    from revline.io.model_files import read_model

    shell = Shell(json=json, quiet=quiet)
    if listed:
        _list_rules(shell)
        return
    if model is None or rule is None:
        message = "give a model file and --rule, for example `revline tune g2.json --rule ziegler-nichols`; --list shows the rules"
        raise InvalidInputError(message)
    shell.prepare(out, "controller file")
    file = read_model(model)
    given = {
        "natural_frequency": natural_frequency,
        "damping": damping,
        "start": read_controller(start).gains if start is not None else None,
        "free": free,
        "overshoot_limit": overshoot_limit,
        "objective": objective,
        "horizon": horizon,
    }
    options = {key: value for key, value in given.items() if value is not None}
    gains = tune_by_rule(rule, file.model, options=options, designed_on=file.name)
    record = controller_record(gains, provenance={"program": PROGRAM, "model": model.name})
    shell.write(out, format_json(record), "controller file")
    rows = [(gain, getattr(gains, gain), unit) for gain, unit in gains.gain_units.items()]
    details = [(key, value, "") for key, value in gains.details.items() if key != "summary"]
    shell.show(
        record, Facts(f"Controller for {file.name} by {gains.rule}", [*rows, *details]), str(gains.details.get("summary", "")), text_on=out
    )


def _list_rules(shell: Shell) -> None:
    from revline.design.rules import TUNING_RULES

    record = {
        "rules": [
            {
                "name": rule.name,
                "summary": rule.summary,
                "source": rule.source,
                "options": [
                    {"name": o.name, "unit": o.unit, "description": o.description} | ({"default": o.default} if o.default else {})
                    for o in rule.options
                ],
            }
            for rule in TUNING_RULES
        ]
    }
    rows = [
        (rule.name, ", ".join(f"--{o.name.replace('_', '-')} [{o.unit}]" for o in rule.options) or "none", rule.summary, rule.source)
        for rule in TUNING_RULES
    ]
    shell.show(record, Grid("", ("rule", "options", "what it does", "source"), rows))
