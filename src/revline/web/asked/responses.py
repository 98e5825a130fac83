"""Questions about frequency responses and the models fitted to them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from revline import __version__
from revline.analysis.linearity import check_distortion_limit
from revline.design.fitting.fit import DelayRule, Weight, fit_transfer_function
from revline.design.fitting.model_choice import judge_model
from revline.errors import InvalidInputError
from revline.io.fit_records import fit_record
from revline.io.response_files import parse_response
from revline.studies.response_routes import Sines, check_response, find_response, place_of, require_whole, response_record, usual_check
from revline.web.asked.plants import Unwatched, engine_of, table_of
from revline.web.questions import FitQuestion, ResponseQuestion

PROGRAM: Final = f"revline {__version__}"
"""What records say of their origin."""


def find_response_record(asked: ResponseQuestion) -> Mapping[str, object]:
    """Answer as `revline response --json`."""
    check_distortion_limit(asked.distortion_limit)
    sines = Sines(asked.time_step_s, 1, asked.distortion_limit)
    omega = np.array(asked.frequencies_rad_s)
    place = place_of(engine_of(asked), asked.throttle_deg, asked.load_n_m, asked.amplitude_deg, omega)
    told = Unwatched()
    found = find_response(told, place, asked.method, sines)
    checked = check_response(told, place, found, asked.check or usual_check(asked.method), sines)
    require_whole(found, checked)
    shown = {
        "engine": asked.engine,
        "throttle_deg": asked.throttle_deg,
        "load_n_m": asked.load_n_m,
        "amplitude_deg": asked.amplitude_deg,
        "method": asked.method,
    }
    return response_record(shown, asked.amplitude_deg, found, checked)


def find_fit_record(asked: FitQuestion) -> Mapping[str, object]:
    """Answer as `revline fit --json`, with what was assumed about the data as `notes` beside."""
    table = table_of(asked.csv, asked.frequency_response, asked.data_name)
    file = parse_response(table, columns=asked.columns, amplitude=asked.amplitude_deg)
    found = fit_transfer_function(file.response, zeros=asked.zeros, poles=asked.poles, delay=_delay(asked), weight=Weight(asked.weight))
    title = asked.name or Path(asked.data_name).stem
    record = fit_record(found, judge_model(found), name=title, provenance={"program": PROGRAM, "data": asked.data_name})
    return {**record, "notes": list(file.notes)} if file.notes else record


def _delay(asked: FitQuestion) -> DelayRule | float:
    if (asked.delay == "fixed") != (asked.delay_s is not None):
        message = f"delay {asked.delay} with {'no delay_s' if asked.delay_s is None else 'delay_s'}: give delay fixed and delay_s together"
        raise InvalidInputError(message, control="delay_s")
    return DelayRule(asked.delay) if asked.delay_s is None else asked.delay_s
