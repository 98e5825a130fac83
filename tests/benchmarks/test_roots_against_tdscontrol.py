"""Our half of the comparison with tdscontrol, without tdscontrol: roots by the determinant, and that wrong lists are not timed."""

import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from revline.lti.roots import characteristic_roots
from tests.benchmarks.loading import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("roots_against_tdscontrol")


@pytest.fixture(scope="module")
def cases(script: ModuleType) -> Any:
    return script.make_cases()


COUNTS = (4, 14, 3)
"""Of roots in the half plane of each case."""


@pytest.mark.parametrize("number", range(3))
def test_our_roots_are_those_of_the_determinant(script: ModuleType, cases: Any, number: int) -> None:
    own = characteristic_roots(cases[number].system, count=COUNTS[number] + 1)
    inside = own.roots[own.roots.real > cases[number].right_of]
    assert inside.size == COUNTS[number]
    assert script.check(cases[number], own, np.concatenate((inside, inside[:2]))) == 0.0


def test_the_thesiss_c1_is_unstable_on_the_engine_and_c2d_is_not(cases: Any) -> None:
    """Source of the fact: Lee (1995), chapter 5; the roots stand in the determinant too."""
    abscissas = [characteristic_roots(case.system).spectral_abscissa for case in cases]
    assert [abscissa > 0.0 for abscissa in abscissas] == [False, False, True]


def test_a_root_that_is_none_is_noticed(script: ModuleType, cases: Any) -> None:
    roots = characteristic_roots(cases[0].system, count=5).roots[:4]
    assert np.max(script.newton_steps(cases[0], roots)) <= 1e-10
    shifted = script.newton_steps(cases[0], roots * (1.0 + 1e-7))
    assert shifted == pytest.approx(1e-7 * np.abs(roots) / (1.0 + np.abs(roots)), rel=1e-2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda roots: roots[1:], "tdscontrol finds 3 roots right of -310 rad/s, revline 4"),
        (lambda roots: roots + np.array([0.01, 0.0, 0.0, 0.0]), r"tdscontrol's root -2\.06.* is none of ours, off by 0\.003"),
    ],
)
def test_a_list_that_differs_is_not_timed(script: ModuleType, cases: Any, change: Any, message: str) -> None:
    own = characteristic_roots(cases[0].system, count=5)
    with pytest.raises(RuntimeError, match=message):
        script.check(cases[0], own, change(own.roots[own.roots.real > -310.0]))


def test_a_list_that_ends_too_early_is_noticed(script: ModuleType, cases: Any) -> None:
    own = characteristic_roots(cases[0].system, count=2)
    with pytest.raises(RuntimeError, match="revline's list ends within the half plane right of -310; ask for more roots"):
        script.check(cases[0], own, own.roots)


def test_another_systems_roots_are_no_roots_of_the_determinant(script: ModuleType, cases: Any) -> None:
    own = characteristic_roots(cases[1].system, count=15)
    with pytest.raises(RuntimeError, match=r"engine with C1: .* is no root of the determinant: Newton moves it by"):
        script.check(cases[2], own, own.roots)


def test_a_missing_peer_is_named(script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "tdscontrol", None)
    monkeypatch.setattr(sys, "argv", ["benchmark"])
    assert script.main() == 2
    assert "make .venv/.bench installs the peers" in capsys.readouterr().err
