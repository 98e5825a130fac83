import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.engine import torque
from revline.engine.catalogue import ENGINES, CatalogueEntry, build_engine
from revline.engine.lee1995 import GENERIC_EFFICIENCY, LEE_1995, EngineParameters, check_parameters, lee1995, lee1995_parameters
from revline.errors import InvalidInputError
from revline.system import DelaySystem

NOMINAL = (25.0, 15.0, 10.0, 0.0)
BOTH = pytest.mark.parametrize("entry", ENGINES, ids=lambda entry: entry.name)
PRESSURES = st.floats(min_value=5.0, max_value=95.0)
SPEEDS = st.floats(min_value=10.0, max_value=360.0) | st.floats(min_value=364.0, max_value=1500.0)


def named(variables: Any, values: Any) -> dict[str, float]:
    return {variable.name: float(value) for variable, value in zip(variables, values, strict=True)}


def steady_residual(engine: DelaySystem, state: tuple[float, ...], inputs: tuple[float, ...]) -> tuple[float, ...]:
    p = engine.parameters
    return tuple(map(float, engine.rate(p, state, inputs, engine.emit(p, state, inputs, (0.0, 0.0)))))


@pytest.mark.reference
def test_the_operating_point_of_the_thesis_is_steady() -> None:
    """Source: Lee (1995), section 4.1: 240.799 rad/s and 35.8072 kPa at 25 degrees, each within half of its last digit."""
    engine = lee1995()
    steady = solve_steady(engine, (35.8, 240.8), NOMINAL)
    assert steady == pytest.approx((35.8072, 240.799), abs=5e-4)
    assert steady[0] == pytest.approx(35.8072, abs=5e-5)


@pytest.mark.reference
@pytest.mark.parametrize(
    ("angle", "speed"),
    [(10.0, 64.467), (15.0, 121.238), (20.0, 180.676), (30.0, 300.778), (35.0, 360.154), (40.0, 418.614), (50.0, 531.854), (60.0, 638.934)],
)
def test_the_steady_map_of_the_thesis(angle: float, speed: float) -> None:
    """Source: Lee (1995), Fig. 4.1, recomputed to six digits."""
    assert solve_steady(lee1995(), (35.0, speed), (angle, *NOMINAL[1:]))[1] == pytest.approx(speed, abs=6e-4)


def solve_steady(engine: DelaySystem, state: tuple[float, ...], inputs: tuple[float, ...]) -> tuple[float, ...]:
    """Newton's method on the steady equations with a Jacobian by complex step."""
    x = np.array(state)
    p = engine.parameters
    for _ in range(30):
        jacobian = np.empty((2, 2))
        for k in range(2):
            bumped = tuple(value + 1e-200j * (i == k) for i, value in enumerate(x))
            rates = engine.rate(p, bumped, inputs, engine.emit(p, bumped, inputs, (0.0, 0.0)))
            jacobian[:, k] = [rate.imag / 1e-200 for rate in rates]
        x = x - np.linalg.solve(jacobian, steady_residual(engine, tuple(x), inputs))
    assert steady_residual(engine, tuple(x), inputs) == pytest.approx((0.0, 0.0), abs=1e-9)
    return tuple(x)


def test_the_equations_by_hand() -> None:
    """All relations written out once more, at 40 kPa and 200 rad/s, 30 degrees, A/F 14, spark 20 degrees, load 5 N m."""
    engine = lee1995()
    pressure, speed, angle, ratio, advance, load = 40.0, 200.0, 30.0, 14.0, 20.0, 5.0
    charge, influence = 1.2e-4, 0.9
    gas = 8.31434 / 28.84
    mass = pressure * 0.0027 / (gas * 310.0)
    efficiency = (24.5 * speed - 3.1e4) * mass**2 + (-0.167 * speed + 222.0) * mass + (8.1e-4 * speed + 0.352)
    into_cylinders = 0.112 * efficiency * speed * mass
    opening = 1.0 - math.cos(math.radians(1.14459 * angle - 1.06))
    through_throttle = 0.1843 * (1.0 - math.exp(9.0 * (pressure / 100.0 - 1.0))) * opening
    indicated = 498636.0 * charge * influence
    friction = 15.1 + 0.1056 * speed
    net = indicated - friction - load

    p, x, u, zd = engine.parameters, (pressure, speed), (angle, ratio, advance, load), (charge, influence)
    assert engine.emit(p, x, u, zd) == pytest.approx(
        (into_cylinders * math.cos(math.radians(7.3834 * 0.5)) / speed, math.cos(math.radians(20.0)) ** 2.875), rel=1e-13
    )
    assert engine.lags(p, x, u, zd) == pytest.approx((5.48 / 200.0, 1.30 / 200.0), rel=1e-15)
    rates = (gas * 310.0 / 0.0027 * (through_throttle - into_cylinders), net / 0.1454)
    assert engine.rate(p, x, u, zd) == pytest.approx(rates, rel=1e-12)
    assert named(engine.outputs, engine.output(p, x, u, zd)) == pytest.approx(
        {
            "engine_speed": speed,
            "indicated_torque": indicated,
            "friction_torque": friction,
            "net_torque": net,
            "manifold_pressure": pressure,
            "throttle_air_rate": through_throttle,
            "cylinder_air_rate": into_cylinders,
            "volumetric_efficiency": efficiency,
            "engine_acceleration": net / 0.1454,
        },
        rel=1e-13,
    )


@BOTH
def test_what_depends_on_what(entry: CatalogueEntry) -> None:
    """The charge reads states and mixture, the spark channel the spark alone, the lags the speed alone."""
    structure = entry.build().structure
    pressure, speed = "x0", "x1"
    throttle, ratio, spark, load = "u0", "u1", "u2", "u3"
    arriving = {"zd0", "zd1"}
    assert structure.emit == (frozenset({pressure, speed, ratio}), frozenset({spark}))
    assert structure.lags == (frozenset({speed}), frozenset({speed}))
    assert structure.rate == (frozenset({pressure, speed, throttle}), frozenset({speed, load} | arriving))
    outputs = dict(zip((variable.name for variable in entry.build().outputs), structure.output, strict=True))
    breathing = {pressure, speed}
    expected = {
        "engine_speed": {speed},
        "indicated_torque": arriving,
        "friction_torque": {speed},
        "net_torque": {speed, load} | arriving,
        "manifold_pressure": {pressure},
        "throttle_air_rate": {pressure, throttle},
        "cylinder_air_rate": breathing,
        "volumetric_efficiency": {speed} if entry.name == "lee1995-generic" else breathing,
        "engine_acceleration": {speed, load} | arriving,
    }
    assert {name: set(sources) for name, sources in outputs.items()} == expected


@BOTH
@given(PRESSURES, SPEEDS, st.floats(min_value=0.5, max_value=79.0), st.floats(min_value=2.0, max_value=25.0))
def test_complex_step_gives_all_derivatives(
    derivatives_agree: Callable[..., None], entry: CatalogueEntry, pressure: float, speed: float, angle: float, ratio: float
) -> None:
    engine = entry.build()
    scales = {
        "emit": (2e-4, 1.0),
        "lags": (0.05, 0.01),
        "rate": (3e3, 1e3),
        "output": (speed, 100.0, 100.0, 200.0, 100.0, 0.2, 0.2, 1.0, 1e3),
    }
    point = (pressure, speed, angle, ratio, 10.0, 5.0, 1e-4, 0.9)
    for name, sizes in scales.items():
        for k, scale in enumerate(sizes):

            def component(p: Any, *v: Any, name: str = name, k: int = k) -> Any:
                return getattr(engine, name)(p, v[:2], v[2:6], v[6:])[k]

            derivatives_agree(component, engine.parameters, point, scale)


@pytest.mark.parametrize("spark", [-90.1, 90.1, 180.0, math.nan])
def test_a_spark_beyond_90_degrees_of_best_torque_is_refused(spark: float) -> None:
    with pytest.raises(InvalidInputError, match=rf"^spark = {spark:g} deg is outside -90 to 90 deg; give a value in that range$"):
        lee1995().input_vector({"spark": spark})
    assert lee1995().input_vector({"spark": 90.0})[2] == 90.0


def test_nominal_inputs_are_the_thesiss() -> None:
    np.testing.assert_array_equal(lee1995().input_vector(), NOMINAL)


def test_the_best_torque_angle_changes_nothing_but_absolute_angles() -> None:
    shifted = lee1995(LEE_1995._replace(spark=LEE_1995.spark._replace(best_torque_angle=25.0)))
    state, arriving = (40.0, 200.0), (1e-4, 0.9)
    for equation in ("emit", "rate", "output"):
        one, other = (getattr(engine, equation)(engine.parameters, state, NOMINAL, arriving) for engine in (lee1995(), shifted))
        assert one == other


@given(st.floats(min_value=0.01, max_value=10.0))
def test_an_inertia_scales_the_acceleration_alone(inertia: float) -> None:
    heavy = lee1995(LEE_1995._replace(rotation=torque.Rotation(inertia)))
    state, arriving = (40.0, 200.0), (1e-4, 0.9)
    pressure_rate, acceleration = heavy.rate(heavy.parameters, state, NOMINAL, arriving)
    engine = lee1995()
    expected = engine.rate(engine.parameters, state, NOMINAL, arriving)
    assert pressure_rate == expected[0]
    assert acceleration * inertia == pytest.approx(expected[1] * 0.1454, rel=1e-12)


def test_whole_numbers_become_floats() -> None:
    engine = lee1995(LEE_1995._replace(manifold=LEE_1995.manifold._replace(temperature=310)))
    assert type(engine.parameters.manifold.temperature) is float
    assert engine.content_digest == lee1995().content_digest


def changed(section: str, **values: Any) -> EngineParameters:
    return LEE_1995._replace(**{section: getattr(LEE_1995, section)._replace(**values)})


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (changed("manifold", volume=-0.1), "manifold.volume = -0.1 m3 is outside the range above 0 m3; give a value above 0"),
        (changed("rotation", inertia=0.0), "rotation.inertia = 0 kg m2 is outside the range above 0 kg m2; give a value above 0"),
        (changed("delays", spark_to_torque=0), "delays.spark_to_torque = 0 rad is outside the range above 0 rad; give a value above 0"),
        (
            changed("throttle", saturation_angle=90.5),
            "throttle.saturation_angle = 90.5 deg is outside 0 to 90 deg; a throttle opens no further",
        ),
        (changed("friction", viscous=math.nan), "friction.viscous = nan is no finite number; give one in N m s/rad"),
        (changed("friction", constant=-math.inf), "friction.constant = -inf is no finite number; give one in N m"),
        (changed("friction", constant="15"), "friction.constant = '15' is of type str; give a number in N m"),
        (changed("friction", constant=True), "friction.constant = True is of type bool; give a number in N m"),
        (changed("friction", constant=1j), "friction.constant = 1j is of type complex; give a number in N m"),
        (
            LEE_1995._replace(efficiency=GENERIC_EFFICIENCY._replace(change_speed=0.0)),
            "efficiency.change_speed = 0 rad/s is outside the range above 0 rad/s; give a value above 0",
        ),
    ],
)
def test_parameters_without_sense_are_refused(parameters: EngineParameters, message: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^{re.escape(message)}$") as caught:
        check_parameters(parameters)
    assert message.startswith(str(caught.value.details["quantity"]))
    with pytest.raises(InvalidInputError, match=f"^{re.escape(message)}$"):
        lee1995(parameters)


def test_parameters_are_given_back_from_unchanged_engines_alone() -> None:
    assert lee1995_parameters(build_engine("lee1995-generic")).efficiency == GENERIC_EFFICIENCY
    engine = lee1995()
    with pytest.raises(
        InvalidInputError, match=r"^lee1995 differs from the engine of Lee \(1995\) in its states, beyond parameters: keep it as"
    ):
        lee1995_parameters(replace(engine, states=tuple(replace(variable, low=1.0) for variable in engine.states)))
    with pytest.raises(InvalidInputError, match=r"^other is no engine of Lee \(1995\): its parameters are Rotation, not EngineParameters$"):
        lee1995_parameters(
            DelaySystem(
                name="other",
                parameters=LEE_1995.rotation,
                states=(),
                inputs=(),
                channels=(),
                outputs=(),
                **dict.fromkeys(("emit", "lags", "rate", "output"), lambda *_: ()),
            )
        )
