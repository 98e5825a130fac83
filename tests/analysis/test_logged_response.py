"""Responses from records: exact experiments whose every error is known, and a bound that is neither too small nor empty."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter, max_len_seq

from revline.analysis import logged_response
from revline.analysis.local_polynomials import fit_locally
from revline.analysis.logged_response import Between, LoggedResponse, _aliases, _uncertain, estimate_response, looks_held
from revline.errors import AnalysisError, InvalidInputError

Floats = NDArray[np.float64]
STEP, SLOW, FAST, DELAY = 0.01, 0.4, 0.05, 0.0237
"""Sampling, two lags and a delay in s: exp(-s delay)/((slow s + 1)(fast s + 1)); the delay is no multiple of the sampling."""


def exact_response(omega: Floats) -> NDArray[np.complex128]:
    s = 1j * omega
    return np.asarray(np.exp(-DELAY * s) / ((SLOW * s + 1.0) * (FAST * s + 1.0)))


def step_answer(times: NDArray[np.floating]) -> Floats:
    t = np.maximum(times - DELAY, 0.0)
    return np.asarray(1.0 - (SLOW * np.exp(-t / SLOW) - FAST * np.exp(-t / FAST)) / (SLOW - FAST))


def ramp_answer(times: NDArray[np.floating]) -> Floats:
    t = np.maximum(times - DELAY, 0.0)
    ends = SLOW**2 * (1.0 - np.exp(-t / SLOW)) - FAST**2 * (1.0 - np.exp(-t / FAST))
    return np.asarray(t - ends / (SLOW - FAST))


def answer_held(u: Floats) -> Floats:
    """Exact answer to an input that stays between samples, from rest at 0."""
    return np.convolve(np.diff(u, prepend=0.0), step_answer(np.arange(u.size) * STEP))[: u.size]


def answer_straight(u: Floats) -> Floats:
    """Exact answer to one that goes straight between samples, from rest at its first value 0."""
    slopes = np.diff(u, append=u[-1]) / STEP
    return np.convolve(np.diff(slopes, prepend=0.0), ramp_answer(STEP * np.arange(u.size)))[: u.size]


def prbs() -> Floats:
    """A sequence of greatest length, two samples a step."""
    return np.repeat(2.0 * max_len_seq(12)[0] - 1.0, 2)[:8000]


def multisine(count: int = 60) -> Floats:
    """Eight periods of sinusoids with random phases, none above 0.65 of half the sampling frequency."""
    period, draw = 750, np.random.default_rng(3)
    lines = np.unique(np.geomspace(3.0, 0.65 * period / 2.0, count).astype(int))
    phases = 2.0 * np.pi * (lines[:, None] * np.arange(8 * period) / period + draw.uniform(size=(lines.size, 1)))
    return np.asarray(np.cos(phases).sum(axis=0))


def estimated(u: Floats, y: Floats, between: Between | None = None) -> tuple[LoggedResponse, Floats]:
    """The estimate from records, and its true relative errors."""
    found = estimate_response(STEP * np.arange(u.size), u, y, names=("u", "y"), units=("1", "1"), between=between)
    return found, np.abs(found.response.values / exact_response(found.response.omega) - 1.0)


@pytest.mark.parametrize(
    ("record", "answer", "between"),
    [
        (prbs, answer_held, None),
        (multisine, answer_held, Between.HELD),
        (lambda: multisine(25), answer_held, Between.HELD),
        (multisine, answer_straight, Between.STRAIGHT),
    ],
    ids=["prbs", "multisine", "few-sines", "straight"],
)
def test_the_bias_bound_holds_and_is_no_more_than_it_must(
    record: Callable[[], Floats], answer: Callable[[Floats], Floats], between: Between | None
) -> None:
    """Without noise all error is bias. Near the top, where it is largest, the bound is at most ten times it; below a tenth it is small."""
    u = record()
    u = u - u[0] if between is Between.STRAIGHT else u
    found, errors = estimated(u, answer(u), between)
    omega = found.response.omega
    assert np.all(errors <= found.bias + 1e-9)
    assert np.max(errors[-5:]) >= 0.1 * np.max(found.bias[-5:])
    assert omega.size >= 18
    assert omega[-1] >= 0.3 * np.pi / STEP
    assert np.max(errors[omega < 0.1 * np.pi / STEP]) < 0.01
    assert np.max(found.bias) <= logged_response.MOST_BIAS
    assert found.known


def test_what_was_wrong_before() -> None:
    """Negative control: a held input read as smooth errs by half a sample and sinc, 25 % of magnitude and phase together and more."""
    u = prbs()
    found, errors = estimated(u, answer_held(u), Between.SMOOTH)
    turn = found.response.omega * STEP
    held = np.sinc(turn / (2.0 * np.pi)) * np.exp(-0.5j * turn)
    assert np.max(errors) > 0.25
    assert np.max(np.abs(found.response.values / (exact_response(found.response.omega) * held) - 1.0)) < 0.1


def test_noise_is_told_by_the_deviation() -> None:
    """Of 14 records with noise the scatter of the magnitude is the deviation that each tells."""
    u = prbs()
    y, draw = answer_held(u), np.random.default_rng(5)
    found = [estimated(u, y + draw.normal(0.0, 0.01, y.size))[0] for _ in range(14)]
    places = [0, 10, 20, 30]
    sizes = np.array([np.abs(entry.response.values[places]) for entry in found])
    told = np.mean([entry.deviation[places] for entry in found], axis=0)
    assert np.std(sizes, axis=0) / np.mean(sizes, axis=0) == pytest.approx(told, rel=0.6)
    assert min(float(entry.coherence.min()) for entry in found) >= 0.8
    assert max(entry.response.omega[-1] for entry in found) < 0.3 * np.pi / STEP


def test_a_known_filter_is_estimated_from_its_records() -> None:
    """A closed form: y[k] = y[k - 1] + a (u[k - 1] - y[k - 1]) has H = a/(exp(jw h) - 1 + a)."""
    draw, a = np.random.default_rng(3), 0.05
    u = draw.normal(size=10_000)
    y = np.zeros(u.size)
    for k in range(1, u.size):
        y[k] = y[k - 1] + a * (u[k - 1] - y[k - 1])
    found, _ = estimated(1e180 * u, 1e150 * y, Between.SMOOTH)
    exact = 1e-30 * a / (np.exp(1j * found.response.omega * STEP) - 1.0 + a)
    assert np.max(np.abs(found.response.values / exact - 1.0)) < 1e-3
    assert found.response.omega.size > 60
    with pytest.raises(AnalysisError, match="at no frequency does u explain y: the largest coherence is 0"):
        estimated(u, draw.normal(size=u.size))
    with pytest.raises(InvalidInputError, match="a record of 100 samples is too short"):
        estimated(u[:100], y[:100])


def test_a_course_that_is_not_known_widens_the_bound() -> None:
    u = multisine()
    unknown, _ = estimated(u, answer_straight(u))
    known, _ = estimated(u, answer_straight(u), Between.STRAIGHT)
    assert (unknown.between, unknown.known, known.known) == (Between.STRAIGHT, False, True)
    assert unknown.response.omega[-1] < known.response.omega[-1]
    shared = np.isin(known.response.omega, unknown.response.omega)
    lost = 1.0 / np.sinc(unknown.response.omega * STEP / (2.0 * np.pi)) ** 2 - 1.0
    assert unknown.bias - known.bias[shared] == pytest.approx(lost, abs=1e-6)


@pytest.mark.parametrize("between", [Between.HELD, Between.STRAIGHT])
def test_uneven_samples_widen_the_bound(between: Between) -> None:
    """The input changes at its samples, which lie up to a fifth of their distance off an even clock; the answer is exact."""
    draw = np.random.default_rng(6)
    u = np.append(0.0, draw.choice([-1.0, 1.0], 1399))
    times = STEP * (np.arange(u.size) + np.append(0.0, draw.uniform(-0.2, 0.2, u.size - 1)))
    since = times[:, None] - times
    if between is Between.HELD:
        y = step_answer(since) @ np.diff(u, prepend=0.0)
    else:
        slopes = np.append(np.diff(u) / np.diff(times), 0.0)
        y = ramp_answer(since) @ np.diff(slopes, prepend=0.0)
    found = estimate_response(times, u, y, names=("u", "y"), units=("1", "1"), between=between)
    errors = np.abs(found.response.values / exact_response(found.response.omega) - 1.0)
    assert np.all(errors <= found.bias + 4.0 * found.deviation)
    assert np.all(found.bias > 0.15 * found.response.omega * STEP)


@pytest.mark.parametrize("method", ["foh", "zoh"])
def test_behind_a_resonance_a_response_is_not_taken_to_fall_as_steeply_as_there(method: str) -> None:
    """A resonance within the last octave told: by the slope behind it the bound was 27 times too small."""
    draw = np.random.default_rng(8)
    u = np.repeat(draw.choice([-1.0, 1.0], 4000), 2) if method == "zoh" else draw.standard_normal(8000)
    slow = np.array([1.0 / 100.0**2, 2.0 * 0.03 / 100.0, 1.0])
    top, bottom, _ = cont2discrete(([1.0], slow), STEP, method=method)
    between = Between.HELD if method == "zoh" else Between.STRAIGHT
    found, _ = estimated(u, lfilter(np.ravel(top), bottom, u), between)
    errors = np.abs(found.response.values * np.polyval(slow, 1j * found.response.omega) - 1.0)
    assert np.all(errors <= found.bias + 4.0 * found.deviation)
    assert found.response.omega[-1] > 120.0


def closed_loop(command: Floats, disturbance: Floats) -> tuple[Floats, Floats]:
    """Control and output of a sampled PI controller around the exact plant, whose output is disturbed."""
    step, moves, u, y = step_answer(np.arange(command.size) * STEP), *np.zeros((3, command.size))
    held = 0.0
    for k in range(command.size):
        y[k] = disturbance[k] + moves[:k] @ step[k:0:-1]
        held += 4.0 * STEP * (command[k] - y[k])
        u[k] = 2.0 * (command[k] - y[k]) + held
        moves[k] = u[k] - (u[k - 1] if k else 0.0)
    return u, y


def test_under_feedback_the_command_tells_the_plant_or_nothing() -> None:
    """Disturbed, the records of a loop tell the controller turned round, with all their bounds; its command does not, or refuses."""
    draw, command = np.random.default_rng(5), np.repeat(2.0 * max_len_seq(9)[0] - 1.0, 12)[:6000]
    rough = np.convolve(draw.standard_normal(command.size), 0.9 ** np.arange(60))[: command.size]
    times = STEP * np.arange(command.size)

    def estimate(noise: float, told: Floats | None) -> tuple[LoggedResponse, Floats]:
        u, y = closed_loop(command, noise * rough)
        found = estimate_response(times, u, y, names=("u", "y"), units=("1", "1"), between=Between.HELD, command=told)
        return found, np.abs(found.response.values / exact_response(found.response.omega) - 1.0)

    for noise in (0.0, 0.05):
        found, errors = estimate(noise, command)
        assert found.response.omega.size > 30
        assert np.all(errors <= found.bias + 4.0 * found.deviation)
    found, errors = estimate(1.0, None)
    assert np.all(errors > found.bias + 4.0 * found.deviation)
    with pytest.raises(AnalysisError, match=r"at no frequency does the command explain u and y: the largest coherence is 0.33"):
        estimate(1.0, command)


RISING, MOVING = STEP * np.arange(300.0), prbs()[:300]


@pytest.mark.parametrize(
    ("times", "u", "command", "words"),
    [
        (RISING, MOVING[:-1], None, r"u has shape \(299,\) beside times of shape \(300,\); give columns of equal length"),
        (RISING, np.where(np.arange(300) == 5, np.nan, MOVING), None, "u = nan in sample 5; leave out what is not finite"),
        (RISING, MOVING, np.where(np.arange(300) == 7, np.inf, MOVING), "command = inf in sample 7"),
        (RISING, MOVING, np.zeros(300), "command does not move in this record"),
        (np.where(np.arange(300) == 5, RISING[4], RISING), MOVING, None, r"time does not rise after sample 4, at 0.04 s"),
    ],
    ids=["short", "nan", "infinite", "still", "repeated"],
)
def test_columns_that_are_none_are_refused(times: Floats, u: Floats, command: Floats | None, words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        estimate_response(times, u, MOVING, names=("u", "y"), units=("1", "1"), command=command)


def test_what_is_known_too_badly_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    u = prbs()
    monkeypatch.setattr(logged_response, "MOST_BIAS", 1e-9)
    with pytest.raises(AnalysisError, match="at no frequency is the response of y to u known within 1e-09 of it: the least bound is"):
        estimated(u, answer_held(u))


@pytest.mark.parametrize(
    ("values", "held"),
    [
        (prbs(), True),
        (np.repeat(np.random.default_rng(1).normal(size=100), 5), True),
        (multisine(), False),
        (np.interp(np.arange(1000.0), np.arange(0.0, 1001.0, 25.0), np.random.default_rng(1).choice([-1.0, 1.0], 41)), False),
        (np.zeros(300), False),
    ],
    ids=["two-levels", "stairs", "multisine", "ramps", "still"],
)
def test_held_inputs_are_recognised(values: Floats, held: bool) -> None:  # noqa: FBT001 - drawn by the table
    assert looks_held(values) is held


def test_the_deviation_is_that_of_the_errors() -> None:
    """Over some 1000 frequencies of records with noise, errors of the magnitude are as large as told: half the variance would give 1.41."""
    u, draw = draw_noise(11), np.random.default_rng(12)
    y, ratios = answer_held(u), []
    for _ in range(20):
        found, _ = estimated(u, y + draw.normal(0.0, 0.02, y.size), Between.HELD)
        errors = np.abs(found.response.values / exact_response(found.response.omega)) - 1.0
        ratios.append((errors / found.deviation)[found.bias < 0.5 * found.deviation])
    together = np.concatenate(ratios)
    assert together.size > 300
    assert np.sqrt(np.mean(together**2)) == pytest.approx(1.0, abs=0.12)


def draw_noise(seed: int) -> Floats:
    return np.random.default_rng(seed).standard_normal(8000)


def test_noise_is_seldom_taken_for_bias() -> None:
    """A response that does not change with the frequency has no bias: of noise one fit in 20, as exp(-3) says, is told one."""
    draw = np.random.default_rng(13)
    u, noise = draw.standard_normal((2, 400, 49, 2)).view(complex)[..., 0]
    told = [fit_locally(one, 2.0 * one + other, 24, 24).bias > 0.0 for one, other in zip(u, noise, strict=True)]
    assert np.mean(told) == pytest.approx(np.exp(-3.0), abs=0.03)


@pytest.mark.parametrize("between", [Between.HELD, Between.STRAIGHT])
def test_what_samples_cannot_tell_apart_is_summed_over_all_multiples(between: Between) -> None:
    """Closed form: the sum of 1/(x + k)^2 over all k is (pi/sin(pi x))^2; 60 on either side lack a hundredth of it."""
    part = np.linspace(0.01, 0.3, 60)
    omega = 2.0 * np.pi / STEP * part
    sizes = 1.0 / omega if between is Between.HELD else np.ones(60)
    others = (np.pi / np.sin(np.pi * part)) ** 2 - 1.0 / part**2
    top = float(np.max(sizes[omega >= logged_response.NEAR_TOP * omega[-1]])) / sizes
    expected = top * others * part * (part[-1] if between is Between.HELD else part)
    assert _aliases(omega, sizes, STEP, between) == pytest.approx(expected, rel=0.015)


def test_uneven_samples_may_lose_what_straight_lines_lose() -> None:
    """Halfway between samples a straight line has cos(turn/2) of a sinusoid; both records were interpolated."""
    turn = np.linspace(0.1, 1.9, 19)
    beside = _uncertain(turn, Between.STRAIGHT, True, 0.01) - 0.01 * turn  # noqa: FBT003 - a fact, not a mode
    assert np.all(beside >= 2.0 * (1.0 - np.cos(0.5 * turn)))
    assert np.all(beside <= 1.1 * 2.0 * (1.0 - np.cos(0.5 * turn)))
    assert _uncertain(turn, Between.STRAIGHT, True, 0.5 * logged_response.EVEN).tolist() == [0.0] * 19  # noqa: FBT003 - a fact, not a mode
