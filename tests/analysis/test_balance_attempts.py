"""Harmonic balance in batches: the same answers as at once, and what is found is kept where others fail."""

import numpy as np
import pytest

from revline.analysis import balance_attempts
from revline.analysis.balance_attempts import PartialBalance, attempt_balance
from revline.analysis.harmonic_balance import BalanceSettings, balance_harmonics
from revline.analysis.periodic import Excitation
from revline.analysis.trim import find_trim
from revline.errors import AnalysisError, InvalidInputError
from revline.system import DelaySystem

OMEGA = np.geomspace(0.5, 2000.0, 9)


def sine(amplitude: float) -> Excitation:
    return Excitation(input_name="throttle", output_name="engine_speed", amplitude=amplitude)


def test_batches_give_the_answers_with_all_turns_that_one_call_gives(engine: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    trim, settings = find_trim(engine, inputs={"throttle": 40.0}), BalanceSettings(tolerance=1e-4)
    whole = balance_harmonics(engine, trim, sine(2.0), OMEGA, settings=settings)
    monkeypatch.setattr(balance_attempts, "BATCH", 2)
    told: list[float] = []
    parts = attempt_balance(engine, trim, sine(2.0), OMEGA, settings=settings, progress=told.append)
    assert not isinstance(parts, PartialBalance)
    assert parts.omega.tolist() == OMEGA.tolist()
    for name in ("amplitude", "phase_deg", "distortion", "mean_shift"):
        assert getattr(parts, name) == pytest.approx(getattr(whole, name), rel=1e-6), name
    assert parts.phase_deg[-1] < -360.0
    assert [orbit.omega for orbit in parts.orbits] == OMEGA.tolist()
    assert told == pytest.approx([2 / 9, 4 / 9, 6 / 9, 8 / 9, 1.0])


def test_a_frequency_without_an_orbit_is_named_and_the_others_are_kept(engine: DelaySystem) -> None:
    """10 +- 5 deg has an orbit at 0.1 and at 50 rad/s, none at 2."""
    trim = find_trim(engine, inputs={"throttle": 10.0})
    found = attempt_balance(engine, trim, sine(5.0), [0.1, 2.0, 50.0])
    assert isinstance(found, PartialBalance)
    assert found.finished.omega.tolist() == [0.1, 50.0]
    assert [entry.omega for entry in found.missing] == [2.0]
    assert str(found).startswith("2 of 3 frequencies are finished; missing: 2 rad/s (")


def test_what_is_found_before_an_interruption_is_kept(engine: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(balance_attempts, "BATCH", 1)

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    found = attempt_balance(engine, find_trim(engine, inputs={"throttle": 25.0}), sine(1.0), [1.0, 2.0], progress=interrupt)
    assert isinstance(found, PartialBalance)
    assert str(found) == "1 of 2 frequencies are finished; missing: 2 rad/s (interrupted)"


def test_where_no_frequency_has_an_answer_the_first_error_is_raised(engine: DelaySystem) -> None:
    with pytest.raises(AnalysisError, match="2 rad/s"):
        attempt_balance(engine, find_trim(engine, inputs={"throttle": 10.0}), sine(5.0), [2.0])


def test_what_cannot_be_asked_is_refused(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 25.0})
    with pytest.raises(InvalidInputError, match="frequency = 0 rad/s is outside values above 0; ask for the steady map instead"):
        attempt_balance(engine, trim, sine(1.0), [0.0, 1.0])
    with pytest.raises(InvalidInputError, match="goes too far"):
        attempt_balance(engine, trim, sine(70.0), [1.0])
