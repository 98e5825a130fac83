"""Independent runs on some threads: compiled simulations let go of the interpreter, so that threads share the cores."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from typing import TypeVar

from revline.errors import out_of_range

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[float], None]
"""Told from time to time which part of the runs is done, 0 to 1."""


def run_all(
    task: Callable[[T], R],
    items: Sequence[T],
    cost: Callable[[T], float],
    *,
    workers: int,
    progress: Progress | None = None,
) -> list[R]:
    """Run a task for each item, the dearest first, and give the outcomes in the order of the items.

    Args:
        task: what to run; independent of the other items.
        items: what to run it for.
        cost: how long an item is expected to take, in any unit.
        workers: threads.
        progress: told which part of the items is done, in the calling thread.

    Returns:
        One outcome for each item.

    Raises:
        InvalidInputError: there is no worker. What a task raises is raised here; tasks not yet begun are then left out.
    """
    if workers < 1:
        raise out_of_range("workers", workers, "threads", "1 and above", "give the number of threads")
    order = sorted(range(len(items)), key=lambda k: -cost(items[k]))
    pool = ThreadPoolExecutor(max_workers=workers)
    try:
        futures: dict[int, Future[R]] = {k: pool.submit(task, items[k]) for k in order}
        for done, future in enumerate(as_completed(futures.values()), start=1):
            future.result()
            if progress is not None:
                progress(done / len(items))
    finally:
        pool.shutdown(cancel_futures=True)
    return [futures[k].result() for k in range(len(items))]
