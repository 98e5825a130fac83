"""Describing functions and the amplitudes up to which the linear model holds: against closed forms, the steady map, and simulation."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from revline.analysis import linear_range
from revline.analysis.describing import find_describing_functions, largest_amplitude
from revline.analysis.harmonic_balance import BalanceSettings
from revline.analysis.linear_range import HoldsThroughout, HoldsUntilNoOrbit, HoldsUpTo, RangeLimits, find_linear_ranges
from revline.analysis.periodic import Excitation, RunSettings
from revline.analysis.sinestream import find_sinestream
from revline.analysis.trim import find_trim
from revline.equations import equation
from revline.errors import AnalysisError, InvalidInputError
from revline.system import DelaySystem, Floats, Variable

Vector = tuple[float, ...]
SPEED = ("throttle", "engine_speed")
LATE = ("force", "late")


class Cubic(NamedTuple):
    """Parameters of a lag whose cube is added to it, read late; the input may make it read later still."""

    pole: float = 2.0
    cube: float = 0.3
    lag: float = 0.4
    lag_slope: float = 0.0


@equation
def cubic_emit(p: Cubic, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0] + p.cube * x[0] * x[0] * x[0],)


@equation
def cubic_lags(p: Cubic, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.lag + p.lag_slope * u[0],)


@equation
def cubic_rate(p: Cubic, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (p.pole * (u[0] - x[0]),)


@equation
def cubic_output(p: Cubic, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (zd[0],)


def build_cubic(parameters: Cubic) -> DelaySystem:
    return DelaySystem(
        name="cubic",
        parameters=parameters,
        states=(Variable(name="level", unit="m", search_low=-6.0, search_high=6.0),),
        inputs=(Variable(name="force", unit="N", low=-5.0, high=5.0),),
        channels=(Variable(name="sent", unit="m"),),
        outputs=(Variable(name="late", unit="m"),),
        emit=cubic_emit,
        lags=cubic_lags,
        rate=cubic_rate,
        output=cubic_output,
    )


CUBIC = build_cubic(Cubic())
OMEGA = np.array([0.3, 2.0, 11.0])


def swing(amplitude: Floats, omega: Floats) -> Floats:
    """Amplitude of the level."""
    result: Floats = amplitude * 2.0 / np.hypot(2.0, omega)
    return result


def test_a_cube_has_the_describing_function_of_the_books() -> None:
    """x + c x^3 under a sin(phase): fundamental (1 + 3/4 c a^2) a, third harmonic c a^3 / 4, no mean."""
    amplitudes = np.array([0.5, 1.0, 3.0])
    found = find_describing_functions(CUBIC, find_trim(CUBIC), LATE, OMEGA, amplitudes)
    a = swing(amplitudes[:, None], OMEGA)
    small = 2.0 / (2.0 + 1j * OMEGA) * np.exp(-0.4j * OMEGA)
    part = 0.75 * 0.3 * a**2
    assert found.small == pytest.approx(small, rel=1e-13)
    assert found.gain == pytest.approx(small * (1.0 + part), rel=1e-9)
    assert found.linear_error == pytest.approx(part / (1.0 + part), rel=1e-8)
    assert found.distortion == pytest.approx(0.25 * 0.3 * a**2 / (1.0 + part), rel=1e-8)
    assert found.mean_shift == pytest.approx(0.0, abs=1e-9)
    assert found.phase_deg == pytest.approx(np.tile(-np.degrees(np.arctan(0.5 * OMEGA) + 0.4 * OMEGA), (3, 1)), abs=1e-7)
    assert found.found.all()
    assert found.missing == ()


def test_the_amplitude_at_a_limit_is_the_closed_form_s() -> None:
    """The error (3/4 c a^2) / (1 + 3/4 c a^2) reaches e where 3/4 c a^2 = e / (1 - e)."""
    found = find_linear_ranges(CUBIC, find_trim(CUBIC), LATE, OMEGA, limits=RangeLimits(error=0.04))
    wanted = np.sqrt(0.04 / 0.96 / (0.75 * 0.3)) / (2.0 / np.hypot(2.0, OMEGA))
    for entry, amplitude in zip(found.ranges, wanted, strict=True):
        assert isinstance(entry, HoldsUpTo)
        assert entry.amplitude == pytest.approx(amplitude, rel=1e-6)
        assert entry.reached == "error"
        assert entry.error == pytest.approx(0.04, rel=2e-6)
        assert np.min(np.abs(found.grid.amplitudes - amplitude)) > 1e-3  # it is no point of the grid
    assert found.narrowest.omega == 0.3


def test_a_search_that_is_given_up_does_not_say_that_the_model_holds_throughout(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = RangeLimits(error=0.04)
    wanted = find_linear_ranges(CUBIC, find_trim(CUBIC), LATE, [0.3], limits=limits).ranges[0].amplitude
    monkeypatch.setattr(linear_range, "MOST_TRIES", 1)
    (entry,) = find_linear_ranges(CUBIC, find_trim(CUBIC), LATE, [0.3], limits=limits).ranges
    assert isinstance(entry, HoldsUpTo)
    assert 0.5 * wanted < entry.amplitude < wanted  # what is left out is on the safe side
    assert entry.error < 0.04


def test_the_distortion_may_be_what_ends_the_range() -> None:
    found = find_linear_ranges(CUBIC, find_trim(CUBIC), LATE, [0.3], limits=RangeLimits(error=0.2, distortion=0.01))
    (entry,) = found.ranges
    assert isinstance(entry, HoldsUpTo)
    assert entry.reached == "distortion"
    square = 0.01 / (0.3 * (0.25 - 0.01 * 0.75))
    assert entry.amplitude == pytest.approx(np.sqrt(square) / swing(np.ones(1), np.array([0.3]))[0], rel=1e-5)


def test_a_range_that_ends_at_the_input_s_limits_says_so() -> None:
    straight = build_cubic(Cubic(cube=0.001))
    trim = find_trim(straight, inputs={"force": 1.0})
    (whole,) = find_linear_ranges(straight, trim, LATE, [2.0]).ranges
    assert isinstance(whole, HoldsThroughout)
    assert (whole.amplitude, whole.to_input_limits) == (4.0, True)
    (part,) = find_linear_ranges(straight, trim, LATE, [2.0], [1.0, 2.0]).ranges
    assert isinstance(part, HoldsThroughout)
    assert (part.amplitude, part.to_input_limits) == (2.0, False)
    assert 0.0 < part.error < whole.error < 0.05


def test_a_range_that_ends_where_delayed_time_would_run_backwards_says_so() -> None:
    """d(t - lag - s a sin(w t))/dt stays positive while a < 1 / (w s)."""
    system = build_cubic(Cubic(cube=1e-6, lag=2.0, lag_slope=0.3))
    found = find_linear_ranges(system, find_trim(system), LATE, [1.5], [1.0, 2.0, 3.0, 4.0, 5.0], limits=RangeLimits(error=0.9))
    (entry,) = found.ranges
    assert isinstance(entry, HoldsUntilNoOrbit)
    edge = 1.0 / (1.5 * 0.3)
    assert 0.99 * edge <= entry.amplitude < edge <= entry.refused_at <= 1.01 * edge
    assert "the rate of its delayed time falls to" in entry.reason
    assert [cell.amplitude for cell in found.grid.missing] == [3.0, 4.0, 5.0]
    assert found.grid.missing[2].reason.startswith("not tried, for there is none at amplitude 3: channel sent")
    assert found.grid.found[:, 0].tolist() == [True, True, False, False, False]
    assert found.grid.linear_error[2:, 0].tolist() == [0.0, 0.0, 0.0]


def test_the_error_of_the_linear_model_falls_with_the_square_of_the_amplitude(engine: DelaySystem) -> None:
    trim = find_trim(engine, inputs={"throttle": 25.0})
    fine = BalanceSettings(tolerance=1e-10)
    found = find_describing_functions(engine, trim, SPEED, [0.5, 5.0, 40.0], [0.5, 1.0, 2.0], settings=fine)
    order = np.log2(found.linear_error[1:] / found.linear_error[:-1])
    assert order[0] == pytest.approx(2.0, abs=0.01)
    assert order[1] == pytest.approx(2.0, abs=0.03)


def test_slow_sinusoids_meet_the_steady_map(engine: DelaySystem) -> None:
    """As the frequency falls, the gain goes to the first Fourier coefficient of the steady speeds along a period."""
    trim = find_trim(engine, inputs={"throttle": 30.0})
    amplitude, count = 8.0, 16
    phases = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    speeds = [find_trim(engine, inputs={"throttle": 30.0 + amplitude * np.sin(p)}).output("engine_speed") for p in phases]
    static = 2.0 / count * np.sum(np.array(speeds) * np.sin(phases)) / amplitude
    found = find_describing_functions(engine, trim, SPEED, [1e-4, 1e-3, 1e-2], [amplitude], settings=BalanceSettings(tolerance=1e-10))
    assert abs(found.gain[0, 0] / static - 1.0) < 1e-4
    # Its imaginary part, from the lags, is of the first order in the frequency; what is left of the real part of the second.
    assert np.log10(np.abs(found.gain[0, 1:].imag / found.gain[0, :-1].imag)) == pytest.approx(1.0, abs=0.01)
    assert found.gain[0, 0].real == pytest.approx(static, rel=2e-8)
    assert np.abs(found.small[0] / static - 1.0) > 1e-3  # negative control: the linear model has another gain


def test_cells_agree_with_converged_simulations(engine: DelaySystem) -> None:
    chance = np.random.default_rng(1995)
    for _ in range(4):
        angle, load, omega = chance.uniform(12.0, 50.0), chance.uniform(0.0, 10.0), 10.0 ** chance.uniform(-0.5, 1.8)
        trim = find_trim(engine, inputs={"throttle": angle, "load_torque": load})
        amplitude = chance.uniform(0.1, 0.4) * largest_amplitude(engine, trim, "throttle")
        found = find_describing_functions(engine, trim, SPEED, [omega], [0.5 * amplitude, amplitude])
        sine = Excitation(input_name="throttle", output_name="engine_speed", amplitude=float(amplitude))
        stream = find_sinestream(engine, trim, sine, [omega], settings=RunSettings(tolerance=1e-7, step_tolerance=1e-7))
        assert found.gain[1, 0] == pytest.approx(stream.fourier.values[0], rel=5e-6)
        assert found.distortion[1, 0] == pytest.approx(stream.distortion[0], abs=1e-5)
        assert found.mean_shift[1, 0] == pytest.approx(stream.mean[0] - stream.rest, abs=1e-3)


@pytest.mark.reference
def test_the_engine_s_error_at_five_degrees(engine: DelaySystem) -> None:
    """Converged: the small-signal response lies above that at 5 deg by 0.12 % at 0.1 rad/s, 0.17 % at 1 and 1.4 % at 5 rad/s."""
    trim = find_trim(engine, inputs={"throttle": 25.0})
    found = find_describing_functions(engine, trim, SPEED, [0.1, 1.0, 5.0], [5.0])
    above = np.abs(found.small) / np.abs(found.gain[0]) - 1.0
    assert above[:2] == pytest.approx([0.0012, 0.0017], abs=5e-5)
    assert above[2] == pytest.approx(0.014, abs=5e-4)


def test_progress_is_told() -> None:
    told: list[float] = []
    find_linear_ranges(CUBIC, find_trim(CUBIC), LATE, OMEGA, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert 0.5 in told


@pytest.mark.parametrize(
    ("amplitudes", "words"),
    [
        ([], "do not rise from above 0"),
        ([0.0, 1.0], "do not rise from above 0"),
        ([1.0, 1.0], "do not rise from above 0"),
        ([1.0, np.nan], "do not rise from above 0"),
        ([1.0, 6.0], r"amplitude = 6 N is outside .*5 N"),
    ],
)
def test_amplitudes_that_cannot_be_used_are_refused(amplitudes: list[float], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        find_describing_functions(CUBIC, find_trim(CUBIC), LATE, OMEGA, amplitudes)


def test_what_has_no_room_or_no_answer_is_refused(engine: DelaySystem) -> None:
    at_rest = find_trim(CUBIC)
    with pytest.raises(InvalidInputError, match=r"frequency = 0 rad/s"):
        find_describing_functions(CUBIC, at_rest, LATE, [0.0, 1.0])
    with pytest.raises(InvalidInputError, match="no signal nothing"):
        find_describing_functions(CUBIC, at_rest, ("nothing", "late"), [1.0])
    with pytest.raises(InvalidInputError, match="leaves no room for a sinusoid"):
        largest_amplitude(CUBIC, find_trim(CUBIC, inputs={"force": 5.0}), "force")
    endless = replace(CUBIC, inputs=(Variable(name="force", unit="N"),))
    with pytest.raises(InvalidInputError, match="endless room"):
        largest_amplitude(endless, find_trim(endless), "force")
    with pytest.raises(AnalysisError, match="not open-loop stable"):
        find_linear_ranges(engine, find_trim(engine, inputs={"throttle": 4.0}), SPEED, [1.0])


@pytest.mark.parametrize(("limits", "words"), [({"error": 0.0}, "limit of the linear model's error"), ({"distortion": -1.0}, "distortion")])
def test_limits_out_of_range_are_refused(limits: dict[str, float], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        RangeLimits(**limits)
