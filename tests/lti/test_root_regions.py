"""All roots in a region: closed forms by Lambert's function, proven counts, and what cannot be told."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import lambertw

from revline.errors import AnalysisError, InvalidInputError, NotConvergedError
from revline.lti import root_regions
from revline.lti.root_regions import Region, find_roots_in
from revline.lti.roots import RightmostRoots, characteristic_roots
from revline.lti.state_space import DelayStateSpace

Build = Callable[..., DelayStateSpace]


def lambert_roots(a: float, b: float, lag: float) -> np.ndarray:
    """s = a + W_k(b lag exp(-a lag)) / lag. Source: Corless et al. (1996), section 2."""
    found = np.asarray(a + lambertw(b * lag * math.exp(-a * lag), np.arange(-80, 81)) / lag)
    return found[np.argsort(-found.real, kind="stable")]


@pytest.mark.parametrize("edge", [-0.5, -2.0, -3.1, -3.6])
@pytest.mark.parametrize(("a", "b", "lag"), [(0.0, -1.0, 1.0), (-0.7, 1.9, 0.8), (0.3, -2.0, 1.3), (-3.0, 0.5, 0.4)])
def test_all_roots_right_of_a_line(build: Build, a: float, b: float, lag: float, edge: float) -> None:
    left = edge / lag
    exact = lambert_roots(a, b, lag)
    exact = exact[exact.real > left]
    found = find_roots_in(build([lag], A=a, Bz=b, Cz=1.0), Region(left=left))
    assert (found.counted, found.roots.size) == (exact.size, exact.size)
    for root in exact:
        assert np.min(np.abs(found.roots - root)) < 1e-10
    assert found.spectral_abscissa == (pytest.approx(exact[0].real, abs=1e-10) if exact.size else left)


def test_roots_within_a_rectangle(build: Build) -> None:
    exact = lambert_roots(0.0, -3.0, 1.0)
    region = Region(left=-3.0, right=0.5, bottom=5.0, top=21.0)
    wanted = [s for s in exact if -3.0 < s.real < 0.5 and 5.0 < s.imag < 21.0]
    found = find_roots_in(build([1.0], A=0.0, Bz=-3.0, Cz=1.0), region)
    assert len(wanted) == 3
    assert sorted(found.roots, key=abs) == pytest.approx(sorted(wanted, key=abs), abs=1e-10)
    assert found.counted == int(np.sum(exact.real > -3.0))
    assert found.errors.shape == found.roots.shape


def test_systems_without_delay_and_without_roots(build: Build) -> None:
    assert find_roots_in(build([], A=[[-1.0, 2.0], [-2.0, -1.0]]), Region(left=-3.0)).roots == pytest.approx([-1.0 + 2.0j, -1.0 - 2.0j])
    assert find_roots_in(build([2.0], Dzu=1.0, Dyz=1.0), Region(left=-3.0)).roots.size == 0


@pytest.mark.parametrize("edges", [(math.nan,), (-math.inf,), (1.0, 0.0), (0.0, 1.0, 2.0, 2.0)])
def test_regions_that_are_none_are_refused(edges: tuple[float, ...]) -> None:
    with pytest.raises(InvalidInputError, match=r"a region from .* cannot be searched; give a finite left edge, and edges that rise"):
        Region(**dict(zip(("left", "right", "bottom", "top"), edges, strict=False)))


def test_roots_on_an_edge_are_not_told(build: Build) -> None:
    system = build([1.0], A=0.0, Bz=-0.5 * math.pi, Cz=1.0)
    with pytest.raises(NotConvergedError, match="one lies on that line"):
        find_roots_in(system, Region(left=0.0))
    with pytest.raises(NotConvergedError, match=r"the root .*1\.5708j rad/s lies on the region's edge at 1\.5708 rad/s; move that edge"):
        find_roots_in(system, Region(left=-0.5, top=0.5 * math.pi))


def test_roots_without_number_are_refused(build: Build) -> None:
    """Negative control of the count: z = -z(t - 1)/2 has all its roots at one real part, ln(1/2)."""
    with pytest.raises(AnalysisError, match="feed one another in a loop with a gain of 1 or more"):
        find_roots_in(build([1.0], Dzz=-0.5), Region(left=-1.0))


def test_too_many_roots_are_refused(build: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(root_regions, "MOST_ROOTS", 2)
    with pytest.raises(InvalidInputError, match=r"\d+ roots lie right of -4 rad/s, more than the 2 that are listed"):
        find_roots_in(build([1.0], A=0.0, Bz=-1.0, Cz=1.0), Region(left=-4.0))


def test_a_root_that_is_missed_is_noticed(build: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: a list without its last pair does not pass for all roots."""

    def forgetful(system: DelayStateSpace, *, count: int) -> RightmostRoots:
        return characteristic_roots(system, count=count - 2)

    monkeypatch.setattr(root_regions, "characteristic_roots", forgetful)
    with pytest.raises(NotConvergedError, match=r"4 roots were found right of -3 rad/s where 6 are counted"):
        find_roots_in(build([1.0], A=0.0, Bz=-1.0, Cz=1.0), Region(left=-3.0))
