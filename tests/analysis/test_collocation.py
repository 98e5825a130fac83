"""Fourier collocation: exact for every harmonic that it holds, and for none beyond."""

import numpy as np
import pytest

from revline.analysis.collocation import collocation, refine
from revline.errors import InvalidInputError

PHASES = np.linspace(-7.0, 20.0, 50)


@pytest.mark.parametrize("harmonics", [1, 2, 8, 13])
def test_every_harmonic_is_read_and_differentiated_exactly(harmonics: int) -> None:
    mesh = collocation(harmonics)
    for m in range(harmonics + 1):
        samples = 0.7 * np.cos(m * mesh.phases) + 0.4 * np.sin(m * mesh.phases)
        slope = -0.7 * m * np.sin(m * mesh.phases) + 0.4 * m * np.cos(m * mesh.phases)
        assert mesh.derivative @ samples == pytest.approx(slope, abs=1e-12 * (1 + m) ** 2)
        read = (mesh.waves(PHASES) @ mesh.coefficients(samples[:, None])).real[:, 0]
        assert read == pytest.approx(0.7 * np.cos(m * PHASES) + 0.4 * np.sin(m * PHASES), abs=1e-12)


def test_a_harmonic_beyond_is_taken_for_another() -> None:
    """Negative control: were this to be exact too, the test above would prove nothing."""
    mesh = collocation(4)
    read = (mesh.waves(PHASES) @ mesh.coefficients(np.cos(5 * mesh.phases)[:, None])).real[:, 0]
    assert np.max(np.abs(read - np.cos(5 * PHASES))) > 0.5
    assert read == pytest.approx(np.cos(4 * PHASES), abs=1e-12)


def test_waves_are_the_exponentials() -> None:
    waves = collocation(37).waves(PHASES)
    assert waves == pytest.approx(np.exp(1j * np.outer(PHASES, np.arange(38))), abs=1e-12)


def test_refining_keeps_the_curve() -> None:
    coarse, fine = collocation(3), collocation(11)
    curve = np.exp(np.cos(coarse.phases))
    refined = refine(curve[None, :, None], coarse, fine)
    assert refined.shape == (1, fine.count, 1)
    assert fine.coefficients(refined)[0, :4, 0] == pytest.approx(coarse.coefficients(curve[:, None])[:, 0], abs=1e-14)
    assert np.max(np.abs(fine.coefficients(refined)[0, 4:, 0])) < 1e-14


def test_no_harmonic_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"harmonics = 0 .*1 and above"):
        collocation(0)
