from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.design.loops.outcome import Diverged, LimitCycle, Outcome, Settled, Stalled
from revline.errors import InvalidInputError
from revline.report.loops import LoopTrace, plot_loop
from revline.report.style import Quantity

Check = Callable[[Figure], Any]
SPEED, THROTTLE = Quantity("engine speed", "rad/s"), Quantity("throttle angle", "deg")
T = np.linspace(0.0, 8.0, 4001)
RISE = 240.0 + 60.0 * (1.0 - np.exp(-3.0 * T) * (np.cos(4.0 * T) + 0.75 * np.sin(4.0 * T)))
HUNT = 300.0 + 10.0 * np.sin(2.0 * np.pi * T / 0.2) - 60.0 * np.exp(-5.0 * T)
SETTLED = Settled(value=300.0, steady_error=0.0, residual=0.0)
CYCLE = LimitCycle(low=290.0, high=310.0, period=0.2, low_spread=0.0, high_spread=0.0, period_spread=0.0, cycles=10, swings=1, drift=0.0)


def trace(output: np.ndarray, outcome: Outcome, **changes: Any) -> LoopTrace:
    control = np.clip(25.0 + 5.0 * (300.0 - output), 0.0, 79.46)
    values: dict[str, Any] = {"times": T, "output": output, "control": control, "start": 240.0, "target": 300.0, "low": 0.0, "high": 79.46}
    return LoopTrace(**(values | {"outcome": outcome} | changes))


def test_a_loop_that_settles_shows_speed_and_throttle(check_figure: Check) -> None:
    picture = check_figure(plot_loop(trace(RISE, SETTLED), SPEED, THROTTLE, until=4.0))
    kept = T <= 4.0
    assert picture.holds(T[kept], RISE[kept], axes=0)
    assert picture.holds(T[kept], np.clip(25.0 + 5.0 * (300.0 - RISE[kept]), 0.0, 79.46), axes=1)
    assert picture.notes(0) == ["overshoot 9.5 % of the command"]
    assert picture.legend == ["target 300 rad/s", "limit of the throttle angle"]
    assert [y for _, y in picture.labels] == ["engine speed (rad/s)", "throttle angle (deg)"]
    assert picture.figure.axes[0].get_xlim() == (0.0, 4.0)


def test_limits_that_are_far_or_infinite_are_left_out(check_figure: Check) -> None:
    figure = plot_loop(trace(RISE, SETTLED, control=25.0 + 0.1 * np.sin(T), high=np.inf), SPEED, THROTTLE)
    assert check_figure(figure).legend == ["target 300 rad/s"]


def test_a_step_down_overshoots_downwards(check_figure: Check) -> None:
    figure = plot_loop(trace(540.0 - RISE, SETTLED, start=300.0, target=240.0), SPEED, THROTTLE)
    assert check_figure(figure).notes(0) == ["overshoot 9.5 % of the command"]


def test_no_overshoot_is_not_marked(check_figure: Check) -> None:
    figures = (
        plot_loop(trace(300.0 - 60.0 * np.exp(-T), SETTLED), SPEED, THROTTLE),
        plot_loop(trace(RISE, SETTLED), SPEED, THROTTLE, until=0.5),
    )
    assert [check_figure(figure).notes(0) for figure in figures] == [[], []]


def test_a_limit_cycle_is_enlarged_with_bounds_and_period(check_figure: Check) -> None:
    picture = check_figure(plot_loop(trace(HUNT, CYCLE), SPEED, THROTTLE))
    assert len(picture.figure.axes) == 4
    last = (T[-1] - 4.0 * 0.2 <= T) & (T[-1] >= T)
    assert picture.holds(T[last], HUNT[last], axes=1)
    assert picture.notes(1) == ["310 rad/s", "290 rad/s", "period 0.2 s"]
    assert "enlarged at right" in picture.legend
    assert picture.figure.axes[1].get_xlim() == (pytest.approx(7.2), 8.0)


def test_the_enlarged_part_is_not_marked_where_it_is_not_shown(check_figure: Check) -> None:
    assert "enlarged at right" not in check_figure(plot_loop(trace(HUNT, CYCLE), SPEED, THROTTLE, until=2.0)).legend


@pytest.mark.parametrize(
    ("outcome", "text"),
    [
        (Diverged(time=6.0, value=900.0, bound=600.0), "diverges at 6 s"),
        (Stalled(time=6.0, state="engine_speed", value=0.0), "stalls at 6 s"),
    ],
)
def test_other_ends_are_named_where_they_happen(check_figure: Check, outcome: Outcome, text: str) -> None:
    output = 300.0 - 60.0 * np.exp(0.3 * T)
    picture = check_figure(plot_loop(trace(output, outcome), SPEED, THROTTLE))
    assert picture.notes(0) == [text]
    assert picture.holds([T[3000]], [output[3000]])


def test_what_follows_divergence_is_not_shown(check_figure: Check) -> None:
    output = 300.0 - 60.0 * np.exp(20.0 * T)
    outcome = Diverged(time=0.12, value=-361.4, bound=600.0)
    axes = check_figure(plot_loop(trace(output, outcome), SPEED, THROTTLE)).figure.axes[0]
    assert axes.get_xlim()[1] == pytest.approx(0.126)
    assert axes.get_ylim()[0] > -1000.0


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"closed loop cannot be drawn: times of shape \(4001,\), output of shape \(4000,\)"):
        trace(RISE[1:], SETTLED)
    with pytest.raises(InvalidInputError, match=r"output\[0\] = nan is not finite"):
        trace(RISE * np.nan, SETTLED)
    with pytest.raises(InvalidInputError, match="a closed loop of 4001 samples from 240 to nan cannot be drawn"):
        trace(RISE, SETTLED, target=np.nan)
    with pytest.raises(InvalidInputError, match="8 s of a limit cycle of period 3 s are too few; give 4 periods or more"):
        trace(
            HUNT,
            LimitCycle(low=0.0, high=1.0, period=3.0, low_spread=0.0, high_spread=0.0, period_spread=0.0, cycles=5, swings=1, drift=0.0),
        )
    with pytest.raises(InvalidInputError, match="no sample of the closed loop lies before 0 s; the first is at 0 s"):
        plot_loop(trace(RISE, SETTLED), SPEED, THROTTLE, until=0.0)
