"""Our half of the comparison with python-control, without python-control: every loop's margins by an independent formula."""

import math
import sys
from types import ModuleType

import pytest

from tests.benchmarks.loading import load_script


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("margins_against_python_control")


@pytest.mark.parametrize("number", range(4))
def test_our_margins_are_those_of_the_formula(script: ModuleType, number: int) -> None:
    case = script.make_cases()[number]
    script.check(case, script.true_margins(case.loop))


@pytest.mark.parametrize("number", [0, 1])
def test_the_formula_gives_the_closed_form(script: ModuleType, number: int) -> None:
    """Two kinds of error: of bisection's own margins, relative and in degrees."""
    case, exact = script.make_cases()[number], script.CLOSED_FORMS[number]
    assert max(script.errors(script.true_margins(case.loop), exact)) <= 1e-10


@pytest.mark.parametrize(("gain", "phase", "what"), [(1.0 + 1e-8, 0.0, "gain margin"), (1.0, 1e-8, "phase margin")])
def test_a_wrong_margin_is_not_timed(script: ModuleType, gain: float, phase: float, what: str) -> None:
    case = script.make_cases()[1]
    exact = script.CLOSED_FORMS[1]
    with pytest.raises(RuntimeError, match=f"our {what} is off by 1e-08, more than 1e-09"):
        script.check(case, script.Truth(exact.gain * gain, exact.phase_deg + phase))


def test_a_margin_that_only_one_has_is_an_error(script: ModuleType) -> None:
    finite, infinite = script.Truth(2.0, 30.0), script.Truth(2.0, math.inf)
    assert script.errors(finite, infinite) == (0.0, math.inf)
    assert script.errors(infinite, infinite) == (0.0, 0.0)


def test_a_missing_peer_is_named(script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    monkeypatch.setattr(sys, "argv", ["benchmark"])
    assert script.main() == 2
    assert "make .venv/.bench installs the peers" in capsys.readouterr().err
