from dataclasses import replace

import numpy as np
import pytest

from revline.analysis import turn_check
from revline.analysis.balance_attempts import PartialBalance
from revline.analysis.exact_response import find_exact_response
from revline.analysis.harmonic_balance import balance_harmonics
from revline.analysis.periodic import Excitation
from revline.analysis.sinestream import MissingAnswer
from revline.analysis.trim import find_trim
from revline.analysis.turn_check import check_turns
from revline.errors import AnalysisError, NotConvergedError
from revline.lti.response import FrequencyResponse
from revline.system import DelaySystem, Floats

PUSH = Excitation(input_name="force", output_name="straight", amplitude=0.1)
THROTTLE = Excitation(input_name="throttle", output_name="engine_speed", amplitude=5.0)
OMEGA = np.array([1.0, 30.0, 200.0])


def closed_form(omega: Floats) -> FrequencyResponse:
    """3 exp(-0.3 s) / (s + 3), its turns given."""
    values = 3.0 * np.exp(-0.3j * omega) / (3.0 + 1j * omega)
    turns = np.rint((-np.arctan(omega / 3.0) - 0.3 * omega - np.angle(values)) / (2.0 * np.pi)).astype(np.int64)
    return FrequencyResponse(
        omega=omega, values=values, input_name="force", input_unit="N", output_name="straight", output_unit="m", turns=turns
    )


def test_small_orbits_count_the_turns_of_a_closed_form(wiener: DelaySystem) -> None:
    found = check_turns(wiener, find_trim(wiener, inputs={"force": 0.5}), PUSH, closed_form(OMEGA))
    assert found.counted_deg == pytest.approx(np.degrees(-np.arctan(OMEGA / 3.0) - 0.3 * OMEGA), abs=1e-3)
    assert found.agreed
    found.require_agreement()


def test_a_turn_too_many_is_found(wiener: DelaySystem) -> None:
    right = closed_form(OMEGA)
    found = check_turns(wiener, find_trim(wiener, inputs={"force": 0.5}), PUSH, replace(right, turns=right.turns + np.array([0, 0, 1])))
    assert found.turns.tolist() == [0, 0, 1]
    with pytest.raises(AnalysisError, match=r"failed at 1 of 3 frequencies: at 200 rad/s the phase .* the whole turns differ by 1;"):
        found.require_agreement()


@pytest.mark.parametrize("omega", [[1000.0], [0.01, 40.0], [300.0, 400.0]])
def test_the_linear_model_tells_the_engine_s_turns_near_the_edge_of_stability(omega: list[float], engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 6.0})
    exact = find_exact_response(engine, trim, omega, input_name="throttle", output_name="engine_speed")
    found = check_turns(engine, trim, THROTTLE, exact)
    assert found.agreed
    assert found.counted_deg == pytest.approx(exact.phase_deg, abs=3.0)


def test_what_cannot_be_counted_is_said(engine: DelaySystem, wiener: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    trim = find_trim(wiener, inputs={"force": 0.5})
    with pytest.raises(NotConvergedError, match=r"up to 100000 rad/s takes more than 2000 orbits; choose lower frequencies"):
        check_turns(wiener, trim, PUSH, closed_form(np.array([1e5])))
    unstable = find_trim(engine, inputs={"throttle": 5.0})
    response = find_exact_response(engine, unstable, [1.0], input_name="throttle", output_name="engine_speed")
    with pytest.raises(AnalysisError, match="not open-loop stable"):
        check_turns(engine, unstable, THROTTLE, response)
    some = balance_harmonics(wiener, trim, PUSH, [1.0])
    partial = PartialBalance(finished=some, missing=(MissingAnswer(2.0, "no orbit"),))
    monkeypatch.setattr(turn_check, "attempt_balance", lambda *_, **__: partial)
    with pytest.raises(NotConvergedError, match=r"turns cannot be counted past 2 rad/s: no orbit"):
        check_turns(wiener, trim, PUSH, closed_form(OMEGA))
