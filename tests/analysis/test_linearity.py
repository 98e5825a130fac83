import math

import numpy as np
import pytest

from revline.analysis.linearity import LinearityPoint, LinearityVerdict, judge_linearity
from revline.analysis.periodic import Excitation
from revline.analysis.sinestream import Sinestream, find_sinestream
from revline.analysis.spectrum import SpectralCheck, find_spectrum
from revline.analysis.trim import find_trim
from revline.errors import InvalidInputError
from revline.system import DelaySystem


def check(omega: float, peak: float, distortion: float = 0.0) -> SpectralCheck:
    times = np.linspace(0.0, 16.0 * math.pi / omega, 512, endpoint=False)
    spectrum = find_spectrum(times, np.sin(peak * times), initial=0.0)
    return SpectralCheck(omega=omega, spectrum=spectrum, cycles=8, distortion=distortion, remaining=0.0)


@pytest.fixture(scope="module")
def stream(wiener: DelaySystem) -> Sinestream:
    """Distortion 0.1 a / 1.2 with a = 1.5 / hypot(1, omega / 3): 12.4 % at 0.1 rad/s, 10.4 % at 2, 4.2 % at 8, 1.2 % at 30."""
    trim = find_trim(wiener, inputs={"force": 0.5})
    excitation = Excitation(input_name="force", output_name="bent", amplitude=1.5)
    return find_sinestream(wiener, trim, excitation, [0.1, 2.0, 8.0, 30.0])


def test_distortion_bounds_the_range(stream: Sinestream) -> None:
    verdict = judge_linearity([stream])
    assert not verdict.follows
    assert verdict.ranges == ((8.0, 30.0),)
    assert (verdict.low, verdict.high, verdict.where) == (0.1, 30.0, 0.1)
    assert verdict.largest_distortion == pytest.approx(0.125 / math.hypot(1.0, 0.1 / 3.0), rel=1e-5)
    assert [point.omega for point in verdict.failures] == [0.1, 2.0]
    assert verdict.text == (
        "is not linear at 2 of 4 frequencies from 0.1 to 30 rad/s: distortion is 12 % at most, at 0.1 rad/s (limit 5 %); "
        "another line than the input's is highest at none of them; it is linear from 8 to 30 rad/s"
    )


def test_a_wider_limit_lets_all_pass(stream: Sinestream) -> None:
    verdict = judge_linearity([stream], distortion_limit=0.2)
    assert verdict.follows
    assert verdict.failures == ()
    assert verdict.ranges == ((0.1, 30.0),)
    assert verdict.text.startswith("follows the input's frequency from 0.1 to 30 rad/s, at all 4 frequencies looked at: distortion is 12 %")


def test_one_frequency_alone_has_its_own_words() -> None:
    assert judge_linearity(checks=[check(2.0, 2.0, 0.01)]).text == (
        "follows the only frequency looked at: distortion is 1 % at most, at 2 rad/s (limit 5 %)"
    )
    assert judge_linearity(checks=[check(2.0, 4.0, 0.01)]).text == (
        "is not linear at the only frequency looked at: another line than the input's is highest, "
        "distortion is 1 % at most, at 2 rad/s (limit 5 %)"
    )


def test_a_narrower_limit_lets_none_pass(stream: Sinestream) -> None:
    verdict = judge_linearity([stream], distortion_limit=0.001)
    assert verdict.ranges == ()
    assert verdict.text.endswith("it is linear nowhere")


def test_a_spectrum_that_does_not_follow_splits_the_range(stream: Sinestream) -> None:
    checks = [check(0.05, 0.05), check(2.0, 4.0), check(60.0, 60.0)]
    verdict = judge_linearity([stream], checks, distortion_limit=0.2)
    assert not verdict.follows
    assert verdict.ranges == ((0.05, 0.1), (8.0, 60.0))
    assert [point.omega for point in verdict.failures] == [2.0]
    assert verdict.failures[0].distortion == pytest.approx(stream.distortion[1])
    assert "another line than the input's is highest at 1" in verdict.text
    assert "from 0.05 to 0.1 rad/s and 8 to 60 rad/s" in verdict.text


def test_the_larger_distortion_of_two_sources_counts() -> None:
    verdict = judge_linearity(checks=[check(1.0, 1.0, 0.01), check(1.0, 1.0, 0.03)])
    assert verdict.points == (LinearityPoint(omega=1.0, distortion=0.03, follows=True),)


def test_a_harmonic_above_the_fundamental_does_not_follow(wiener: DelaySystem) -> None:
    rest = find_trim(wiener, inputs={"force": 0.02})
    excitation = Excitation(input_name="force", output_name="square", amplitude=0.5)
    verdict = judge_linearity([find_sinestream(wiener, rest, excitation, [2.0])], distortion_limit=0.99)
    assert not verdict.points[0].follows


def test_nothing_to_judge_by_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="no frequencies to judge linearity by"):
        judge_linearity()


@pytest.mark.parametrize("limit", [0.0, 1.0, math.nan])
def test_limits_outside_zero_to_one_are_refused(limit: float) -> None:
    points = (LinearityPoint(omega=1.0, distortion=0.0, follows=True),)
    with pytest.raises(InvalidInputError, match=r"distortion limit = .* of the fundamental is outside 0 to 1"):
        LinearityVerdict(points=points, distortion_limit=limit)
