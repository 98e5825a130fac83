"""Roots of many systems at once: the same as one by one, and one that fails spoils no other."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from revline.errors import AnalysisError, RevlineError
from revline.lti import root_batches
from revline.lti.feedback import FeedbackBlock, feedback_blocks, stack_blocks
from revline.lti.root_batches import characteristic_roots_each
from revline.lti.roots import Listed, RightmostRoots, characteristic_roots, refine_roots
from revline.lti.state_space import DelayStateSpace

Build = Callable[..., DelayStateSpace]


def drawn_systems(build: Build) -> list[DelayStateSpace]:
    """One delay, stable and not; two delays; no delay in a loop; a lag too long for the first degrees; a root on the axis."""
    random = np.random.default_rng(3)
    found = [
        build([random.uniform(0.05, 1.0)], A=random.normal(size=(2, 2)), Bz=random.normal(size=(2, 1)), Cz=random.normal(size=(1, 2)))
        for _ in range(40)
    ]
    found.append(build([1.0, 2.0], A=0.0, Bz=[[-1.0, -0.5]], Cz=[[1.0], [1.0]]))
    found.append(build([0.5], A=[[-1.0, 0.0], [0.0, -2.0]], Bz=[[0.0], [1.0]], Cz=[[1.0, 0.0]]))
    found.append(build([40.0], A=-0.1, Bz=[[-3.0]], Cz=[[1.0]]))
    found.append(build([0.5 * np.pi], A=0.0, Bz=[[-1.0]], Cz=[[1.0]]))
    found.append(build([0.7, 0.3], A=-0.2, Bz=[[0.0, -1.5]], Cz=[[1.0], [0.0]], Dzz=[[0.0, 0.0], [1.0, 0.0]]))
    return found


def test_many_at_once_are_as_one_by_one(build: Build) -> None:
    systems = drawn_systems(build)
    counts = set()
    for system, found in zip(systems, characteristic_roots_each(systems), strict=True):
        alone = characteristic_roots(system)
        assert isinstance(found, RightmostRoots)
        counts.add(found.unstable_count)
        assert (found.unstable_count, found.stable, found.degree) == (alone.unstable_count, alone.stable, alone.degree)
        assert found.roots == pytest.approx(alone.roots, rel=1e-12, abs=1e-12)
        assert np.all(found.residuals <= 1e-12)
    assert len(counts) > 2


def test_one_that_has_no_answer_spoils_no_other(build: Build) -> None:
    """Channels that feed one another at a gain of 1.5 without a state have no right-most root."""
    good = build([1.0], A=-1.0, Bz=[[-1.0]], Cz=[[1.0]])
    bad = build([1.0], A=-1.0, Bz=[[-1.0]], Cz=[[1.0]], Dzz=[[1.5]])
    first, second, third = characteristic_roots_each([good, bad, replace(good)])
    assert isinstance(second, RevlineError)
    assert isinstance(first, RightmostRoots)
    assert isinstance(third, RightmostRoots)
    assert first.roots.tolist() == third.roots.tolist()
    with pytest.raises(AnalysisError, match="gain of 1 or more") as caught:
        characteristic_roots(bad)
    assert str(caught.value) == str(second)


def test_roots_right_of_a_line_are_counted_for_many(build: Build) -> None:
    """Also where the line passes so near a root that its neighbourhood must be looked at closely; on a root there is no number."""
    blocks: list[FeedbackBlock] = [block for system in drawn_systems(build)[:40] for block in feedback_blocks(system) if block.lags.size]
    roots = [characteristic_roots(system).roots for system in drawn_systems(build)[:40]]
    lines = np.array([entry.real[0] - 1e-6 * (1.0 + abs(entry[0])) for entry in roots])
    counts = stack_blocks(blocks).count_right_of_each(lines)
    assert counts.tolist() == [int(np.sum(entry.real > line)) for entry, line in zip(roots, lines, strict=True)]
    assert counts.tolist() == [block.count_right_of(float(line)) for block, line in zip(blocks, lines, strict=True)]
    lines[7] = roots[7].real[0]
    again = stack_blocks(blocks).count_right_of_each(lines)
    assert np.flatnonzero(again != counts).tolist() in ([7], [])


def test_no_degree_is_looked_at_twice(build: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """More unstable roots than are listed are counted alone, with what was found together."""
    looked: list[tuple[float, int]] = []

    def noted(blocks: FeedbackBlock, degree: int, count: int) -> list[Listed]:
        looked.extend((float(lags[0]), degree) for lags in blocks.lags)
        return refine_roots(blocks, degree, count)

    monkeypatch.setattr("revline.lti.root_batches.refine_roots", noted)
    monkeypatch.setattr("revline.lti.roots.refine_roots", noted)
    found = characteristic_roots_each([build([lag], A=-0.1, Bz=[[-3.0]], Cz=[[1.0]]) for lag in (0.5, 200.0)])
    assert [entry.unstable_count > 6 for entry in found if isinstance(entry, RightmostRoots)] == [False, True]
    assert len(looked) == len(set(looked))


def test_entries_beyond_all_numbers_spoil_no_other(build: Build) -> None:
    good, large = build([1.0], A=-1.0, Bz=[[-1.0]], Cz=[[1.0]]), build([1.0], A=-1.0, Bz=[[-1e300]], Cz=[[1e300]])
    first, second = characteristic_roots_each([good, large])
    assert isinstance(first, RightmostRoots)
    assert isinstance(second, AnalysisError)
    with pytest.raises(AnalysisError, match="gains whose product exceeds the range of numbers; choose other units"):
        characteristic_roots(large)


@pytest.mark.parametrize(("gain", "lost", "unstable"), [(1.0, 0, 0), (3.0, 0, 2), (10.0, 0, 4), (10.0, 1, 4)])
def test_what_the_argument_principle_contradicts_is_looked_at_alone(
    build: Build, gain: float, lost: int, unstable: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """s + gain exp(-s) has its roots in pairs; where both degrees lose the first or second of them in the same way, the count tells."""
    system = build([1.0], A=0.0, Bz=[[-gain]], Cz=[[1.0]])

    def losing(blocks: FeedbackBlock, degree: int, count: int) -> list[Listed]:
        kept = [np.delete(np.arange(entry.roots.size), [2 * lost, 2 * lost + 1]) for entry in refine_roots(blocks, degree, count)]
        found = zip(refine_roots(blocks, degree, count), kept, strict=True)
        return [Listed(roots=e.roots[rows], residuals=e.residuals[rows], errors=e.errors[rows]) for e, rows in found]

    monkeypatch.setattr(root_batches, "refine_roots", losing)
    (found,) = characteristic_roots_each([system])
    assert isinstance(found, RightmostRoots)
    assert found.unstable_count == unstable
    assert found.roots == pytest.approx(characteristic_roots(system).roots, rel=1e-12)
