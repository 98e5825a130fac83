"""Families of limit cycles from their onset, against normal forms with known branches."""

from typing import NamedTuple

import numpy as np
import pytest

from revline.analysis import cycle_branches
from revline.analysis.cycle_branches import BranchAxes, Onset, follow_cycles
from revline.analysis.forced_orbits import FIRST_HARMONICS
from revline.equations import equation
from revline.errors import InvalidInputError, NotConvergedError
from revline.system import DelaySystem, Variable

Vector = tuple[float, ...]
AXES = BranchAxes(parameter=0, watched=0)


class Shape(NamedTuple):
    """Radial law: r' = (u - u0) r + cubic r^3 + fifth r^5, turning at 1 + twist r^2."""

    cubic: float
    fifth: float
    twist: float


@equation
def spiral(p: Shape, x: Vector, u: Vector, zd: Vector) -> Vector:
    square = x[0] * x[0] + x[1] * x[1]
    pull = u[0] - 1.0 + p.cubic * square + p.fifth * square * square + 0.0 * zd[0]
    turn = 1.0 + p.twist * square
    return pull * x[0] - turn * x[1], pull * x[1] + turn * x[0]


@equation
def first(p: Shape, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (x[0],)


@equation
def outputs(p: Shape, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return x[0], u[0], zd[0]


@equation
def lag(p: Shape, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    return (0.5,)


@equation
def delayed(p: Shape, x: Vector, u: Vector, zd: Vector) -> Vector:  # noqa: ARG001 - the form of all equations
    """x' = -u sin(x(t - 0.5)) on the first state; the second follows it."""
    return -u[0] * np.sin(zd[0]), x[0] - x[1]


@equation
def beside(p: Shape, x: Vector, u: Vector, zd: Vector) -> Vector:
    """A spiral on the first two states; the third goes to a constant that no binary number is."""
    return *spiral(p, x, u, zd), 0.3 - x[2]


def build(rate: object, shape: Shape, names: tuple[str, ...] = ("across", "along")) -> DelaySystem:
    return DelaySystem(
        name="family",
        parameters=shape,
        states=tuple(Variable(name=name, unit="m", search_low=-3.0, search_high=3.0) for name in names),
        inputs=(Variable(name="gain", unit="1"),),
        channels=(Variable(name="echo", unit="m"),),
        outputs=tuple(Variable(name=name, unit="m") for name in ("seen", "given", "heard")),
        emit=first,
        lags=lag,
        rate=rate,  # type: ignore[arg-type]  # a plain function; its exact signature does not matter here
        output=outputs,
    )


BEGIN = Onset(states=np.zeros(2), inputs=np.array([1.0]), frequency=1.0)


@pytest.mark.parametrize("watched", [0, 2])
def test_a_hard_onset_and_its_fold_are_followed(watched: int) -> None:
    """u = 1 - cubic a^2 - fifth a^4: with cubic 1 and fifth -1 the family falls, and turns at a^2 = 1/2, u = 3/4."""
    system = build(spiral, Shape(1.0, -1.0, 0.4))
    amplitudes = np.array([0.05, 0.2, 0.5, np.sqrt(0.5), 0.9, 1.2])
    found = follow_cycles(system, BEGIN, BranchAxes(parameter=0, watched=watched), amplitudes)
    assert [point.parameter for point in found] == pytest.approx(1.0 - amplitudes**2 + amplitudes**4, abs=1e-9)
    assert [point.cycle.orbit.omega for point in found] == pytest.approx(1.0 + 0.4 * amplitudes**2, rel=1e-9)


def test_a_delayed_family_begins_softly_with_its_known_curvature() -> None:
    """x' = -u sin x(t - T) at u T = pi/2: by balancing the fundamental, u = (pi/2T) a / (2 J1(a)) to second order, pi/2T (1 + a^2/8)."""
    system = build(delayed, Shape(0.0, 0.0, 0.0))
    onset = Onset(states=np.zeros(2), inputs=np.array([np.pi]), frequency=np.pi)
    amplitudes = np.array([0.05, 0.1])
    found = follow_cycles(system, onset, AXES, amplitudes)
    rises = (np.array([point.parameter for point in found]) / np.pi - 1.0) / amplitudes**2
    assert rises == pytest.approx([0.125, 0.125], rel=5e-3)
    assert [point.cycle.period for point in found] == pytest.approx([2.0, 2.0], rel=1e-9)  # four lags: odd feedback


def test_a_state_that_rests_asks_for_no_harmonics() -> None:
    """What rounding leaves of a resting state is no oscillation: the family is as well known as without it."""
    system = build(beside, Shape(-1.0, 0.0, 0.0), ("across", "along", "aside"))
    onset = Onset(states=np.array([0.0, 0.0, 0.3]), inputs=np.array([1.0]), frequency=1.0)
    for point in follow_cycles(system, onset, AXES, np.array([0.1, 0.4])):
        assert point.parameter == pytest.approx(1.0 + point.amplitude**2, abs=1e-9)
        assert point.cycle.orbit.harmonics == FIRST_HARMONICS
        assert point.cycle.error < cycle_branches.TAIL


def test_a_family_that_ends_is_given_as_far_as_it_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    system = build(spiral, Shape(-1.0, 0.0, 0.0))
    keep = cycle_branches._Family.solve  # noqa: SLF001 - the solver is made to fail beyond an amplitude

    def fail(self: object, member: object, amplitude: float) -> object:
        return None if amplitude > 0.3 else keep(self, member, amplitude)  # type: ignore[arg-type]  # passed on as it came

    monkeypatch.setattr(cycle_branches._Family, "solve", fail)  # noqa: SLF001 - as above
    assert len(follow_cycles(system, BEGIN, AXES, np.array([0.1, 0.2, 0.5]))) == 2
    with pytest.raises(NotConvergedError, match=r"no cycle of family with an amplitude of 0\.4 m is found at its onset, 1 rad/s"):
        follow_cycles(system, BEGIN, AXES, np.array([0.4]))


def test_what_is_refused() -> None:
    system = build(spiral, Shape(-1.0, 0.0, 0.0))
    for amplitudes in (np.array([]), np.array([0.0, 0.1]), np.array([0.2, 0.1])):
        with pytest.raises(InvalidInputError, match="do not rise from above 0"):
            follow_cycles(system, BEGIN, AXES, amplitudes)
    with pytest.raises(InvalidInputError, match="frequency at the onset = 0 rad/s"):
        follow_cycles(system, Onset(states=np.zeros(2), inputs=np.array([1.0]), frequency=0.0), AXES, np.array([0.1]))
    with pytest.raises(InvalidInputError, match="does not show in given"):
        follow_cycles(system, BEGIN, BranchAxes(parameter=0, watched=1), np.array([0.1]))
