import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.design.controllers.controller import PidGains
from revline.design.loops.closed_loop import Limits
from revline.design.loops.outcome import Diverged
from revline.design.regions.gain_curve import Contour, LoopFamily
from revline.design.regions.gain_slices import GainSlice, Mark, Question, find_slices, mark_controller
from revline.design.regions.loop_family import family_of_model
from revline.design.regions.nonlinear_boundary import BoundaryPoint, BoundarySearch, NonlinearBoundary, StepCase
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction
from revline.report.figure_files import figure_task
from revline.report.gains import plot_gain_slices

Check = Callable[[Figure], Any]

G2 = TransferFunction(numerator=(12.0066,), denominator=(1.0, 0.55159, 0.034396), input_unit="deg", output_unit="rad/s")
C2D = PidGains(kp=1.2, ki=2.0, kd=0.0, input_unit="rad/s", output_unit="deg", rule="r", designed_on="d")


def slices_of(plant: TransferFunction, kds: tuple[float, ...], *marks: Mark) -> tuple[GainSlice, ...]:
    def make(kd: float, contour: Contour) -> LoopFamily:
        return family_of_model(plant, kd=kd, contour=contour)

    return find_slices(make, Question(kds=kds, peaks=(2.0,), damping=0.2), marks=marks, delayed=plant.delay > 0.0)


def test_region_contour_damping_controllers_and_simulated_points_are_drawn(check_figure: Check) -> None:
    slices = slices_of(G2.with_delay(0.0213), (0.0,), mark_controller("c2d", C2D))
    point = BoundaryPoint(
        kp=1.5,
        ki=7.0,
        frequency=20.0,
        settled=0.98,
        unsettled=1.01,
        outcome=Diverged(time=1.0, value=1.0, bound=1.0),
        undecided=(),
        runs=3,
    )
    simulated = NonlinearBoundary(
        plant="engine",
        case=StepCase(command=60.0, limits=Limits(0.0, 79.46)),
        start=25.0,
        target=30.0,
        linear=slices[0].region,
        points=(point,),
        lost=(),
        search=BoundarySearch(),
    )
    picture = check_figure(plot_gain_slices(slices, simulated=(simulated,)))
    assert picture.labels[0] == ("kp (deg/(rad/s))", "ki (deg/(rad/s)/s)")
    assert set(picture.legend) == {
        "stable",
        "stability boundary",
        "Ms = 2",
        "damping 0.2",
        "controllers",
        "linear at 30 deg",
        "settles, simulated",
        "does not settle",
    }
    assert picture.holds([1.2], [2.0])
    assert picture.holds([0.98 * 1.5], [0.98 * 7.0])
    assert picture.holds([1.01 * 1.5], [1.01 * 7.0])
    texts = [text.get_text() for axes in picture.figure.axes for text in axes.texts]
    assert "c2d" in texts
    assert sum("rad/s" in text for text in texts) == 3


def test_the_boundary_is_one_line_from_axis_to_axis(check_figure: Check) -> None:
    """Vertical pieces of it included, with nothing left out between."""
    (entry,) = slices_of(G2.with_delay(0.0213), (0.1,))
    picture = check_figure(plot_gain_slices((entry,)))
    lines = [line for line in picture.figure.axes[0].lines if line.get_label() == "stability boundary"]
    assert len(lines) == 1
    kp, ki = lines[0].get_data()
    assert len(kp) == np.sum(entry.region.rim)
    assert (float(ki[0]), float(ki[-1])) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert float(np.max(np.hypot(np.diff(kp) / np.ptp(kp), np.diff(ki) / np.ptp(ki)))) < 0.03


def test_a_region_without_end_is_drawn_to_the_pictures_edge(check_figure: Check) -> None:
    mark = mark_controller("c", PidGains(kp=2.153, ki=16.85, kd=0.0, input_unit="rad/s", output_unit="deg", rule="r", designed_on="d"))
    picture = check_figure(plot_gain_slices(slices_of(G2, (0.0,), mark)))
    assert "stable, without end" in picture.legend
    assert picture.figure.axes[0].get_xlim()[1] == pytest.approx(1.15 * 2.153)
    free = check_figure(plot_gain_slices(slices_of(G2, (0.0,))))
    assert free.figure.axes[0].get_ylim()[1] > 4.0


def test_no_stabilising_gains_make_an_empty_panel(check_figure: Check) -> None:
    picture = check_figure(plot_gain_slices(slices_of(G2.with_delay(0.0213), (0.1, 0.4))))
    assert [axes.get_title() for axes in picture.figure.axes] == ["kd = 0.1", "kd = 0.4"]


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="there are no slices of gains to draw"):
        plot_gain_slices([])
    with pytest.raises(InvalidInputError, match="4 slices of gains do not stay legible"):
        plot_gain_slices(slices_of(G2, (0.0,)) * 4)


def test_slices_can_be_kept_and_sent_to_another_process() -> None:
    """A figure's arguments need a fingerprint, and go through a pickle."""
    one, two = (slices_of(G2.with_delay(0.0213), (0.0,), mark_controller("c2d", C2D)) for _ in range(2))
    assert figure_task("region", plot_gain_slices, one).identity == figure_task("region", plot_gain_slices, two).identity
    other = slices_of(G2.with_delay(0.022), (0.0,), mark_controller("c2d", C2D))
    assert figure_task("region", plot_gain_slices, other).identity != figure_task("region", plot_gain_slices, one).identity
    (again,) = pickle.loads(pickle.dumps(one))  # noqa: S301 - made in the same line
    assert np.array_equal(again.region.kp, one[0].region.kp)
    assert again.region.stabilises(1.0, 1.0) == one[0].region.stabilises(1.0, 1.0)
