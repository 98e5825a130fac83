"""Turns at the processes: clients take turns, whoever asks most, and of a client's views that wait only the newest is answered."""

import asyncio
import itertools
from collections import Counter, OrderedDict, deque
from collections.abc import AsyncIterator, Awaitable, Mapping
from contextlib import asynccontextmanager
from typing import Any, Final, TypeVar

T = TypeVar("T")

AHEAD: Final = 4
"""A place that comes free looks among so many of the first clients for one that it worked for last: it is quicker at what it knows."""

PASSED: Final = 2
"""So many others may be taken before the first."""

HOMES: Final = 1024
"""Clients of whom it is remembered which place worked for them, at most; and machines of which it is when they had a turn."""

PATIENCE: Final = 5.0
"""Seconds that work goes on for a client that is gone: mostly it ends by then, and a process that is ended must warm up anew."""


class SupersededError(Exception):
    """A newer request of the same client came while this one waited."""


def machine_of(client: str) -> str:
    """Tell where a client asks from: the first word of its name is its address; the rest it may choose."""
    return client.partition(" ")[0]


class Turn:
    """A client's turn: the places that it has, and how many other clients wait for theirs.

    Attributes:
        places: that work for the client alone until they are given back.
        others: clients that wait.
    """

    def __init__(self, turns: "Turns", places: list[int], others: int) -> None:
        self._turns, self.places, self.others = turns, places, others

    async def work(self, place: int, done: Awaitable[T]) -> T:
        """Wait for what a place does, then give it back; where the client is gone meanwhile, as soon as the place is free.

        Args:
            place: one of the turn's.
            done: what it does.
        """
        task = asyncio.ensure_future(done)
        self.places.remove(place)
        try:
            return await asyncio.shield(task)
        finally:
            if task.done():
                self._turns.free(place)
            else:
                self._turns.leave(place, task)


class _Wish:
    """What a client waits for."""

    def __init__(self, *, newest: bool, most: int) -> None:
        self.newest, self.most = newest, most
        self.turn: asyncio.Future[Turn] = asyncio.get_running_loop().create_future()


class Turns:
    """Shares some places among clients: each has one turn at a time, and the client that waits longest comes next.

    Machines take turns too, so that one that asks under many names has no more of them than others.

    Args:
        places: how many.
    """

    def __init__(self, places: int) -> None:
        self._free = list(range(places))
        self._waiting: OrderedDict[str, deque[_Wish]] = OrderedDict()
        self._present: Counter[str] = Counter()
        self._homes: OrderedDict[str, int] = OrderedDict()
        self._machines: OrderedDict[str, None] = OrderedDict()
        self._passed = 0
        self._left: set[asyncio.Task[None]] = set()

    @property
    def clients(self) -> int:
        """How many clients have their turn or wait."""
        return len(self._present.keys() | self._waiting.keys())

    @property
    def unused(self) -> int:
        """How many places are free."""
        return len(self._free)

    @asynccontextmanager
    async def turn(self, client: str, *, newest: bool = False, most: int = 1) -> AsyncIterator[Turn]:
        """Wait for a client's turn.

        Args:
            client: who asks.
            newest: whether it takes the place of what the client asked for so before, and that still waits.
            most: places that can be used, where nobody else waits.

        Raises:
            SupersededError: the client asked for something newer meanwhile.
        """
        wish = self._ask(client, _Wish(newest=newest, most=most))
        try:
            turn = await wish.turn
        except BaseException:
            self._forget(client, wish)
            raise
        try:
            yield turn
        finally:
            self._go(client, turn.places)

    def free(self, place: int) -> None:
        """Take a place back."""
        self._free.append(place)
        self._serve()

    def leave(self, place: int, task: "asyncio.Future[Any]") -> None:
        """Take a place back when what it does for a client that is gone has ended, or was ended after a while."""

        async def wait() -> None:
            if not (await asyncio.wait([task], timeout=PATIENCE))[0]:
                task.cancel()
                await asyncio.wait([task])
            if not task.cancelled():
                task.exception()  # nobody asks for it any more
            self.free(place)

        waiting = asyncio.create_task(wait())
        self._left.add(waiting)
        waiting.add_done_callback(self._left.discard)

    def _ask(self, client: str, wish: _Wish) -> _Wish:
        wishes = self._waiting.setdefault(client, deque())
        if wish.newest and wishes and wishes[-1].newest:
            older = wishes.pop().turn
            if not older.done():  # else its client went just now
                older.set_exception(SupersededError())
        wishes.append(wish)
        self._serve()
        return wish

    def _forget(self, client: str, wish: _Wish) -> None:
        """Drop a wish that is waited for no more, or the turn that it was given just then."""
        wishes = self._waiting.get(client, deque())
        if wish in wishes:
            wishes.remove(wish)
            if not wishes:
                del self._waiting[client]
        elif wish.turn.done() and not wish.turn.cancelled() and wish.turn.exception() is None:
            self._go(client, wish.turn.result().places)

    def _serve(self) -> None:
        """Give free places to those who wait."""
        while self._free:
            client = self._next()
            if client is None:
                return
            wishes = self._waiting.pop(client)
            wish = wishes.popleft()
            if wishes:
                self._waiting[client] = wishes  # behind all others
            self._give(client, wish)

    def _next(self) -> str | None:
        """Who comes next: one of the first for whom a free place worked last, else the first."""
        ready = self._ready()
        if ready:
            machine = self._machine(dict.fromkeys(map(machine_of, ready)))
            ready = [client for client in ready if machine_of(client) == machine][:AHEAD]
            here = [client for client in ready if self._homes.get(client, self._free[0]) in self._free]
            self._passed = self._passed + 1 if here and here[0] != ready[0] and self._passed < PASSED else 0
            return here[0] if self._passed else ready[0]
        return next((client for client, wishes in self._waiting.items() if not wishes[0].newest), None)  # a program may use what is idle

    def _ready(self) -> list[str]:
        """Clients that wait and have no turn, in the order in which they are to have it."""
        return [client for client in self._waiting if client not in self._present]

    def _machine(self, machines: Mapping[str, None]) -> str:
        """Which of some machines had no turn for the longest, or none yet."""
        new = (machine for machine in machines if machine not in self._machines)
        return next(itertools.chain(new, (machine for machine in self._machines if machine in machines)))

    def _others(self, client: str) -> int:
        """How many turns of others come before a client's next one, if all wait on."""
        machines = Counter(machine_of(one) for one in self._ready())
        own = machines[machine_of(client)]
        return min(machines.total(), len(machines.keys() | {machine_of(client)}) * (own + 1) - 1)

    def _give(self, client: str, wish: _Wish) -> None:
        others = self._others(client)
        free, home = sorted(self._free), self._homes.get(client)
        alone = [home if home in free else free[0]]
        places = alone if others or wish.most == 1 else free[: wish.most]
        self._free = [place for place in free if place not in places]
        _remember(self._homes, client, places[0])
        _remember(self._machines, machine_of(client), None)
        if wish.turn.cancelled():  # its client went just now
            self._free += places
            return
        self._present[client] += 1
        wish.turn.set_result(Turn(self, places, others))

    def _go(self, client: str, places: list[int]) -> None:
        self._present[client] -= 1
        if not self._present[client]:
            del self._present[client]
        self._free += places
        self._serve()


def _remember(known: "OrderedDict[str, T]", name: str, value: T) -> None:
    """Note something of the last ones alone."""
    known[name] = value
    known.move_to_end(name)
    if len(known) > HOMES:
        known.popitem(last=False)
