from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.design.loops.step_measures import measure_step
from revline.design.tuning.step_tangent import measure_step_tangent
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction
from revline.report.responses import Command, TangentTrace, plot_divergence, plot_step_response, plot_tangents
from revline.report.style import Quantity

Check = Callable[[Figure], Any]
OUTPUT = Quantity("output", "1")
SPEED = Quantity("engine speed", "rad/s")
T = np.linspace(0.0, 4.0, 2001)
UNIT = Command(0.0, 1.0)
OVERSHOOTING = 1.0 - np.exp(-3.0 * T) * (np.cos(4.0 * T) + 0.75 * np.sin(4.0 * T))
GROWING = 60.0 * (1.0 - np.exp(1.5 * T) * np.cos(9.0 * T))


def test_a_step_response_shows_what_it_is_judged_by(check_figure: Check) -> None:
    measures = measure_step(T, OVERSHOOTING, start=0.0, target=1.0, command=1.0)
    picture = check_figure(plot_step_response(T, OVERSHOOTING, UNIT, OUTPUT, measures=measures, until=3.0))
    kept = T <= 3.0
    assert picture.holds(T[kept], OVERSHOOTING[kept])
    assert picture.holds([measures.peak_time], [measures.peak])
    assert picture.holds([0.0, 1.0], [1.0, 1.0])
    assert picture.notes() == [f"overshoot {100.0 * measures.overshoot:.1f} % at {measures.peak_time:.3g} s"]
    assert picture.legend == ["target 1", f"settling band ±2 % of the command, entered at {measures.settling_time:.3g} s"]
    assert picture.labels == [("time (s)", "output (\N{EN DASH})")]


def test_a_response_without_overshoot_has_no_mark(check_figure: Check) -> None:
    lag = 300.0 - 60.0 * np.exp(-4.0 * T)
    measures = measure_step(T, lag, start=0.0, target=300.0, command=60.0)
    picture = check_figure(plot_step_response(T, lag, Command(240.0, 300.0), SPEED, measures=measures))
    assert picture.notes() == []
    assert picture.legend[0] == "target 300 rad/s"


def test_a_response_that_is_not_measured_is_drawn_alone(check_figure: Check) -> None:
    assert check_figure(plot_step_response(T, OVERSHOOTING, UNIT, OUTPUT)).legend == ["target 1"]


def test_marks_after_the_part_shown_are_left_out(check_figure: Check) -> None:
    measures = measure_step(T, OVERSHOOTING, start=0.0, target=1.0, command=1.0)
    picture = check_figure(plot_step_response(T, OVERSHOOTING, UNIT, OUTPUT, measures=measures, until=0.5))
    assert picture.notes() == []


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_diverging_response_is_cut_where_it_leaves_the_picture(check_figure: Check, direction: float) -> None:
    y = direction * GROWING
    picture = check_figure(plot_divergence(T, y, Command(0.0, direction * 60.0), SPEED))
    left = int(np.flatnonzero(np.abs(y - direction * 60.0) > 360.0)[0])
    assert picture.holds(T[: left + 1], y[: left + 1])
    assert picture.figure.axes[0].get_ylim() == (direction * 60.0 - 360.0, direction * 60.0 + 360.0)
    assert picture.legend[1] == f"leaves the picture (target ± 6 commands) at {T[left]:.3g} s"


def test_a_response_of_any_size_is_drawn(check_figure: Check) -> None:
    check_figure(plot_divergence(T, 60.0 - np.exp(170.0 * T) * np.cos(9.0 * T), Command(0.0, 60.0), SPEED))


@pytest.mark.parametrize("gain", [12.0, -12.0])
@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_tangents_show_dead_time_and_rise_time(check_figure: Check, gain: float, delay: float) -> None:
    models = [TransferFunction(numerator=(gain,), denominator=(1.0, 0.55, 0.034), delay=d) for d in (0.0, delay)]
    tangents = [measure_step_tangent(model) for model in models]
    traces = [
        TangentTrace(
            times=T,
            values=m.step_response(T),
            dead_time=t.dead_time,
            rise_time=t.rise_time,
            final_value=t.final_value,
            label=f"G{k}",
        )
        for k, (m, t) in enumerate(zip(models, tangents, strict=True))
    ]
    picture = check_figure(plot_tangents(traces, SPEED))
    assert len(picture.figure.axes) == 4
    for k, (trace, tangent) in enumerate(zip(traces, tangents, strict=True)):
        ends = [tangent.dead_time, tangent.dead_time + tangent.rise_time]
        for row in (0, 2):
            assert picture.holds(T, trace.values, axes=row + k)
            assert picture.holds(ends, [0.0, gain], axes=row + k)
        assert picture.notes(k) == [f"T = {tangent.rise_time:.4g} s"]
        assert picture.notes(2 + k) == [f"L = {tangent.dead_time:.4g} s"]
    assert picture.legend == ["G0", "tangent at the steepest point", "final value", "G1"]


def test_a_lag_of_first_order_has_no_dead_time(check_figure: Check) -> None:
    trace = TangentTrace(times=T, values=1.0 - np.exp(-T), dead_time=0.0, rise_time=1.0, final_value=1.0, label="lag")
    assert check_figure(plot_tangents([trace], SPEED)).notes(1) == ["L = 0 s"]


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"step response cannot be drawn: times of shape \(2001,\), output of shape \(1,\)"):
        plot_step_response(T, [1.0], UNIT, OUTPUT)
    with pytest.raises(InvalidInputError, match="step response: no sample lies before -1 s; the first is at 0 s"):
        plot_step_response(T, OVERSHOOTING, UNIT, OUTPUT, until=-1.0)
    with pytest.raises(InvalidInputError, match="a command from 1 to 1 is no step; give two different finite values"):
        plot_step_response(T, OVERSHOOTING, Command(1.0, 1.0), OUTPUT)
    with pytest.raises(InvalidInputError, match="a command from 0 to nan is no step"):
        plot_divergence(T, GROWING, Command(0.0, float("nan")), SPEED)
    with pytest.raises(InvalidInputError, match=r"stays within 6 of its target for 4 s; draw it with plot_step_response"):
        plot_divergence(T, OVERSHOOTING, UNIT, OUTPUT)
    with pytest.raises(InvalidInputError, match="is more than 6 from its target at its first sample"):
        plot_divergence(T, OVERSHOOTING + 9.0, UNIT, OUTPUT)


def test_tangents_that_cannot_be_drawn_are_refused() -> None:
    fine: dict[str, Any] = {"times": T, "values": OVERSHOOTING, "dead_time": 0.1, "rise_time": 1.0, "final_value": 1.0, "label": "G"}
    with pytest.raises(InvalidInputError, match="there are no step responses to draw"):
        plot_tangents([], SPEED)
    with pytest.raises(InvalidInputError, match="3 step responses do not fit side by side; give one or two"):
        plot_tangents([TangentTrace(**fine)] * 3, SPEED)
    for changes, message in (
        ({"dead_time": -0.1}, "dead time = -0.1 s is outside the numbers from 0 on"),
        ({"rise_time": 0.0}, "rise time = 0 s is outside the positive numbers"),
        ({"final_value": float("nan")}, "final value = nan in output units is outside"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            TangentTrace(**(fine | changes))
    with pytest.raises(InvalidInputError, match="step response of G cannot be drawn"):
        plot_tangents([TangentTrace(**(fine | {"values": OVERSHOOTING[1:]}))], SPEED)
