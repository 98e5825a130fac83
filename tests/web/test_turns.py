"""Turns: of a client's views the newest is answered, no client waits for another's flood, and who goes leaves its place."""

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from revline.web import turns as turns_module
from revline.web.turns import SupersededError, Turns


def run(test: Callable[[], Awaitable[Any]]) -> Any:
    async def within() -> Any:
        async with asyncio.timeout(5.0):
            return await test()

    return asyncio.run(within())


class Hand:
    """Takes turns at two places or so, and notes who had which; a turn lasts until it is let go."""

    def __init__(self, places: int = 1) -> None:
        self.turns, self.order = Turns(places), list[tuple[str, int]]()
        self.holds: dict[str, asyncio.Event] = {}

    def take(self, client: str, name: str = "", **options: Any) -> "asyncio.Task[int]":
        name = name or client
        self.holds[name] = asyncio.Event()

        async def work() -> int:
            async with self.turns.turn(client if " " in client else f"here {client}", **options) as turn:
                self.order.append((name, turn.places[0]))
                await self.holds[name].wait()
                return turn.others

        return asyncio.create_task(work())

    async def go(self, name: str) -> None:
        self.holds[name].set()
        await pause()

    @property
    def names(self) -> list[str]:
        return [name for name, _ in self.order]


async def pause() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


def test_of_a_client_s_views_that_wait_only_the_newest_is_answered() -> None:
    async def test() -> None:
        hand = Hand()
        tasks = [hand.take("a", f"a{k}", newest=True) for k in range(4)]
        other = hand.take("b", newest=True)
        await pause()
        assert hand.names == ["a0"]
        await hand.go("a0")
        assert hand.names == ["a0", "a3"]  # waiting since before b came, as a1
        await hand.go("a3")
        hand.holds["b"].set()
        found = await asyncio.gather(*tasks, other, return_exceptions=True)
        assert hand.names == ["a0", "a3", "b"]
        assert [found[0], found[3], found[4]] == [0, 1, 0]
        assert [type(one) for one in found[1:3]] == [SupersededError, SupersededError]
        assert (hand.turns.clients, hand.turns.unused) == (0, 1)

    run(test)


def test_one_that_asks_for_much_does_not_keep_others_waiting() -> None:
    async def test() -> None:
        hand = Hand()
        flood = [hand.take("program", f"p{k}") for k in range(20)]
        pages = [hand.take(name, newest=True) for name in ("a", "b")]
        await pause()
        for name in ("p0", "p1", "a", "b"):
            await hand.go(name)
        assert hand.names == ["p0", "p1", "a", "b", "p2"]  # p1 asked before the pages did
        for k in range(2, 20):
            await hand.go(f"p{k}")
        await asyncio.gather(*flood, *pages)
        assert [name for name in hand.names if name[0] == "p"] == [f"p{k}" for k in range(20)]

    run(test)


def test_a_machine_that_asks_under_many_names_has_no_more_turns_than_another() -> None:
    async def test() -> None:
        hand = Hand()
        flood = [hand.take(f"there {k}", f"t{k}") for k in range(12)]
        await pause()
        pages = [hand.take("here page", "p0"), hand.take("here tab", "p1"), hand.take("elsewhere page", "e")]
        await pause()
        for name in ("t0", "p0", "e", "t1", "p1"):
            assert hand.names[-1] == name
            await hand.go(name)
        assert hand.names == ["t0", "p0", "e", "t1", "p1", "t2"]
        late = hand.take("here page", "p2")
        await hand.go("t2")
        assert hand.names[-1] == "p2"
        await hand.go("p2")
        for k in range(3, 12):
            await hand.go(f"t{k}")
        found = await asyncio.gather(*flood, *pages, late)
        # What is told of others is how many turns come before one's own next: of 13 clients from 2 machines, not 13.
        assert found[0] == 0
        assert found[-1] == 1

    run(test)


def test_a_program_alone_uses_all_places_and_a_page_its_two_together() -> None:
    async def test() -> None:
        hand = Hand(2)
        tasks = [hand.take("program", f"p{k}") for k in range(3)]
        await pause()
        assert hand.order == [("p0", 0), ("p1", 1)]
        for k in range(3):
            await hand.go(f"p{k}")
        async with hand.turns.turn("page", newest=True, most=2) as turn:
            assert turn.places == [0, 1]
            waits = hand.take("other")
            await pause()
            assert hand.names == ["p0", "p1", "p2"]
        hand.holds["other"].set()
        await asyncio.gather(*tasks, waits)

    run(test)


def test_places_work_for_whom_they_know_but_nobody_is_passed_over_for_long() -> None:
    async def test() -> list[tuple[str, int]]:
        hand = Hand(2)
        clients = [f"c{k}" for k in range(6)]
        for _ in range(8):
            tasks = [hand.take(client, newest=True) for client in clients]
            await pause()
            for _ in clients:
                held = next(name for name, event in hand.holds.items() if name in hand.names and not event.is_set())
                await hand.go(held)
            await asyncio.gather(*tasks)
        return hand.order

    order = run(test)
    rounds = [order[k : k + 6] for k in range(0, 48, 6)]
    assert all({name for name, _ in one} == {f"c{k}" for k in range(6)} for one in rounds)
    kept = sum(dict(one)[name] == dict(before)[name] for before, one in itertools.pairwise(rounds) for name in dict(one))
    assert kept > 30  # of 42; by chance half of them


def test_who_goes_while_waiting_is_forgotten() -> None:
    async def test() -> None:
        hand = Hand()
        first, gone, last = hand.take("a"), hand.take("b"), hand.take("c")
        await pause()
        gone.cancel()
        await pause()
        assert hand.turns.clients == 2
        await hand.go("a")
        await hand.go("c")
        await asyncio.gather(first, last)
        assert hand.names == ["a", "c"]
        assert (hand.turns.clients, hand.turns.unused) == (0, 1)

    run(test)


def test_a_newer_view_is_answered_where_an_older_one_s_connection_closes_at_the_same_moment() -> None:
    async def test() -> None:
        hand = Hand()
        first, older = hand.take("x"), hand.take("a", "older", newest=True)
        await pause()
        newer = hand.take("a", "newer", newest=True)  # its turn of the loop comes first ...
        older.cancel()  # ... and the older one's afterwards
        await pause()
        await hand.go("x")
        await hand.go("newer")
        assert hand.names == ["x", "newer"]
        assert list(await asyncio.gather(first, newer)) == [0, 0]
        assert older.cancelled()
        assert (hand.turns.clients, hand.turns.unused) == (0, 1)

    run(test)


@pytest.mark.parametrize("given", [False, True])
def test_who_goes_at_the_moment_of_its_turn_leaves_it_to_the_next(given: bool) -> None:  # noqa: FBT001 - a parameter of a test
    async def test() -> None:
        hand = Hand()
        first, gone, last = hand.take("x"), hand.take("a"), hand.take("b")
        await pause()
        hand.holds["x"].set()
        if given:
            await asyncio.sleep(0)  # x ends its turn: a has it, and does not know yet
        gone.cancel()
        await pause()
        assert hand.names == ["x", "b"]
        await hand.go("b")
        await asyncio.gather(first, last)
        assert gone.cancelled()
        assert (hand.turns.clients, hand.turns.unused) == (0, 1)

    run(test)


def test_a_client_whose_place_is_taken_for_long_is_passed_over_a_few_times_only() -> None:
    async def test() -> None:
        hand = Hand(2)
        for place, client in ((0, "near"), (1, "w"), (0, "o1"), (0, "o2"), (0, "o3")):  # each at home at its place
            held = [hand.take("x")] if place else []
            await pause()
            task = hand.take(client)
            await pause()
            assert hand.order[-1] == (client, place)
            for name in (client, *("x" for _ in held)):
                await hand.go(name)
            await asyncio.gather(task, *held)
        tasks = [hand.take(name) for name in ("near", "far", "w", "o1", "o2", "o3")]
        await pause()
        assert hand.order[-2:] == [("near", 0), ("far", 1)]  # far keeps the place that w knows
        for name in ("near", "o1", "o2", "w", "o3"):
            await hand.go(name)
        assert hand.order[-4:] == [("o1", 0), ("o2", 0), ("w", 0), ("o3", 0)]
        await hand.go("far")
        await asyncio.gather(*tasks)

    run(test)


def test_where_clients_worked_is_remembered_of_the_last_ones_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns_module, "HOMES", 2)

    async def test() -> list[int]:
        hand = Hand(2)
        places = []
        for name in ("x", "a", "b", "a", "c", "a", "d", "e", "a"):  # x keeps the first place until a knows the second
            task = hand.take(name)
            await pause()
            places.append(hand.order[-1][1])
            if name != "x":
                await hand.go(name)
                await task
            if len(places) == 2:
                await hand.go("x")
        return places

    assert run(test) == [0, 1, 0, 1, 0, 1, 0, 0, 0]  # a, after two others, is as new


@pytest.mark.parametrize("lasting", [False, True])
def test_who_goes_while_a_process_works_gives_its_place_back_once_that_has_ended(lasting: bool, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: FBT001 - a parameter of a test
    monkeypatch.setattr(turns_module, "PATIENCE", 0.05)

    async def test() -> None:
        turns, done = Turns(1), asyncio.Event()
        ended: list[str] = []

        async def compute() -> None:
            try:
                await done.wait()
            finally:
                ended.append("by itself" if done.is_set() else "by force")

        async def page() -> None:
            async with turns.turn("a") as turn:
                await turn.work(turn.places[0], compute())

        asked = asyncio.create_task(page())
        await pause()
        asked.cancel()
        await pause()
        assert (turns.clients, turns.unused, ended) == (0, 0, [])
        if not lasting:
            done.set()
        async with turns.turn("b") as turn:
            assert turn.places == [0]
        assert ended == ["by force" if lasting else "by itself"]

    run(test)
