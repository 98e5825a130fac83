from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.errors import InvalidInputError
from revline.lti.response import FrequencyResponse
from revline.lti.transfer_function import TransferFunction
from revline.report.bode import BodeTrace, ErrorTrace, plot_bode, plot_closed_loop_bode, plot_phase_line, plot_response_errors
from revline.report.style import DATA

Check = Callable[[Figure], Any]
OMEGA = np.geomspace(0.01, 100.0, 42)
G2D = TransferFunction(numerator=(12.0,), denominator=(1.0, 0.55, 0.034), delay=0.0213, input_unit="deg", output_unit="rad/s")


def response(model: TransferFunction = G2D, omega: np.ndarray = OMEGA) -> FrequencyResponse:
    return model.response(omega)


def test_a_bode_plot_shows_decibels_and_degrees(check_figure: Check) -> None:
    model = response()
    picture = check_figure(plot_bode([BodeTrace(model, "engine", DATA), BodeTrace(model, "G2d")]))
    assert picture.holds(OMEGA, model.magnitude_db, axes=0)
    assert picture.holds(OMEGA, model.phase_deg, axes=1)
    assert picture.legend == ["engine", "G2d"]
    assert [y for _, y in picture.labels] == ["magnitude\n(dB re 1 rad/s per deg)", "phase (deg)"]
    assert picture.labels[1][0] == "frequency (rad/s)"
    assert [axes.get_xscale() for axes in picture.figure.axes] == ["log", "log"]


def test_a_closed_loop_has_its_bandwidth_marked(check_figure: Check) -> None:
    loop = TransferFunction(numerator=(1.0,), denominator=(1.0, 0.1), input_unit="rad/s", output_unit="rad/s")
    picture = check_figure(plot_closed_loop_bode([BodeTrace(response(loop), "closed loop")], bandwidth=10.0))
    assert picture.notes(0) == ["10.00 rad/s"]
    assert picture.legend == ["closed loop", "\N{MINUS SIGN}3.01 dB", "bandwidth"]
    assert picture.labels[0][1] == "magnitude (dB)"
    level = 20.0 * np.log10(1.0 / np.sqrt(2.0))
    assert picture.holds([10.0], [level])
    assert picture.holds([0.0, 1.0], [level, level])
    assert all(any(np.array_equal(line.get_xdata(), [10.0, 10.0]) for line in axes.lines) for axes in picture.figure.axes)


def test_errors_are_shown_with_the_largest_marked(check_figure: Check) -> None:
    decibels, degrees = np.sin(OMEGA / 30.0), -3.0 * np.sqrt(OMEGA)
    picture = check_figure(plot_response_errors([ErrorTrace(OMEGA, decibels, degrees, "G1")]))
    assert picture.holds(OMEGA, decibels, axes=0)
    assert picture.holds(OMEGA, degrees, axes=1)
    worst = OMEGA[np.argmax(np.abs(decibels))]
    assert picture.notes(0) == [f"{decibels.max():.3g} dB at {worst:g} rad/s"]
    assert picture.notes(1) == ["\N{MINUS SIGN}30 deg at 100 rad/s"]
    assert [y for _, y in picture.labels] == ["magnitude error (dB)", "phase error (deg)"]


def test_errors_of_several_models_are_told_apart_without_marks(check_figure: Check) -> None:
    traces = [ErrorTrace(OMEGA, k * OMEGA, -k * OMEGA, f"G{k}") for k in (1, 2, 3)]
    picture = check_figure(plot_response_errors(traces))
    assert picture.legend == ["G1", "G2", "G3"]
    assert picture.notes(0) == []


def test_the_phase_line_says_the_delay(check_figure: Check) -> None:
    degrees = np.rad2deg(0.01 - 0.0213 * OMEGA)
    picture = check_figure(plot_phase_line(OMEGA, degrees, slope=-0.0213, intercept_deg=float(np.rad2deg(0.01))))
    assert picture.holds(OMEGA, degrees * (np.pi / 180.0))
    assert picture.holds([0.0, 100.0], [0.01, 0.01 - 2.13])
    assert picture.legend == ["straight line, slope \N{MINUS SIGN}0.0213 s: delay 21.3 ms", "data less model"]
    assert picture.labels == [("frequency (rad/s)", "phase difference (rad)")]


def test_what_cannot_be_drawn_is_refused() -> None:
    own = BodeTrace(response(), "G2d")
    other = BodeTrace(response(TransferFunction(numerator=(1.0,), denominator=(1.0, 1.0))), "loop")
    zero = BodeTrace(response(omega=np.array([0.0, 1.0])), "static")
    with pytest.raises(InvalidInputError, match="there are no frequency responses to draw"):
        plot_bode([])
    with pytest.raises(InvalidInputError, match=r"responses 'G2d' in rad/s per deg and 'loop' in 1 per 1 cannot share an axis"):
        plot_bode([own, other])
    with pytest.raises(InvalidInputError, match="response 'static' has a frequency of 0 rad/s or below"):
        plot_bode([zero])
    with pytest.raises(InvalidInputError, match=r"bandwidth = nan rad/s is outside the positive numbers"):
        plot_closed_loop_bode([own], bandwidth=float("nan"))
    with pytest.raises(InvalidInputError, match=r"level = 0 as a magnitude is outside the positive numbers"):
        plot_closed_loop_bode([own], bandwidth=1.0, level=0.0)
    with pytest.raises(InvalidInputError, match="there are no errors to draw"):
        plot_response_errors([])
    with pytest.raises(InvalidInputError, match=r"errors of G1 cannot be drawn: frequency of shape \(2,\)"):
        plot_response_errors([ErrorTrace([1.0, 2.0], [0.0], [0.0, 1.0], "G1")])
    with pytest.raises(InvalidInputError, match="errors of G1 has a frequency of 0 rad/s or below"):
        plot_response_errors([ErrorTrace([0.0, 2.0], [0.0, 0.0], [0.0, 1.0], "G1")])
    with pytest.raises(InvalidInputError, match=r"phase\[0\] = nan is not finite"):
        plot_phase_line([1.0], [np.nan], slope=-0.1, intercept_deg=0.0)
    with pytest.raises(InvalidInputError, match="a phase line of slope nan s and intercept 0 deg cannot be drawn"):
        plot_phase_line([1.0], [1.0], slope=float("nan"), intercept_deg=0.0)
