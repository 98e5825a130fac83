import signal
import threading
import time
from collections.abc import Callable

import pytest

from revline.analysis.threads import Failure, run_all, run_each
from revline.errors import AnalysisError, InvalidInputError


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_outcomes_stand_in_the_order_of_the_items(workers: int) -> None:
    done: list[float] = []
    assert run_all(lambda k, _: k * k, [3, 1, 2], lambda k: -k, workers=workers, progress=done.append) == [9, 1, 4]
    assert done == pytest.approx([1 / 3, 2 / 3, 1.0])


def test_the_dearest_item_runs_first() -> None:
    seen: list[int] = []
    run_all(lambda k, _: seen.append(k), [3, 1, 2], float, workers=1)
    assert seen == [3, 2, 1]


def test_two_workers_run_at_the_same_time() -> None:
    """Each task waits for the other: one worker alone would never end."""
    meeting = threading.Barrier(2)
    assert sorted(run_all(lambda _, __: meeting.wait(timeout=10.0), [0, 1], float, workers=2)) == [0, 1]


def test_an_error_is_raised_and_stops_what_has_not_begun() -> None:
    seen: list[int] = []

    def task(k: int, _: object) -> None:
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
        run_all(lambda k, _: k, [1], float, workers=0)


def test_what_is_finished_is_kept_where_another_fails() -> None:
    def task(k: int, _: object) -> int:
        if k == 2:
            message = "no answer at 2"
            raise AnalysisError(message)
        return k * k

    found = run_each(task, [1, 2, 3], float, workers=2)
    assert (found[0], found[2]) == (1, 9)
    assert isinstance(found[1], Failure)
    assert str(found[1].error) == "no answer at 2"


def test_a_fault_of_the_program_is_no_failure_of_one_item() -> None:
    def task(k: int, _: object) -> float:
        return 1.0 / k

    with pytest.raises(ZeroDivisionError):
        run_each(task, [0, 1], float, workers=1)


def endless_after_one(k: int, going: Callable[[float], None]) -> int:
    """The first item ends at once; the others wait until they are ended, and the second sends the interruption."""
    if k == 3:
        return k
    if k == 2:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    while True:
        going(0.0)
        time.sleep(0.001)


def test_an_interruption_ends_what_runs_and_keeps_what_is_finished() -> None:
    begun = time.perf_counter()
    found = run_each(endless_after_one, [1, 2, 3], float, workers=1)
    assert time.perf_counter() - begun < 5.0
    assert found[2] == 3
    assert all(isinstance(entry, Failure) and isinstance(entry.error, KeyboardInterrupt) for entry in found[:2])


def test_an_interruption_of_all_is_raised() -> None:
    with pytest.raises(KeyboardInterrupt):
        run_all(endless_after_one, [1, 2, 3], float, workers=1)
