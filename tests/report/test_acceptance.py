import math
from dataclasses import replace

import numpy as np
import pytest

from revline.design.trials.acceptance import Kind
from revline.design.trials.acceptance_summary import AcceptanceSummary, PlaceSummary
from revline.errors import InvalidInputError
from revline.report.acceptance import MOST_PLACES, plot_acceptance


def place(throttle: float, *, reserve: tuple[float, ...] = (4.0,), settling: tuple[float, float] = (0.5, 0.8)) -> PlaceSummary:
    numbers = np.array([0.1, 0.2])
    return PlaceSummary(
        place=(("throttle", throttle), ("load_torque", 10.0)),
        kinds=(Kind.CLEAN, Kind.NOISY),
        overshoot=numbers,
        settling=np.array(settling),
        droop=numbers,
        travel=numbers,
        saturated=numbers,
        ended=0,
        unstable=0,
        ms=(1.8,),
        reserve_db=reserve,
    )


def summary(*places: PlaceSummary) -> AcceptanceSummary:
    return AcceptanceSummary(
        controller="tuned", passed=True, runs=2, kept=2, places=places, limits=(0.3, 3.0, math.inf, 3.0), reasons=("none",)
    )


def test_each_run_is_a_point_and_what_never_settles_a_cross() -> None:
    nothing = np.empty(0)
    not_run = replace(
        place(15.0), kinds=(), overshoot=nothing, settling=nothing, droop=nothing, travel=nothing, unstable=2, ms=(), reserve_db=()
    )
    figure = plot_acceptance(summary(place(25.0, settling=(0.5, math.inf)), not_run))
    overshoot, settling, droop, reserve = figure.axes
    assert [axes.get_ylabel().rsplit(" ", 1)[-1] for axes in figure.axes] == ["(\N{EN DASH})", "(s)", "(rad/s)", "(dB)"]
    drawn = {line.get_label(): np.asarray(line.get_ydata()).tolist() for line in settling.lines}
    assert drawn["as it is"] == [0.5]
    assert drawn["with noise"] == []
    assert "not by the end" in drawn
    assert "not by the end" not in {line.get_label() for line in overshoot.lines}
    assert "asked for" not in {line.get_label() for line in droop.lines}
    crosses = next(line for line in reserve.lines if line.get_label() == "linear loop unstable")
    assert np.asarray(crosses.get_xdata()).tolist() == [1]
    assert [tick.get_text() for tick in reserve.get_xticklabels()] == ["25 deg, 10 N m", "15 deg, 10 N m"]
    with pytest.raises(InvalidInputError, match="no place was run, so that there is nothing to draw"):
        plot_acceptance(summary(not_run))


def test_of_many_places_those_with_the_least_reserve_are_shown() -> None:
    many = [place(float(k), reserve=(40.0 - k,)) for k in range(MOST_PLACES + 5)]
    labels = [tick.get_text() for tick in plot_acceptance(summary(*many)).axes[3].get_xticklabels()]
    assert labels == [f"{k} deg, 10 N m" for k in range(5, MOST_PLACES + 5)]
