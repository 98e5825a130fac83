"""The thesis's three models fitted to a response of the user's own."""

from collections.abc import Mapping
from typing import Any, Final

from revline.design.fitting.fit import ModelFit, add_phase_line
from revline.design.fitting.model_choice import MODEL_STRUCTURES, fit_structure, judge_model
from revline.errors import RevlineError
from revline.io.fit_records import fit_record
from revline.lti.response import FrequencyResponse
from revline.web.plants import MODELS
from revline.web.view.drawing import drawn
from revline.web.view.responses import PROGRAM, curve

PLAIN: Final = ("g1", "g2")
"""Models without delay; g2d is g2 with a line through the phase that is left."""


def fitted_models(response: FrequencyResponse) -> Mapping[str, ModelFit | RevlineError]:
    """Fit the models of Lee (1995), chapter 4; what cannot be fitted is the error.

    Args:
        response: of the speed to the throttle.
    """
    found: dict[str, ModelFit | RevlineError] = {}
    for name in MODELS:
        try:
            if name in PLAIN:
                structure = next(one for one in MODEL_STRUCTURES if one.name == name)
                found[name] = fit_structure(response, structure).fit
            else:
                plain = found["g2"]
                found[name] = plain if isinstance(plain, RevlineError) else add_phase_line(plain)
        except RevlineError as error:
            found[name] = error
    return found


def fit_record_of(name: str, fit: ModelFit) -> Mapping[str, Any]:
    """Give a fitted model as `revline fit --json` does, with its curve and errors at the data's frequencies.

    Args:
        name: of the model.
        fit: the model with its data.
    """
    return {
        **fit_record(fit, judge_model(fit), name=name, provenance={"program": PROGRAM}),
        "curve": curve(fit.model.response(fit.data.omega)),
        "errors": {
            "frequency_rad_s": drawn(fit.data.omega),
            "magnitude_db": drawn(fit.magnitude_error_db),
            "phase_deg": drawn(fit.phase_error_deg),
        },
    }
