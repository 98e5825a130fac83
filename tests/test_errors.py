import inspect

import pytest

from revline import errors
from revline.errors import AnalysisError, InvalidInputError, RevlineError, StepError, out_of_range, suggestion

ALL = [entry for _, entry in inspect.getmembers(errors, inspect.isclass) if entry.__module__ == errors.__name__]


@pytest.mark.parametrize("error", ALL, ids=lambda error: error.__name__)
def test_the_family_decides_the_exit_status(error: type[RevlineError]) -> None:
    assert issubclass(error, RevlineError)
    assert error.exit_status == (2 if issubclass(error, InvalidInputError | StepError) else 1)
    assert error is RevlineError or issubclass(error, AnalysisError) != issubclass(error, InvalidInputError)
    assert error.__doc__


def test_wrong_input_is_a_value_error_too() -> None:
    assert issubclass(InvalidInputError, ValueError)


def test_the_numbers_stand_in_details_and_cannot_change() -> None:
    error = RevlineError("speed fell to 0 rad/s", speed=0.0, time=1.5)
    assert str(error) == "speed fell to 0 rad/s"
    assert dict(error.details) == {"speed": 0.0, "time": 1.5}
    with pytest.raises(TypeError, match="does not support item assignment"):
        error.details["speed"] = 1.0  # type: ignore[index]  # that is what must fail


def test_out_of_range_words_quantity_value_unit_limit_and_remedy() -> None:
    error = out_of_range("throttle", 95.0, "deg", "0 to 90 deg", "give a value in that range")
    assert str(error) == "throttle = 95 deg is outside 0 to 90 deg; give a value in that range"
    assert dict(error.details) == {"quantity": "throttle", "value": 95.0, "limit": "0 to 90 deg"}


def test_a_suggestion_names_the_nearest_or_nothing() -> None:
    assert suggestion("Throtle", ("spark", "throttle")) == ", did you mean throttle?"
    assert suggestion("qqq", ("spark", "throttle")) == ""
    assert suggestion("throttle", ()) == ""
