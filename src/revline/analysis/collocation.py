"""Fourier collocation on one period: equispaced samples, their derivative, and reading between them.

The number of samples is odd, so that harmonics 0 to H have their sine and their cosine each: no harmonic is half there.

Source: Trefethen (2000), Spectral Methods in MATLAB, chapter 3.
"""

import functools
from dataclasses import dataclass

import numpy as np

from revline.errors import out_of_range
from revline.lti.response import Complexes
from revline.system import Floats
from revline.values import make_read_only

BLOCK = 16384
"""Values of waves that are computed at once: more do not fit the processor's cache, and take twice as long."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Collocation:
    """Samples of one period at equal distances, exact for all harmonics up to the highest.

    Attributes:
        harmonics: number of the highest harmonic, H; there are N = 2 H + 1 samples.
        phases: of the samples, in rad, from 0 on, shape (N,).
        derivative: takes samples to the samples of their derivative by the phase, shape (N, N).
        analysis: takes samples to coefficients c of sum c_m exp(j m phase), m = 0 to H, its real part being meant, shape (N, H + 1).
        parts: the same in real numbers: takes samples to the real parts of c and the negative imaginary ones in turn, shape (2 H + 2, N).
    """

    harmonics: int
    phases: Floats
    derivative: Floats
    analysis: Complexes
    parts: Floats

    def __post_init__(self) -> None:
        make_read_only(self)

    @property
    def count(self) -> int:
        """Number of samples."""
        return 2 * self.harmonics + 1

    def coefficients(self, samples: Floats) -> Complexes:
        """Find harmonics: samples along the last axis but one to coefficients along it."""
        found: Complexes = self.analysis.T @ samples
        return found

    def weights(self, waves: Complexes) -> Floats:
        """Give what each sample counts for in the values at the phases of some waves, along the last axis in place of harmonics."""
        flat = waves.view(float).reshape(-1, self.parts.shape[0])
        found: Floats = (flat @ self.parts).reshape(*waves.shape[:-1], self.count)
        return found

    def read_each(self, waves: Complexes, samples: Floats) -> Floats:
        """Read signals each at phases of its own: waves of shape (n, P, K, H + 1) of samples (n, N, K) to values (n, P, K)."""
        signals = np.swapaxes(self.parts @ samples, 1, 2)[..., None]
        found: Floats = np.swapaxes((np.swapaxes(waves.view(float), 1, 2) @ signals)[..., 0], 1, 2)
        return found

    def waves(self, phases: Floats) -> Complexes:
        """Give exp(j m phase) of all harmonics, along a new last axis.

        Computed as powers of exp(j phase) by repeated doubling of the list, which costs one cosine and one sine per phase.
        """
        flat = phases.ravel()
        block = max(1, BLOCK // (self.harmonics + 1))
        found = np.empty((flat.size, self.harmonics + 1), dtype=complex)
        for start in range(0, flat.size, block):
            found[start : start + block] = self._powers(flat[start : start + block]).T
        return found.reshape(*phases.shape, self.harmonics + 1)

    def _powers(self, phases: Floats) -> Complexes:
        """Give exp(j m phase), the harmonics along the first axis, so that each product runs over all phases in one go."""
        powers = np.empty((self.harmonics + 1, phases.size), dtype=complex)
        powers[0] = 1.0
        np.cos(phases, out=powers[1].real)
        np.sin(phases, out=powers[1].imag)
        have = 2
        while have <= self.harmonics:
            more = min(have - 1, self.harmonics + 1 - have)
            np.multiply(powers[1 : 1 + more], powers[have - 1], out=powers[have : have + more])
            have += more
        return powers


@functools.lru_cache(maxsize=16)
def collocation(harmonics: int) -> Collocation:
    """Lay out the samples for a number of harmonics.

    Raises:
        InvalidInputError: the number is below 1.
    """
    if harmonics < 1:
        raise out_of_range("harmonics", harmonics, "", "1 and above", "give the number of the highest harmonic")
    count = 2 * harmonics + 1
    phases = 2.0 * np.pi * np.arange(count) / count
    numbers = np.arange(harmonics + 1)
    weights = np.where(numbers == 0, 1.0, 2.0) / count
    analysis = np.exp(-1j * np.outer(phases, numbers)) * weights
    derivative = ((1j * numbers * np.exp(1j * np.outer(phases, numbers))) @ analysis.T).real
    parts = np.stack((analysis.real, -analysis.imag), axis=-1).reshape(count, -1).T.copy()
    return Collocation(harmonics=harmonics, phases=phases, derivative=derivative, analysis=analysis, parts=parts)


def refine(samples: Floats, coarse: Collocation, fine: Collocation) -> Floats:
    """Read samples at the phases of a finer collocation; samples along the last axis but one."""
    waves = coarse.waves(fine.phases)
    read: Floats = np.einsum("fm,...mk->...fk", waves, coarse.coefficients(samples)).real
    return read
