import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.analysis.linearize import linearize
from revline.analysis.phase_turns import follow_phase, read_turns, take_turns, unwrap_alone
from revline.analysis.trim import find_trim
from revline.errors import NotConvergedError
from revline.lti.state_space import DelayStateSpace
from revline.system import DelaySystem


@pytest.fixture(scope="module")
def model(wiener: DelaySystem) -> DelayStateSpace:
    """3 exp(-0.3 s) / (s + 3)."""
    return linearize(wiener, find_trim(wiener, inputs={"force": 0.5})).model


@given(omega=st.floats(1e-3, 1e3), factor=st.floats(1.5, 100.0))
def test_the_model_tells_all_turns_however_far_apart_the_frequencies(model: DelayStateSpace, omega: float, factor: float) -> None:
    grid = np.array([omega, factor * omega])
    assert follow_phase(model, grid, "force", "straight") == pytest.approx(-np.arctan(grid / 3.0) - 0.3 * grid, rel=1e-9)


@pytest.mark.parametrize("angle", [6.0, 25.0])
def test_turns_do_not_depend_on_the_lowest_frequency(angle: float, engine: DelaySystem) -> None:
    """At 6 deg lags and poles have turned the phase by more than half a turn at a thousandth of 10000 rad/s."""
    model = linearize(engine, find_trim(engine, inputs={"throttle": angle})).model
    from_far_below = follow_phase(model, [0.001, 10000.0], "throttle", "engine_speed")[-1]
    assert follow_phase(model, [10000.0], "throttle", "engine_speed")[0] == pytest.approx(from_far_below, abs=1e-6)


def test_neighbours_alone_lose_turns() -> None:
    """Negative control: the same response unwrapped from neighbour to neighbour is wrong by whole turns, and says so where it can."""
    grid = np.array([1.0, 30.0, 60.0])
    values = 3.0 * np.exp(-0.3j * grid) / (3.0 + 1j * grid)
    exact = np.degrees(-np.arctan(grid / 3.0) - 0.3 * grid)
    phases, notes = unwrap_alone(values, grid, 0.0)
    assert phases[2] - exact[2] == pytest.approx(1080.0)
    assert any("too coarse" in note for note in notes)
    assert unwrap_alone(values, grid, 0.3)[0] == pytest.approx(exact)


def test_a_measured_phase_takes_the_next_turn_and_says_when_that_is_uncertain() -> None:
    guide = np.array([-1.0, -9.0, -20.0])
    values = np.exp(1j * (guide + np.array([0.1, -0.3, 2.0])))
    phases, notes = take_turns(values, guide, np.array([1.0, 2.0, 3.0]))
    assert phases == pytest.approx(np.degrees([-0.9, -9.3, -18.0]))
    assert notes == ("phase at 3 rad/s is 115 deg from the linear model's: its number of turns is uncertain",)


def test_an_output_without_linear_answer_has_no_phase(model: DelayStateSpace) -> None:
    with pytest.raises(NotConvergedError, match=r"constant does not answer force in the linear model at 0.001 rad/s"):
        follow_phase(model, [1.0, 2.0], "force", "constant")


def test_a_measured_response_takes_the_models_turns(model: DelayStateSpace) -> None:
    grid = np.array([5.0, 60.0])
    guide = model.response(grid, "force", "straight")
    reading = read_turns(1.1 * guide.values * np.exp(0.2j), guide, model)
    assert reading.phase_deg == pytest.approx(np.degrees(0.2 - np.arctan(grid / 3.0) - 0.3 * grid))
    assert reading.notes == ()


def test_a_phase_far_from_the_models_is_noted(model: DelayStateSpace) -> None:
    """Another quarter of a turn and more than the model says."""
    grid = np.array([5.0, 60.0])
    guide = model.response(grid, "force", "straight")
    reading = read_turns(guide.values * np.exp([0.0, -1.7j]), guide, model)
    assert reading.phase_deg[1] == pytest.approx(np.degrees(-1.7 - np.arctan(20.0) - 18.0))
    assert reading.notes == ("phase at 60 rad/s is -97 deg from the linear model's: its number of turns is uncertain",)


def test_a_model_that_hardly_answers_is_no_guide(model: DelayStateSpace) -> None:
    guide = model.response([1.0, 2.0], "force", "straight")
    reading = read_turns(1e3 * guide.values, guide, model)
    assert reading.notes[0] == "at 1 rad/s the linear model has 0.001 of the answer of straight to force: it cannot tell the turns"
    assert reading.phase_deg == pytest.approx(guide.phase_deg)


def test_a_phase_of_too_many_turns_is_refused(model: DelayStateSpace) -> None:
    with pytest.raises(NotConvergedError, match=r"the lags of 0.3 s turn the phase .* times up to 1e\+07 rad/s"):
        follow_phase(model, [1e7], "force", "straight")
