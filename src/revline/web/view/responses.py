"""Frequency responses, fitted models and their errors, for a view."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from revline import __version__
from revline.analysis.balance_attempts import PartialBalance
from revline.analysis.cycle_readings import ReadingMethod
from revline.analysis.periodic import Excitation
from revline.analysis.sinestream import PartialSinestream, attempt_sinestream
from revline.design.fitting.model_choice import NamedFit, judge_model
from revline.errors import InvalidInputError, RevlineError
from revline.io.fit_records import fit_record
from revline.lti.response import FrequencyResponse
from revline.web.plants import (
    MODELS,
    Point,
    check_amplitude,
    check_influence,
    control_of,
    find_balance,
    find_point,
    fit_model,
    place_of,
)
from revline.web.problems import problem_of
from revline.web.state import State
from revline.web.view.drawing import drawn

GRID: Final = tuple(float(w) for w in np.geomspace(0.1, 200.0, 90))
"""Frequencies in rad/s at which exact response and models are drawn."""

PEAKS: Final = (0.5, 2.0, 5.0, 10.0, 20.0, 35.0, 50.0)
"""Frequencies in rad/s of the sinusoids that are simulated."""

PROGRAM: Final = f"revline {__version__}"


def view_response(state: State) -> Mapping[str, Any]:
    """Give the response of the speed to the throttle: of the exact linear model, and of the engine by harmonic balance."""
    place = place_of(state)
    point = find_point(place)
    record: dict[str, Any] = {"exact": _exact(state, point)}
    try:
        check_amplitude(state, point)
        found = find_balance(place, state.amplitude_deg)
    except RevlineError as error:  # the exact response needs no sinusoid
        return {**record, "harmonic_balance": {"problem": problem_of(error, control=control_of(error, state) or "amplitude_deg")}}
    balance = found.finished if isinstance(found, PartialBalance) else found
    record["harmonic_balance"] = {
        **curve(balance.response()),
        "distortion": drawn(balance.distortion),
        "notes": [*balance.notes, *([str(found)] if isinstance(found, PartialBalance) else [])],
    }
    return record


def _exact(state: State, point: Point) -> Mapping[str, Any]:
    """The exact linear response, or why there is none."""
    try:
        check_influence(state, point)
    except InvalidInputError as error:
        return {"problem": problem_of(error, control=control_of(error, state))}
    return curve(point.linear.model.response(np.array(GRID), "throttle", "engine_speed"))


def view_models(state: State) -> Mapping[str, Any]:
    """Give the models fitted to the response by harmonic balance, each as `revline fit --json` does, with its curves and errors."""
    place = place_of(state)
    check_amplitude(state, find_point(place))
    return {name: _model(fit_model(place, state.amplitude_deg, name)) for name in MODELS}


def view_peaks(state: State) -> Mapping[str, Any]:
    """Give the response by simulated sinusoids and the thesis's reading of their peaks, at a few frequencies."""
    point = find_point(place_of(state))
    check_amplitude(state, point)
    excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=state.amplitude_deg)
    found = attempt_sinestream(point.engine, point.trim, excitation, np.array(PEAKS), workers=1)
    stream = found.finished if isinstance(found, PartialSinestream) else found
    record = {**curve(stream.response(ReadingMethod.PEAKS)), "distortion": drawn(stream.distortion)}
    return {**record, "missing": str(found)} if isinstance(found, PartialSinestream) else record


def curve(response: FrequencyResponse) -> dict[str, Any]:
    """Give a response for drawing."""
    return {
        "frequency_rad_s": drawn(response.omega),
        "magnitude_db": drawn(response.magnitude_db),
        "phase_deg": drawn(response.phase_deg),
    }


def _model(named: NamedFit) -> Mapping[str, Any]:
    fit, model = named.fit, named.fit.model
    shown = model.response(np.array(GRID))
    return {
        **fit_record(fit, judge_model(fit), name=named.name, provenance={"program": PROGRAM}),
        "curve": curve(shown),
        "errors": {
            "frequency_rad_s": drawn(fit.data.omega),
            "magnitude_db": drawn(fit.magnitude_error_db),
            "phase_deg": drawn(fit.phase_error_deg),
        },
    }
