"""Harmonic balance in batches: the same answers as at once, and what is found is kept where others fail."""

import re
from dataclasses import replace

import numpy as np
import pytest

from revline.analysis import balance_attempts, forced_orbits
from revline.analysis.balance_attempts import PartialBalance, attempt_balance
from revline.analysis.collocation import Collocation
from revline.analysis.harmonic_balance import BalanceSettings, HarmonicBalance, balance_each, balance_harmonics, excited_case
from revline.analysis.orbit_following import Followed, follow_amplitudes
from revline.analysis.orbit_refusals import ForcedCase
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
    assert str(found).startswith("2 of 3 frequencies are finished with 5 deg, each of them has an answer up to 3.")
    assert "; missing: 2 rad/s (" in str(found)


@pytest.mark.parametrize(("throttle", "amplitude", "words"), [(10.0, 9.0, "delivers nothing"), (8.0, 5.0, "no periodic answer")])
def test_the_largest_amplitude_that_is_told_is_one_with_an_answer_and_little_more_has_none(
    engine: DelaySystem, throttle: float, amplitude: float, words: str
) -> None:
    """Most frequencies stall the engine: each is followed once, all at once, and the number told holds when it is asked for."""
    trim, omega = find_trim(engine, inputs={"throttle": throttle}), np.array([0.02, 0.3, 1.0, 2.0, 20.0])
    found = attempt_balance(engine, trim, sine(amplitude), omega)
    assert isinstance(found, PartialBalance)
    assert len(found.missing) >= 3
    assert any(words in entry.reason for entry in found.missing)
    assert all(re.search(r"there is (an orbit|one) up to [0-9.]+ deg", entry.reason) for entry in found.missing)
    assert found.reach is not None
    assert isinstance(attempt_balance(engine, trim, sine(found.reach), omega), HarmonicBalance)
    beyond = attempt_balance(engine, trim, sine(1.05 * found.reach), omega)
    assert isinstance(beyond, PartialBalance)


def test_orbits_that_are_followed_at_once_are_those_followed_one_by_one(engine: DelaySystem, monkeypatch: pytest.MonkeyPatch) -> None:
    """10 +- 9 deg: the frequencies without an orbit reach as far alone as together, and together they are followed once."""
    followed: list[int] = []

    def follow(case: ForcedCase, mesh: Collocation) -> Followed:
        followed.append(case.drive.omega.size)
        return follow_amplitudes(case, mesh)

    monkeypatch.setattr(forced_orbits, "follow_amplitudes", follow)
    trim = find_trim(engine, inputs={"throttle": 10.0})
    case = replace(excited_case(engine, trim, sine(9.0), BalanceSettings()), seek_limits=True)
    omega = np.array([0.02, 0.5, 20.0])
    _, together = balance_each(case, trim, omega)
    assert followed == [len(together)]
    alone = {row: balance_each(case, trim, omega[row : row + 1])[1] for row in range(omega.size)}
    assert sorted(together) == [row for row, refused in alone.items() if refused]
    for row, error in together.items():
        assert error.details["amplitude"] == pytest.approx(alone[row][0].details["amplitude"], rel=0.01)


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
