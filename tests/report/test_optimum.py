import numpy as np
import pytest
from matplotlib.figure import Figure

from revline.design.optimum.competitors import Comparison, compare_with_competitors
from revline.design.optimum.optimum_problem import find_scale, make_grid
from revline.design.tuning.tuning_plant import tuning_plant
from revline.errors import InvalidInputError
from revline.lti.transfer_function import TransferFunction
from revline.report.optimum import plot_comparison
from tests.design.examples import C2D

MODEL = TransferFunction(
    numerator=(12.0,), denominator=(1.0, 0.551, 0.0355), delay=0.0214, input_name="throttle", input_unit="deg", output_unit="rad/s"
)


def test_controllers_stand_beside_their_optimum_with_units() -> None:
    plant, grid = tuning_plant(MODEL, name="g2d"), make_grid(MODEL)
    found = compare_with_competitors(plant, grid, find_scale(plant), {"c2d": C2D})
    figure = plot_comparison(found)
    assert isinstance(figure, Figure)
    plane, responses = figure.axes
    assert "Ms" in plane.get_xlabel()
    assert "rad per N m" in plane.get_ylabel()
    assert "s" in responses.get_xlabel()
    shown = [float(np.ravel(line.get_ydata())[0]) for line in plane.lines[:2]]
    assert shown == [found.competitors[0].cost.load, found.competitors[0].optimum.cost]
    with pytest.raises(InvalidInputError, match="there is no controller beside an optimum to draw"):
        plot_comparison(Comparison(plant="none", competitors=(), left_out=()))
