"""Processes that answer questions: kept warm, limited in time and memory, and replaced when they end."""

import asyncio
import multiprocessing
import os
import resource
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from http import HTTPStatus
from typing import Any, Final, TypeVar

from pebble import ProcessExpired, ProcessPool

from revline.web.answers import warm_up
from revline.web.problems import make_problem
from revline.web.turns import Turns

T = TypeVar("T")

GIBIBYTE: Final = 2**30

ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Each process computes on one thread; side by side are the processes."""


class WorkerError(Exception):
    """A process gave no answer; `problem` says why."""

    def __init__(self, kind: str, title: str, detail: str) -> None:
        super().__init__(detail)
        self.problem = make_problem(kind, title, detail, status=HTTPStatus.SERVICE_UNAVAILABLE)


class Workers:
    """Some processes for one kind of work.

    Args:
        count: how many.
        seconds: that one question may take; a process that takes longer is ended and replaced.
        memory: bytes of address space that a process may have.
        niceness: by how much it stands back where the processors are busy.
    """

    def __init__(self, *, count: int, seconds: float, memory: int, niceness: int = 0) -> None:
        for name in ONE_THREAD:
            os.environ.setdefault(name, "1")
        self._seconds, self._memory, self._niceness = seconds, memory, niceness
        self.count = count
        self._pool = self._make()

    def _make(self) -> ProcessPool:
        context = multiprocessing.get_context("spawn")
        return ProcessPool(max_workers=self.count, context=context, initializer=limit_process, initargs=[self._memory, self._niceness])

    async def ask(self, function: Callable[..., T], *arguments: object) -> T:
        """Have a process compute.

        Args:
            function: found by its module and name in the process.
            arguments: of the function.

        Raises:
            WorkerError: the process ended, or took too long or too much memory; it has been replaced.
        """
        try:
            found: T = await self._schedule(function, arguments)
        except BrokenProcessPool:  # a process was killed while it had nothing to do; this question was never begun
            found = await self._schedule(function, arguments)
        return found

    async def _schedule(self, function: Callable[..., T], arguments: tuple[object, ...]) -> T:
        if not self._pool.active:
            broken, self._pool = self._pool, self._make()
            await asyncio.to_thread(_end, broken)
        future = self._pool.schedule(function, args=list(arguments), timeout=self._seconds)
        try:
            found: T = await asyncio.wrap_future(future)
        except TimeoutError as error:
            detail = f"the answer took longer than {self._seconds:g} s and was given up; ask for less, or run it on the command line"
            raise WorkerError("took-too-long", "the answer took too long", detail) from error
        except ProcessExpired as error:
            detail = f"the process that computed the answer ended ({error}); it was replaced: ask again, or for less"
            raise WorkerError("process-ended", "the process ended", detail) from error
        except MemoryError as error:
            detail = "the answer needed more memory than a process may have; ask for less, or run it on the command line"
            raise WorkerError("out-of-memory", "the answer needs too much memory", detail) from error
        return found

    async def warm_up(self) -> None:
        """Have each process import and compile what a page asks for."""
        await asyncio.gather(*(asyncio.wrap_future(self._pool.schedule(warm_up)) for _ in range(self.count)))

    def stop(self) -> None:
        """End all processes."""
        _end(self._pool)


class Crew:
    """Processes for one kind of work, shared by clients in turns; each has its own work, so that it is given what it has begun already.

    Args:
        count: how many.
        seconds: that one question may take.
        memory: bytes of address space that each may have.
        niceness: by how much each stands back where the processors are busy.
    """

    def __init__(self, *, count: int, seconds: float, memory: int, niceness: int = 0) -> None:
        self._workers = tuple(Workers(count=1, seconds=seconds, memory=memory, niceness=niceness) for _ in range(count))
        self.turns = Turns(count)

    @property
    def count(self) -> int:
        """How many processes there are."""
        return len(self._workers)

    async def ask(self, client: str, function: Callable[..., T], *arguments: object) -> T:
        """Have one of the processes compute when the client's turn comes.

        Args:
            client: who asks.
            function: found by its module and name in the process.
            arguments: of the function.

        Raises:
            WorkerError: as `Workers.ask`.
        """
        async with self.turns.turn(client) as turn:
            place = turn.places[0]
            return await turn.work(place, self.at(place, function, *arguments))

    async def at(self, place: int, function: Callable[..., T], *arguments: object) -> T:
        """Have the process of a place compute, for whoever has its turn there."""
        return await self._workers[place].ask(function, *arguments)

    async def warm_up(self) -> None:
        """Have each process import and compile what a page asks for."""
        await asyncio.gather(*(workers.warm_up() for workers in self._workers))

    def stop(self) -> None:
        """End all processes."""
        for workers in self._workers:
            workers.stop()


def _end(pool: Any) -> None:
    pool.stop()
    pool.join()


def limit_process(memory: int, niceness: int) -> None:
    """Limit the address space of this process, in bytes, and let it stand back."""
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    if niceness:
        os.nice(niceness)
