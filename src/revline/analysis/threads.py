"""Independent runs on some threads: compiled simulations let go of the interpreter, so that threads share the cores."""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import TypeVar

from revline.errors import AnalysisError, out_of_range

T = TypeVar("T")
R = TypeVar("R")

PATIENCE = 0.1
"""Longest wait in s before an interruption is looked for again."""

Progress = Callable[[float], None]
"""Told from time to time which part of the runs is done, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A run without an outcome.

    Attributes:
        error: why: an analysis that could not be completed, or a KeyboardInterrupt.
    """

    error: AnalysisError | KeyboardInterrupt


def run_all(
    task: Callable[[T, Progress], R], items: Sequence[T], cost: Callable[[T], float], *, workers: int, progress: Progress | None = None
) -> list[R]:
    """Run a task for each item, the dearest first, and give the outcomes in the order of the items.

    Args:
        task: what to run; independent of the other items. It tells its second argument from time to time how far it is, which ends it where
            it is no longer wanted.
        items: what to run it for.
        cost: how long an item is expected to take, in any unit.
        workers: threads.
        progress: told which part of the items is done, in the calling thread.

    Returns:
        One outcome for each item.

    Raises:
        InvalidInputError: there is no worker. What a task raises is raised here, and so is an interruption; the other tasks end then.
    """
    outcomes: dict[int, R] = {}

    def keep(k: int, future: Future[R]) -> None:
        outcomes[k] = future.result()

    _run(task, items, cost, workers, progress or _ignore, keep)
    return [outcomes[k] for k in range(len(items))]


def run_each(
    task: Callable[[T, Progress], R], items: Sequence[T], cost: Callable[[T], float], *, workers: int, progress: Progress | None = None
) -> list[R | Failure]:
    """Run a task for each item as `run_all` does, and keep what is finished where others fail or the whole is interrupted.

    Args:
        task: what to run; independent of the other items. It tells its second argument from time to time how far it is, which ends it where
            it is no longer wanted.
        items: what to run it for.
        cost: how long an item is expected to take, in any unit.
        workers: threads.
        progress: told which part of the items is done, in the calling thread.

    Returns:
        One outcome for each item, or why there is none.

    Raises:
        InvalidInputError: there is no worker. What a task raises beyond an AnalysisError is raised here.
    """
    outcomes: dict[int, R | Failure] = {}

    def keep(k: int, future: Future[R]) -> None:
        try:
            outcomes[k] = future.result()
        except AnalysisError as error:
            outcomes[k] = Failure(error)

    interruption = KeyboardInterrupt()
    try:
        _run(task, items, cost, workers, progress or _ignore, keep)
    except KeyboardInterrupt as error:
        interruption = error
    return [outcomes.get(k, Failure(interruption)) for k in range(len(items))]


def _run(
    task: Callable[[T, Progress], R],
    items: Sequence[T],
    cost: Callable[[T], float],
    workers: int,
    progress: Progress,
    keep: Callable[[int, Future[R]], None],
) -> None:
    """Run all tasks, and hand each over as soon as it has ended; whatever is raised meanwhile ends the others."""
    if workers < 1:
        raise out_of_range("workers", workers, "threads", "1 and above", "give the number of threads")
    stop = threading.Event()

    def go_on(_: float) -> None:
        if stop.is_set():
            raise CancelledError

    order = sorted(range(len(items)), key=lambda k: -cost(items[k]))
    # A queue, because an interruption while `as_completed` holds the futures' locks would leave them locked for ever.
    ended: SimpleQueue[tuple[int, Future[R]]] = SimpleQueue()
    pool = ThreadPoolExecutor(max_workers=workers)
    try:
        for k in order:
            pool.submit(task, items[k], go_on).add_done_callback(partial(_hand_over, ended, k))
        for done in range(1, len(items) + 1):
            keep(*_wait_for(ended))
            progress(done / len(items))
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def _wait_for(ended: "SimpleQueue[tuple[int, Future[R]]]") -> "tuple[int, Future[R]]":
    """Take the next from a queue, waking up now and then: an interruption that comes just before a wait is only seen after it."""
    while True:
        try:
            return ended.get(timeout=PATIENCE)
        except Empty:
            continue


def _hand_over(ended: "SimpleQueue[tuple[int, Future[R]]]", k: int, future: "Future[R]") -> None:
    ended.put((k, future))


def _ignore(_: float) -> None:
    """Where nobody looks at progress."""
