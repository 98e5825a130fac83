"""Mid-ranging against closed forms, exact linear responses, brute force over disks, and planted faults."""

import math
from dataclasses import replace

import numpy as np
import pytest

from revline.analysis.linearize import linearize
from revline.analysis.trim import Trim, find_trim
from revline.design.stability.margins import find_margins
from revline.design.stability.open_loop import OpenLoop
from revline.design.two_inputs import mid_ranging_margins
from revline.design.two_inputs.load_steps import LoadStep, LoadStepRun, LoopCase, StalledRun, fast_limits, run_load_step
from revline.design.two_inputs.mid_ranging import MidRangingBounds, MidRangingDesign, design_mid_ranging
from revline.design.two_inputs.mid_ranging_comparison import MidRangingComparison, OutputLimits, PlantCase, compare_mid_ranging
from revline.design.two_inputs.mid_ranging_margins import (
    close_both,
    confirm_design,
    find_mid_ranging_margins,
    law_of,
    law_of_slow_alone,
    resting_point,
)
from revline.design.two_inputs.one_input import SPEED_BY_SPARK_AND_THROTTLE, OneInputGains, largest_integral, tune_one_input
from revline.design.two_inputs.torque_reserve import find_torque_reserve
from revline.design.two_inputs.two_input_loops import LoopGains, TwoInputPlant, find_two_input_disk, loops_of, structured_sizes
from revline.design.two_inputs.two_output_system import OutputRange, TwoOutputGains, two_output_system
from revline.engine.lee1995 import LEE_1995, lee1995
from revline.errors import AnalysisError, InvalidInputError, NotConvergedError
from revline.io.mid_ranging_records import describe_runs, mid_ranging_csv, mid_ranging_record
from revline.lti.time_response import step_response
from revline.report.mid_ranging import plot_load_steps
from revline.system import DelaySystem, Variable

ENGINE = lee1995()
SPEED = Variable(name="speed", unit="rad/s")
NOWHERE = TwoOutputGains(1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0)


def trim_at(throttle: float, spark: float, system: DelaySystem = ENGINE, load: float = 0.0) -> Trim:
    return find_trim(system, inputs={"throttle": throttle, "spark": spark, "load_torque": load})


def with_lags(factor: float) -> DelaySystem:
    return lee1995(LEE_1995._replace(delays=type(LEE_1995.delays)(*(factor * angle for angle in LEE_1995.delays))))


IDLE = trim_at(12.0, -20.0)


@pytest.fixture(scope="module")
def design() -> MidRangingDesign:
    return design_mid_ranging(ENGINE, IDLE)


@pytest.fixture(scope="module")
def comparison(design: MidRangingDesign) -> MidRangingComparison:
    slow = with_lags(1.2)
    plants = (PlantCase("nominal", ENGINE, IDLE), PlantCase("lags +20 %", slow, trim_at(12.0, -20.0, slow)))
    told: list[float] = []
    limits = OutputLimits(slow_low=0.0, slow_high=79.0)
    found = compare_mid_ranging(design, plants, LoadStep(size=4.0, until=6.0), limits=limits, progress=told.append)
    assert told == [0.5, 1.0]
    return found


def run(design: MidRangingDesign, size: float, *, alone: bool = False, until: float = 6.0) -> LoadStepRun | StalledRun:
    law = law_of_slow_alone(design) if alone else law_of(design.gains, design.reserve.sign)
    ranges = (fast_limits(design.reserve), OutputRange(12.0, 0.0, 79.0))
    case = LoopCase("loop", ENGINE, law, IDLE)
    return run_load_step(case, LoadStep(size=size, until=until), reserve=design.reserve, ranges=ranges, signals=design.signals)


def recorded(design: MidRangingDesign, size: float, *, alone: bool = False) -> LoadStepRun:
    found = run(design, size, alone=alone)
    assert isinstance(found, LoadStepRun)
    return found


@pytest.mark.parametrize("spark", [-20.0, 10.0, 35.0])
def test_the_torque_reserve_has_its_closed_form(spark: float) -> None:
    """Torque goes with cos(spark)^2.875. Source: Lee (1995), chapter 2."""
    found = find_torque_reserve(ENGINE, trim_at(15.0, spark))
    angle = math.radians(spark)
    assert found.gain == pytest.approx(-2.875 * math.tan(angle) * found.value * math.pi / 180.0, rel=1e-10)
    assert found.reserve == pytest.approx(found.value * (math.cos(angle) ** -2.875 - 1.0), rel=1e-9)
    assert found.best == pytest.approx(0.0, abs=1e-9)
    assert found.sign == -math.copysign(1.0, spark)


@pytest.mark.parametrize("spark", [0.0, 0.5])
def test_the_spark_of_best_torque_has_no_authority(spark: float) -> None:
    with pytest.raises(
        InvalidInputError, match=r"spark = .* deg has no authority over indicated_torque: its gain is .*; choose a set-point"
    ):
        design_mid_ranging(ENGINE, trim_at(12.0, spark))


def test_an_input_without_a_range_is_refused() -> None:
    endless = replace(ENGINE, inputs=tuple(replace(v, high=math.inf) if v.name == "spark" else v for v in ENGINE.inputs))
    with pytest.raises(InvalidInputError, match="spark has no finite range"):
        find_torque_reserve(endless, IDLE)


def test_every_loop_keeps_its_bound_and_both_routes_to_the_closed_loop_agree(design: MidRangingDesign) -> None:
    found = confirm_design(design, ENGINE, IDLE)
    peaks = {name: loop.sensitivity.value for name, loop in found.loops.items()}
    assert max(peaks.values()) <= 2.001
    assert max(peaks["fast"], peaks["both"]) > 1.9  # the bound is used, not merely kept
    assert found.stable
    assert found.disagreement < 1e-9
    assert found.fast_crossover > 3.0 * found.slow_crossover
    assert design.resolution < 1e-3
    assert found.disk.margin < min(loop.disk_margin for name, loop in found.loops.items() if name in {"fast", "slow", "both"})


def test_a_fault_planted_in_the_law_is_found(design: MidRangingDesign, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mid_ranging_margins, "law_of", lambda gains, sign: law_of(gains._replace(slow_kd=1.01 * gains.slow_kd), sign))
    with pytest.raises(NotConvergedError, match=r"nominal: at the roots .* the loops are not those of the system"):
        find_mid_ranging_margins(design, ENGINE, IDLE)


def test_a_design_that_misses_its_bounds_is_not_confirmed(design: MidRangingDesign) -> None:
    with pytest.raises(NotConvergedError, match=r"the design does not keep its bounds: stable True, Ms 2 .limit 1\.5"):
        confirm_design(replace(design, bounds=MidRangingBounds(ms=1.5)), ENGINE, IDLE)


def test_an_input_of_the_other_sign_has_gains_of_the_other_sign(design: MidRangingDesign) -> None:
    """Beyond best torque more advance is less torque: the same design with kp, ki and the slow gains turned."""
    trim = trim_at(12.0, 20.0)
    found = design_mid_ranging(ENGINE, trim)
    law = law_of(found.gains, found.reserve.sign)
    assert law.kp < 0.0
    assert law.slow_ki < 0.0
    assert found.gains == pytest.approx(design.gains, rel=1e-6)
    assert confirm_design(found, ENGINE, trim).stable


def test_the_disk_of_both_inputs_is_reached_and_not_before(design: MidRangingDesign) -> None:
    """At the margin some pair of factors in the disk puts a root on the axis; brute force over one phase finds no smaller one."""
    signals = design.signals
    plant = TwoInputPlant.of(design.linear.model, signals.fast, signals.slow, signals.measurement, sign=1.0)
    disk = find_two_input_disk(plant, design.gains)
    fast, slow = (complex(loop(1j * disk.frequency)) for loop in loops_of(plant, design.gains))
    radius = disk.margin * (1.0 + np.linspace(-0.05, 0.0, 6))[:, None]
    first = radius * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200_001))
    factor = (1.0 + 0.5 * first) / (1.0 - 0.5 * first)
    needed = -(1.0 + factor * fast) / slow  # of the other input, for a root on the axis
    second = np.abs(2.0 * (needed - 1.0) / (needed + 1.0))
    assert np.min(second[-1]) == pytest.approx(disk.margin, rel=1e-6)
    assert np.all(np.min(second[:-1], axis=1) > radius[:-1, 0])


def test_one_loop_alone_has_the_disk_of_a_single_loop(design: MidRangingDesign) -> None:
    signals = design.signals
    plant = TwoInputPlant.of(design.linear.model, signals.fast, signals.slow, signals.measurement, sign=1.0)
    fast, _ = loops_of(plant, LoopGains(design.gains.kp, design.gains.ki, 0.0, 0.0, 0.0))
    single = find_margins(OpenLoop(name="fast", transfer=fast, delay=0.017, unstable_poles=0.0))
    sizes = structured_sizes(np.array([fast(1j * single.disk.frequency)]).ravel(), np.zeros(1, dtype=complex))
    assert sizes[0] == pytest.approx(1.0 / single.disk_margin, rel=1e-9)


def test_a_small_load_step_is_the_exact_linear_response(design: MidRangingDesign) -> None:
    law = law_of(design.gains, design.reserve.sign)
    loop = close_both(ENGINE, law, fast=OutputRange(-20.0), slow=OutputRange(12.0), signals=design.signals)
    closed = linearize(loop, resting_point(loop, IDLE, IDLE.output("engine_speed"))).model
    found = recorded(design, 1e-3)
    exact = step_response(closed, found.times[:200], input_name="load_torque").output("engine_speed")
    assert found.error[:200] / 1e-3 == pytest.approx(exact, abs=2e-4 * float(np.max(np.abs(exact))))


def test_the_spark_halves_the_droop_comes_back_and_keeps_its_reserve(comparison: MidRangingComparison) -> None:
    for plant in comparison.plants:
        both, alone = plant.both, plant.alone
        assert isinstance(both, LoadStepRun)
        assert isinstance(alone, LoadStepRun)
        assert plant.margins.stable
        assert both.droop < 0.5 * alone.droop
        assert both.integrated_error < 0.5 * alone.integrated_error
        assert both.return_time is not None
        assert both.fast_left < 0.05
        assert 0.5 < both.reserve_used < 1.0
        assert (both.fast_saturated, both.slow_saturated, alone.fast_travel, alone.reserve_used) == (0.0, 0.0, 0.0, 0.0)
        assert both.difference <= both.task.tolerance


def test_records_and_figure_show_both_runs(comparison: MidRangingComparison) -> None:
    record = mid_ranging_record(comparison)
    both = comparison.own.both
    assert isinstance(both, LoadStepRun)
    assert record["plants"][0]["mid_ranging"]["droop_rad_s"] == both.droop  # type: ignore[index] # nested records
    lines = mid_ranging_csv(comparison).splitlines()
    assert lines[2].startswith("time_s,mid_ranging_engine_speed_rad_s,mid_ranging_spark_deg")
    assert len(describe_runs(comparison)) == 4
    assert comparison.warnings() == ()
    assert len(plot_load_steps(comparison.own.runs).axes) == 3


def test_beyond_the_reserve_the_limit_is_touched_and_told(design: MidRangingDesign) -> None:
    found = recorded(design, 8.0)
    assert found.fast_saturated > 0.0
    assert found.reserve_used == pytest.approx(1.0)
    assert found.droop < recorded(design, 8.0, alone=True).droop


def test_a_load_that_stalls_the_engine_is_an_outcome(design: MidRangingDesign) -> None:
    plants = (PlantCase("nominal", ENGINE, IDLE),)
    found = compare_mid_ranging(design, plants, LoadStep(size=300.0, until=6.0), limits=OutputLimits(slow_low=0.0, slow_high=79.0))
    assert isinstance(found.own.both, StalledRun)
    assert any("stalls at" in text for text in found.warnings())
    assert mid_ranging_record(found)["plants"][0]["mid_ranging"]["outcome"] == "stalled"  # type: ignore[index] # nested records
    with pytest.raises(InvalidInputError, match="all loops stalled"):
        plot_load_steps(found.own.runs)


def test_loops_that_another_plant_makes_unstable_are_named(design: MidRangingDesign) -> None:
    slow = with_lags(2.0)
    plants = (PlantCase("nominal", ENGINE, IDLE), PlantCase("lags doubled", slow, trim_at(12.0, -20.0, slow)))
    found = compare_mid_ranging(design, plants, LoadStep(size=1.0, until=3.0), limits=OutputLimits(slow_low=0.0, slow_high=79.0))
    texts = found.all_warnings()
    assert "lags doubled: the linear loop of throttle alone is unstable" in texts
    assert any(text.startswith("lags doubled, throttle alone: engine_speed is not settled within 3 s") for text in texts)


def test_at_its_limit_the_fast_controller_asks_for_the_limit_and_its_proportional_term() -> None:
    """With a tracking time of kp/ki the integral term rests at the limit whatever the error is; with another it does not."""
    law = TwoOutputGains(7.0, 70.0, 0.01, 0.1, 0.0, 0.0, fast_tracking=10.0, slow_tracking=10.0)
    for tracking, rests in ((10.0, True), (5.0, False)):
        system = two_output_system(
            law._replace(fast_tracking=tracking),
            fast=OutputRange(-20.0, -40.0, 0.0),
            slow=OutputRange(12.0),
            measurement=SPEED,
            units=("deg", "deg"),
        )
        rates = [system.rate(system.parameters, (0.0, 12.0), (80.0, speed, 0.0), ())[0] for speed in (79.0, 76.0)]
        assert (rates == pytest.approx([0.0, 0.0])) is rests


def test_the_competitor_has_the_least_iae_by_another_route(design: MidRangingDesign) -> None:
    """IAE by the exact step response: no larger than that of other PID gains of the same Ms, the largest integral gain among them."""
    model, signals = design.linear.model, SPEED_BY_SPARK_AND_THROTTLE
    tuned = tune_one_input(model, "throttle", signals, ms=2.0)
    assert tuned == design.alone

    def error(gains: OneInputGains) -> float:
        law = law_of_slow_alone(replace(design, alone=gains))
        loop = close_both(ENGINE, law, fast=OutputRange(-20.0), slow=OutputRange(12.0), signals=signals)
        closed = linearize(loop, resting_point(loop, IDLE, IDLE.output("engine_speed"))).model
        times = np.linspace(0.0, 6.0, 1201)
        return float(np.trapezoid(np.abs(step_response(closed, times, input_name="load_torque").output("engine_speed")), times))

    best = error(tuned)
    for factor in (0.0, 0.7, 1.2):
        kd = factor * tuned.kd
        other = OneInputGains(*largest_integral(model, ("throttle", signals), 2.0, kd=kd), kd)
        assert best < error(other)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"ms": 1.0}, "Ms = 1 "),
        ({"fast_share": 1.0}, "the fast loop's share = 1"),
        ({"separation": 0.5}, "separation of the crossovers = 0.5"),
    ],
)
def test_bounds_out_of_range_are_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        MidRangingBounds(**wrong)


def test_load_steps_out_of_range_are_refused(design: MidRangingDesign) -> None:
    for wrong, words in (
        ({"size": 0.0}, "step of the load = 0"),
        ({"size": 4.0, "until": 0.01}, "stop time = 0.01"),
        ({"size": 4.0, "band": 0.0}, "settling band = 0"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            LoadStep(**wrong)
    with pytest.raises(InvalidInputError, match=r"upper limit of spark = 5 deg lies beyond .* answers it with one sign"):
        fast_limits(design.reserve, high=5.0)
    with pytest.raises(InvalidInputError, match="leave no room to both sides of its set-point"):
        fast_limits(design.reserve, low=-20.0)
    with pytest.raises(InvalidInputError, match="no plant to compare the controllers on"):
        compare_mid_ranging(design, (), LoadStep(size=4.0))


def test_laws_that_mean_nothing_are_refused() -> None:
    rest = OutputRange(0.0, -1.0, 1.0)
    with pytest.raises(InvalidInputError, match="slow_ki = nan is no finite number"):
        two_output_system(NOWHERE._replace(slow_ki=math.nan), fast=rest, slow=rest, measurement=SPEED, units=("deg", "deg"))
    with pytest.raises(InvalidInputError, match="the fast output at rest, 2 deg, lies outside its limits -1 to 1 deg"):
        two_output_system(NOWHERE, fast=rest._replace(rest=2.0), slow=rest, measurement=SPEED, units=("deg", "deg"))


def test_what_cannot_be_designed_is_refused() -> None:
    unstable = trim_at(4.5, -20.0)
    assert not unstable.stable
    with pytest.raises(InvalidInputError, match=r"the trim is unstable .* choose a trim at a higher throttle"):
        design_mid_ranging(ENGINE, unstable)
    wires = ("throttle", SPEED_BY_SPARK_AND_THROTTLE)
    with pytest.raises(AnalysisError, match=r"no PI gains of throttle have Ms = 1\.05 with kd = 0\.06; allow a larger Ms"):
        largest_integral(linearize(ENGINE, IDLE).model, wires, 1.05, kd=0.06)
    with pytest.raises(AnalysisError, match="no gains of the slow loop keep Ms = 1 and crossovers 3 apart"):
        design_mid_ranging(ENGINE, IDLE, bounds=MidRangingBounds(ms=1.0 + 1e-9))
