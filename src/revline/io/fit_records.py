"""Fitted models as records: a model file's content with errors, uncertainty and verdict beside."""

from collections.abc import Mapping

from revline.design.fitting.determination import find_undetermined
from revline.design.fitting.fit import ModelFit
from revline.design.fitting.model_choice import Verdict
from revline.io.model_files import model_record


def fit_record(fit: ModelFit, verdict: Verdict, *, name: str, provenance: Mapping[str, float | str]) -> Mapping[str, object]:
    """Give a fitted model as the content of a model file, which `revline.io.model_files.read_model` reads.

    Args:
        fit: the model with its data.
        verdict: on the model.
        name: of the model.
        provenance: what made it, from what.
    """
    origin = {
        "delay_rule": fit.delay_rule.value,
        "weight": fit.weight.value,
        "data_fingerprint": fit.data_fingerprint,
        "frequencies": float(fit.data.omega.size),
        "lowest_frequency_rad_s": float(fit.data.omega[0]),
        "highest_frequency_rad_s": float(fit.data.omega[-1]),
    }
    return {
        **model_record(fit.model, name=name, provenance={**provenance, **origin}),
        "numerator_deviation": fit.numerator_deviation,
        "denominator_deviation": fit.denominator_deviation,
        "delay_deviation_s": fit.delay_deviation,
        "residual_sum": fit.residual_sum,
        "condition": fit.optimum.condition,
        "gradient": fit.optimum.gradient,
        "starts": len(fit.optimum.starts),
        "starts_agreeing": fit.optimum.starts_agreeing,
        "undetermined": find_undetermined(fit),
        "max_magnitude_error_db": fit.max_magnitude_error_db,
        "max_phase_error_deg": fit.max_phase_error_deg,
        "accepted": verdict.accepted,
        "verdict": verdict.text,
        "objections": verdict.objections,
    }
