"""Types of parameters, found once for each shape."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import typeof

from revline.dde.memory import as_floats, parameter_type
from revline.dde.run import state_type
from revline.engine.lee1995 import LEE_1995, lee1995
from revline.errors import InvalidInputError


class Inner(NamedTuple):
    first: float
    second: float


class Other(NamedTuple):
    first: float
    second: float


class Outer(NamedTuple):
    inner: Inner | Other | tuple[float, ...]
    last: float


PARAMETERS = (
    LEE_1995,
    Outer(Inner(1.0, 2.0), 3.0),
    Outer(Other(1.0, 2.0), 3.0),
    Outer((1.0, 2.0), 3.0),
    Outer(Inner(1, 2), 3),
    (1.0,),
    (1.0, (2.0, 3.0)),
)


@pytest.mark.parametrize("parameters", PARAMETERS, ids=lambda p: str(p)[:40])
def test_the_type_of_parameters_is_that_of_their_floats(parameters: Any) -> None:
    assert parameter_type(parameters) == typeof(as_floats(parameters, "p"))


def test_parameters_of_other_classes_have_other_types() -> None:
    assert len({parameter_type(parameters) for parameters in PARAMETERS[1:4]}) == 3


@pytest.mark.parametrize("value", [float("nan"), np.float64("nan"), "text", None])
def test_a_parameter_that_is_no_number_is_named_beside_good_ones(value: Any) -> None:
    with pytest.raises(InvalidInputError, match=r"parameter p\.inner\.second = .* is no number"):
        as_floats(Outer(Inner(1.0, value), 3.0), "p")


def test_systems_of_like_size_share_one_layout() -> None:
    assert state_type(lee1995()) is state_type(lee1995())
