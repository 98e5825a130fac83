import numpy as np
import pytest

from revline.design.controllers.controller import PidGains
from revline.design.stability.compared_plant import plant_of_model
from revline.design.stability.nu_gap import Guarantee, judge_controller
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction
from revline.report.nu_gap import plot_nu_gap


def verdict(delay: float) -> Guarantee:
    first, second = (
        plant_of_model(TransferFunction(numerator=(2.0,), denominator=(1.0, 0.8), delay=tau, input_unit="deg", output_unit="rad/s"))
        for tau in (0.0, delay)
    )
    gains = PidGains(kp=3.0, ki=4.0, kd=0.0, input_unit="rad/s", output_unit="deg", rule="by hand", designed_on="a test")
    return judge_controller(first, second, gains)


def test_each_verdict_has_its_chords_its_margin_and_its_gap() -> None:
    near, far = verdict(0.02), verdict(0.5)
    figure = plot_nu_gap([("near", near), ("far", far)])
    assert [axes.get_title() for axes in figure.axes] == ["near", "far"]
    for axes, found in zip(figure.axes, (near, far), strict=True):
        loop, psi, margin, gap = axes.lines
        np.testing.assert_array_equal(psi.get_ydata(), found.gap.psi)
        np.testing.assert_array_equal(loop.get_ydata(), found.chords)
        assert np.asarray(margin.get_ydata())[0] == found.margin
        assert np.asarray(gap.get_ydata())[0] == found.gap.value
    assert figure.axes[0].get_ylabel() == "chord (\N{EN DASH})"
    shaded = [sum(np.asarray(path.vertices).size for path in axes.collections[0].get_paths()) for axes in figure.axes]
    assert shaded[0] == 0 < shaded[1]


def test_what_cannot_be_drawn_is_refused() -> None:
    found = ("it", verdict(0.1))
    with pytest.raises(InvalidInputError, match="there are no verdicts to draw"):
        plot_nu_gap([])
    with pytest.raises(InvalidInputError, match="4 verdicts do not fit in one figure"):
        plot_nu_gap([found] * 4)
    with pytest.raises(InvalidInputError, match="from 10 to 1 rad/s show nothing"):
        plot_nu_gap([found], span=(10.0, 1.0))
