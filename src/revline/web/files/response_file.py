"""A frequency response of the user's own: checked, fitted, and held against the engine at the operating point of a state."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from revline.analysis.balance_attempts import PartialBalance, attempt_balance
from revline.analysis.periodic import Excitation
from revline.errors import InvalidInputError, RevlineError
from revline.io.csv_table import parse_csv_table
from revline.io.response_files import parse_response
from revline.lti.response import FrequencyResponse
from revline.web.files.fitting import fit_record_of, fitted_models
from revline.web.plants import check_amplitude, find_point, place_of
from revline.web.problems import problem_of
from revline.web.state import State
from revline.web.view.drawing import drawn
from revline.web.view.responses import curve

MOST_ROWS: Final = 2000
"""Frequencies of a file at most."""

MOST_BALANCED: Final = 120
"""Frequencies at most at which harmonics are balanced; of more, some spread evenly."""


def read_response_file(text: str, name: str, state: State) -> Mapping[str, Any]:
    """Check, fit and compare a frequency response.

    Args:
        text: of a CSV file with frequency, magnitude or amplitude, and phase.
        name: what messages call it.
        state: the engine that it is compared with.

    Returns:
        `response`, `models` fitted as a view fits its own, `engine` with the differences from the exact linear model and from harmonic
        balance at the state's amplitude, and `notes`.

    Raises:
        InvalidInputError: the file is none, names no such quantities, or holds too many frequencies; with line and column.
    """
    file = parse_response(parse_csv_table(text, Path(name)))
    response = file.response
    if response.omega.size > MOST_ROWS:
        message = f"{name} holds {response.omega.size} frequencies; give {MOST_ROWS} at most"
        raise InvalidInputError(message, frequencies=float(response.omega.size))
    record: dict[str, Any] = {"kind": "response", "name": name, "response": curve(response), "notes": list(file.notes)}
    if file.distortion.size:
        record["response"]["distortion"] = drawn(file.distortion)
    record["models"] = {key: _shown(key, found) for key, found in fitted_models(response).items()}
    record["engine"] = compare_with_engine(response, state)
    return record


def _shown(key: str, found: Any) -> Mapping[str, Any]:
    return {"problem": problem_of(found)} if isinstance(found, RevlineError) else fit_record_of(key, found)


def compare_with_engine(response: FrequencyResponse, state: State) -> Mapping[str, Any]:
    """Hold a response against the engine's own, at the same frequencies.

    Args:
        response: of the speed to the throttle.
        state: names engine, operating point and amplitude.
    """
    try:
        point = find_point(place_of(state))
    except RevlineError as error:
        return {"problem": problem_of(error)}
    exact = point.linear.model.response(response.omega, "throttle", "engine_speed")
    record: dict[str, Any] = {
        "throttle_deg": point.trim.input("throttle"),
        "load_n_m": state.load_n_m,
        "exact": _difference(response, exact),
    }
    try:
        check_amplitude(state, point)
        excitation = Excitation(input_name="throttle", output_name="engine_speed", amplitude=state.amplitude_deg)
        kept = np.unique(np.linspace(0, response.omega.size - 1, min(response.omega.size, MOST_BALANCED)).round().astype(int))
        found = attempt_balance(point.engine, point.trim, excitation, response.omega[kept])
    except RevlineError as error:
        return {**record, "harmonic_balance": {"problem": problem_of(error)}}
    balance = found.finished if isinstance(found, PartialBalance) else found
    here = np.isin(response.omega, balance.omega)
    some = FrequencyResponse(
        omega=response.omega[here],
        values=response.values[here],
        input_name=response.input_name,
        input_unit=response.input_unit,
        output_name=response.output_name,
        output_unit=response.output_unit,
        method=response.method,
    )
    shown = _difference(some, balance.response())
    return {**record, "harmonic_balance": {**shown, **({"missing": str(found)} if isinstance(found, PartialBalance) else {})}}


def _difference(measured: FrequencyResponse, computed: FrequencyResponse) -> dict[str, Any]:
    """The computed response, and what the measured one has more; phases differ by less than half a turn."""
    ratio = measured.values / computed.values
    size, turn = 20.0 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
    return {
        **curve(computed),
        "magnitude_difference_db": drawn(size),
        "phase_difference_deg": drawn(turn),
        "max_magnitude_difference_db": float(np.max(np.abs(size))),
        "max_phase_difference_deg": float(np.max(np.abs(turn))),
        "rms_magnitude_difference_db": float(np.sqrt(np.mean(size**2))),
        "rms_phase_difference_deg": float(np.sqrt(np.mean(turn**2))),
    }
