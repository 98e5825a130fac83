"""Gains that damp a loop: counts against listed roots, and closed forms."""

import math

import numpy as np
import pytest

from revline.analysis.linearize import linearize
from revline.analysis.trim import find_trim
from revline.design.controllers.controller import PidGains
from revline.design.controllers.pid_controller import continuous_law
from revline.design.regions import loop_family
from revline.design.regions.gain_curve import AXIS, Contour, gains_at
from revline.design.regions.gain_region import Window, find_gain_region
from revline.design.regions.loop_family import family_of_model, family_of_system
from revline.design.stability.open_loop import _close, open_loop_of_system
from revline.engine.lee1995 import lee1995
from revline.errors import InvalidInputError
from revline.lti.roots import characteristic_roots
from revline.lti.state_space import DelayStateSpace, position
from revline.lti.transfer_function import TransferFunction

G1 = TransferFunction(numerator=(12.2163,), denominator=(1.0, 0.57938))
G2 = TransferFunction(numerator=(12.0066,), denominator=(1.0, 0.55159, 0.034396))
G2D = G2.with_delay(0.0213)
INTEGRATOR = TransferFunction(numerator=(1.0,), denominator=(0.0, 1.0), delay=0.4)
DAMPED = Contour(damping=0.2, up_to=20.0)


@pytest.fixture(scope="module")
def engine_model() -> DelayStateSpace:
    engine = lee1995()
    return linearize(engine, find_trim(engine, inputs={"throttle": 25.0})).model


def roots_of_model(plant: TransferFunction, kp: float, ki: float, kd: float) -> np.ndarray:
    """Roots of a loop without delay."""
    own = np.convolve((0.0, 1.0), plant.denominator)
    fed = np.convolve((ki, kp, kd), plant.numerator)
    return np.roots(np.polynomial.polynomial.polyadd(own, fed)[::-1])


def test_one_lag_has_its_closed_form() -> None:
    """T s^2 + (1 + K kp) s + K ki: damping zeta where (1 + K kp)^2 = 4 zeta^2 T K ki."""
    gain, lag, zeta = 12.2163, 0.57938, 0.3
    found = find_gain_region(family_of_model(G1, contour=Contour(damping=zeta)), Window(kp_low=-0.5, kp_high=3.0, ki_high=400.0))
    assert found.ki * 4.0 * zeta**2 * lag * gain == pytest.approx((1.0 + gain * found.kp) ** 2, rel=1e-9)
    edge = (1.0 + gain * 1.0) ** 2 / (4.0 * zeta**2 * lag * gain)
    assert found.stabilises(1.0, 0.999 * edge)
    assert not found.stabilises(1.0, 1.001 * edge)


@pytest.mark.parametrize("kd", [0.0, 0.05])
@pytest.mark.parametrize("contour", [Contour(damping=0.3), Contour(damping=0.3, up_to=8.0)], ids=["ray", "bent"])
def test_counts_without_delay_agree_with_the_polynomials_roots(kd: float, contour: Contour) -> None:
    low, high, top = -0.5, 4.0, 60.0
    found = find_gain_region(family_of_model(G2, kd=kd, contour=contour), Window(kp_low=low, kp_high=high, ki_high=top))
    generator = np.random.default_rng(5)
    kp, ki = generator.uniform(low, high, 200), generator.uniform(1e-3 * top, top, 200)
    wanted = [int(np.sum(contour.is_right(roots_of_model(G2, p, i, kd)))) for p, i in zip(kp, ki, strict=True)]
    assert np.mean(found.unstable_roots(kp, ki) == wanted) >= 0.99  # a point may lie between the curve and its chord
    assert 0 < wanted.count(0) < 200


@pytest.mark.parametrize("kd", [0.0, 0.1])
def test_the_engines_counts_agree_with_its_listed_roots(engine_model: DelayStateSpace, kd: float) -> None:
    found = find_gain_region(family_of_system(engine_model, kd=kd, contour=DAMPED))
    axis = find_gain_region(family_of_system(engine_model, kd=kd))
    generator = np.random.default_rng(11)
    drive = position(engine_model.inputs, "throttle")
    needed = [position(engine_model.outputs, "engine_speed"), position(engine_model.outputs, "engine_acceleration")]
    for p, i in zip(generator.uniform(-0.05, 3.0, 6), generator.uniform(0.1, 30.0, 6), strict=True):
        gains = PidGains(kp=p, ki=i, kd=kd, input_unit="rad/s", output_unit="deg", rule="r", designed_on="d")
        roots = characteristic_roots(_close(engine_model, continuous_law(gains), drive, needed), count=12).roots
        assert roots[-1].real < -DAMPED.decay
        assert found.unstable_roots(p, i) == np.sum(DAMPED.is_right(roots))
        assert found.unstable_roots(p, i) >= axis.unstable_roots(p, i)


def test_points_of_the_curve_put_a_root_on_the_line(engine_model: DelayStateSpace) -> None:
    family = family_of_system(engine_model, kd=0.1, contour=DAMPED)
    omega = np.array([0.5, 5.0, DAMPED.corner, 30.0])
    kp, ki = gains_at(family, omega)
    for w, s, p, i in zip(omega, DAMPED.points(omega), kp, ki, strict=True):
        gains = PidGains(kp=p, ki=i, kd=0.1, input_unit="rad/s", output_unit="deg", rule="r", designed_on="d")
        assert abs(1.0 + open_loop_of_system(engine_model, gains).transfer(np.array([s]))[0]) < 1e-9
        assert s.imag == w
    assert -DAMPED.points(omega).real / np.abs(DAMPED.points(omega)) == pytest.approx([0.2, 0.2, 0.2, 4.0 / math.hypot(4.0, 30.0)])
    assert DAMPED.decay == pytest.approx(4.0)


def test_an_integrator_with_delay_has_its_closed_form() -> None:
    """s exp(s tau) = -kp at 120 deg: w tau = 60 deg, kp = (w/sin 60 deg) exp(-w tau/tan 60 deg)."""
    contour = Contour(damping=0.5, up_to=4.0)
    found = find_gain_region(family_of_model(INTEGRATOR, contour=contour), Window(kp_low=-1.0, kp_high=3.0, ki_high=5.0))
    turned = math.pi / 3.0
    ((low, high),) = found.kp_ends()
    assert low == pytest.approx(0.0, abs=1e-12)
    assert high == pytest.approx(turned / 0.4 / math.sin(turned) * math.exp(-turned / math.tan(turned)), rel=1e-9)


def test_the_axis_is_the_damping_of_nothing() -> None:
    one, two = (find_gain_region(family_of_model(G2D, contour=contour)) for contour in (AXIS, Contour(damping=1e-9, up_to=1e3)))
    assert two.kp_ends()[0][1] == pytest.approx(one.kp_ends()[0][1], rel=1e-6)
    assert two.area.value == pytest.approx(one.area.value, rel=1e-4)


def test_more_damping_leaves_fewer_gains() -> None:
    areas = [find_gain_region(family_of_model(G2D, kd=0.05, contour=Contour(damping=z, up_to=20.0))).area.value for z in (0.05, 0.2, 0.4)]
    assert areas[0] > 1.2 * areas[1] > 1.5 * areas[2] > 0.0


def test_unfit_questions_are_refused(engine_model: DelayStateSpace, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InvalidInputError, match=r"damping = 1 .*give a ratio such as 0\.1"):
        Contour(damping=1.0)
    with pytest.raises(InvalidInputError, match="natural frequency = 0 rad/s"):
        Contour(damping=0.1, up_to=0.0)
    endless = Contour(damping=0.1)
    with pytest.raises(InvalidInputError, match="at every frequency is out of reach for model"):
        family_of_model(G2D, contour=endless)
    with pytest.raises(InvalidInputError, match="at every frequency is out of reach for system"):
        family_of_system(engine_model, contour=endless)
    monkeypatch.setattr(loop_family, "MOST_ROOTS", 8)
    with pytest.raises(InvalidInputError, match=r"more than 8 roots of model with kd = 0\.05 decay slower than 120 1/s"):
        family_of_model(G2.with_delay(0.5), kd=0.05, contour=Contour(damping=0.6, up_to=200.0))
