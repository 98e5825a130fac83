"""The study's other models with delay: fitted together with it, and with the engine's own lag, fixed and varying with the speed.

Lee (1995) reads the delay from the phase that G2 leaves over and recommends one that varies with the engine. Here the delay is fitted
together with the poles, taken from the engine, and let vary with the model's own speed, and the errors in time are set side by side.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from revline import signals
from revline.dde.simulate import Start, simulate
from revline.design.fitting.fit import DelayRule, fit_transfer_function
from revline.design.plants.varying_lag import varying_lag_model
from revline.errors import RevlineError
from revline.lti.transfer_function import TransferFunction
from revline.report.blocks import Align, Block, Column, Paragraph, TableBlock
from revline.studies.loop_steps import sine_answer, step_answer
from revline.studies.results import ErrorRecord, ErrorsResult, Floats, ModelsResult, PointResult
from revline.studies.words import listed

NAMES = MappingProxyType({"g2d_free": "G2d, delay fitted", "g2_fixed_lag": "G2, the engine's lag", "g2_varying_lag": "G2, lag over speed"})
"""Models by their names in results.json, as the report's table names them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DelayModels:
    """Two poles with other delays than that of the phase line, and their errors in time.

    Attributes:
        free: with the delay fitted together with the poles; one, or none where it cannot be fitted.
        fixed: with the engine's own lag at the operating point, the poles fitted; one or none.
        angle: crank angle of that lag in rad: lag times speed.
        records: errors after the same inputs as those of G1, G2 and G2d.
        missing: models that are not there, and why.
    """

    free: tuple[TransferFunction, ...]
    fixed: tuple[TransferFunction, ...]
    angle: float
    records: tuple[ErrorRecord, ...]
    missing: tuple[str, ...]


def find_delay_models(point: PointResult, models: ModelsResult, errors: ErrorsResult, amplitude: float) -> DelayModels:
    """Fit the models, and compare them with the engine after the inputs that G1, G2 and G2d are compared after.

    Args:
        point: the operating point.
        models: with the response that is fitted.
        errors: of G1, G2 and G2d, with the engine's own answers.
        amplitude: of the inputs, in deg.
    """
    lag = point.trim.lag("charge")
    angle = lag * point.trim.output("engine_speed")
    free, fixed = _fitted(models, DelayRule.FREE), _fitted(models, lag)
    missing = [f"{NAMES[name]}: {found}" for name, found in (("g2d_free", free), ("g2_fixed_lag", fixed)) if isinstance(found, str)]
    records = []
    for record in errors.records:
        answers = {
            name: _linear(found, record, amplitude)
            for name, found in (("g2d_free", free), ("g2_fixed_lag", fixed))
            if not isinstance(found, str)
        }
        if not isinstance(fixed, str):
            try:
                answers["g2_varying_lag"] = _varying(fixed, point, angle, record, amplitude)
            except RevlineError as error:
                missing.append(f"{NAMES['g2_varying_lag']}: {error}")
        if answers:
            records.append(_record(record, answers))
    return DelayModels(
        free=() if isinstance(free, str) else (free,),
        fixed=() if isinstance(fixed, str) else (fixed,),
        angle=angle,
        records=tuple(records),
        missing=tuple(dict.fromkeys(missing)),
    )


def _fitted(models: ModelsResult, delay: DelayRule | float) -> TransferFunction | str:
    """Two poles and no zero with a delay; where that cannot be fitted, why."""
    try:
        return fit_transfer_function(models.response, zeros=0, poles=2, delay=delay).model
    except RevlineError as error:
        return str(error)


def _linear(model: TransferFunction, record: ErrorRecord, amplitude: float) -> Floats:
    sine = sine_answer(model, record.frequency, record.times) if record.frequency else step_answer(model, record.times - record.start)
    return amplitude * sine


def _varying(model: TransferFunction, point: PointResult, angle: float, record: ErrorRecord, amplitude: float) -> Floats:
    base, speed = point.trim.input("throttle"), point.trim.output("engine_speed")
    system = varying_lag_model(model, angle=angle, base_input=base, base_output=speed)
    signal = signals.sine(amplitude, record.frequency) if record.frequency else signals.step(amplitude, start=record.start)
    start = Start(states=np.zeros(len(system.states)), inputs=np.array([base]))
    run = simulate(system, start, {"input": signal}, until=float(record.times[-1]), step=float(record.times[1] - record.times[0]))
    return np.interp(record.times, run.times, run.output("output") - speed)


def _record(record: ErrorRecord, answers: dict[str, Floats]) -> ErrorRecord:
    return ErrorRecord(
        kind=record.kind,
        frequency=record.frequency,
        start=record.start,
        times=record.times,
        speed=record.speed,
        models=tuple(answers),
        answers=np.array(list(answers.values())),
        judged_from=record.judged_from,
    )


def delay_fields(found: DelayModels) -> dict[str, Any]:
    """The field `delay_models` of results.json."""
    record: dict[str, Any] = {"lag_angle_rad": found.angle, "missing": list(found.missing)}
    for name, models in (("g2d_free", found.free), ("g2_fixed_lag", found.fixed)):
        for model in models:
            record[name] = {"numerator": list(model.numerator), "denominator": list(model.denominator), "delay_s": model.delay}
    return record


def delay_blocks(found: DelayModels, errors: ErrorsResult) -> Iterator[Block]:
    """Paragraph and table of the report."""
    if not found.records:
        return
    delays = [
        f"{1e3 * model.delay:.2f} ms {text}"
        for models, text in ((found.free, "fitted with the poles"), (found.fixed, "as the engine has it"))
        for model in models
    ]
    text = (
        "G2d's poles were fitted without its delay, and stand for a part of it. Fitted together, with a delay of "
        f"{listed(delays)}, they need not."
    )
    if any("g2_varying_lag" in record.models for record in found.records):
        text += (
            f" In the last model the delay is an angle of {found.angle:.3g} rad over the model's own speed: "
            "it is shorter where the speed is higher. Its mean moves under a sinusoid, as the engine's does, but not alike."
        )
    yield Paragraph(text)
    columns = (
        Column(heading="Throttle"),
        Column(heading="Model"),
        Column(heading="Largest", unit="rad/s", align=Align.RIGHT),
        Column(heading="Root mean square", unit="rad/s", align=Align.RIGHT),
        Column(heading="Half of the range", unit="rad/s", align=Align.RIGHT),
    )
    rows = []
    for plain, record in zip(errors.records, found.records, strict=True):
        what = "step" if record.kind == "step" else f"sinusoid, {record.frequency:g} rad/s"
        rows += [(what, title, *_cells(whose, name)) for whose, name, title in _compared(plain, record)]
    yield TableBlock(caption="Errors of the speed with other delays", columns=columns, rows=tuple(rows), notes=found.missing)


def _compared(plain: ErrorRecord, record: ErrorRecord) -> Iterator[tuple[ErrorRecord, str, str]]:
    yield plain, "g2d", "G2d, delay by phase"
    yield from ((record, name, NAMES[name]) for name in record.models)


def _cells(record: ErrorRecord, name: str) -> tuple[str, str, str]:
    return f"{record.largest(name):.2f}", f"{record.rms(name):.2f}", f"{record.swing(name):.2f}"
