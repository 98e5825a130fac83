import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from revline.errors import InvalidInputError
from revline.io.csv_table import read_csv_table
from revline.io.csv_text import format_csv

NUMBERS = st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), min_size=1, max_size=20)


@given(rows=NUMBERS)
def test_numbers_come_back_to_the_last_bit(rows: list[tuple[float, float]], tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    first, second = np.array(rows).T
    path.write_text(format_csv([("time_s", first), ("speed_rad_s", second)], notes={"gain": 0.1}))
    table = read_csv_table(path)
    assert table.numbers("time_s").tobytes() == first.tobytes()
    assert table.numbers("speed_rad_s").tobytes() == second.tobytes()
    assert float(table.metadata["gain"]) == 0.1


def test_truth_values_are_one_and_zero_and_notes_stay_on_their_line() -> None:
    text = format_csv([("a", [1.5, 2.0]), ("stable", [True, False])], notes={"plant": "two\nlines", "n": 3})
    assert text == "# plant: two lines\n# n: 3\na,stable\n1.5,1\n2.0,0\n"


def test_columns_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"column b has shape \(1,\) beside one of \(2,\)"):
        format_csv([("a", [1.0, 2.0]), ("b", [1.0])], notes={})
    with pytest.raises(InvalidInputError, match="column a holds nan in row 2, which no file can hold"):
        format_csv([("a", [1.0, np.nan])], notes={})
