import threading
import time

import pytest

from revline.analysis.threads import run_all
from revline.errors import InvalidInputError


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_outcomes_stand_in_the_order_of_the_items(workers: int) -> None:
    done: list[float] = []
    assert run_all(lambda k: k * k, [3, 1, 2], lambda k: -k, workers=workers, progress=done.append) == [9, 1, 4]
    assert done == pytest.approx([1 / 3, 2 / 3, 1.0])


def test_the_dearest_item_runs_first() -> None:
    seen: list[int] = []
    run_all(seen.append, [3, 1, 2], float, workers=1)
    assert seen == [3, 2, 1]


def test_two_workers_run_at_the_same_time() -> None:
    """Each task waits for the other: one worker alone would never end."""
    meeting = threading.Barrier(2)
    assert sorted(run_all(lambda _: meeting.wait(timeout=10.0), [0, 1], float, workers=2)) == [0, 1]


def test_an_error_is_raised_and_stops_what_has_not_begun() -> None:
    seen: list[int] = []

    def task(k: int) -> None:
        seen.append(k)
        if k == 49:
            message = f"task {k}"
            raise ValueError(message)
        time.sleep(0.02)

    with pytest.raises(ValueError, match="task 49"):
        run_all(task, list(range(50)), float, workers=1)
    assert len(seen) < 50


def test_no_workers_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="workers = 0 threads is outside 1 and above"):
        run_all(float, [1], float, workers=0)
