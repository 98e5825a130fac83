"""Many pages at once: parts are shared where they are the same, left for later only where that is allowed, and none is lost."""

import asyncio
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from revline.errors import InvalidInputError
from revline.web.answers import answer_parts, answer_promises
from revline.web.kept import OF_PART, Kept, key_of
from revline.web.state import State, parse_state
from revline.web.turns import Turns
from revline.web.view.build import PARTS
from revline.web.views import FEW, ORDER, Views
from revline.web.workers import WorkerError

CHANGES: dict[str, Any] = {
    "engine": "lee1995-generic",
    "speed_rad_s": 260.0,
    "parameters": {"rotation.inertia": 0.2},
    "throttle_deg": 30.0,
    "load_n_m": 3.0,
    "amplitude_deg": 4.0,
    "kp": 0.8,
    "ki": 3.0,
    "kd": 0.05,
    "step": "throttle",
    "command_rad_s": 20.0,
    "load_step_n_m": 2.0,
    "throttle_step_deg": 2.0,
    "until_s": 3.0,
    "low_deg": 1.0,
    "high_deg": 70.0,
}
QUICK = ("point", "response", "models", "roots", "gains", "margins", "loop_roots", "promises", "loop", "answers")


BASES: tuple[tuple[dict[str, Any], Sequence[str]], ...] = (
    ({}, (*QUICK, "map", "validity", "contours", "peaks")),
    ({"speed_rad_s": 250.0, "step": "load", "kp": 0.4, "ki": 1.0, "kd": 0.0}, ("point", "loop")),
    ({"step": "throttle"}, ("loop",)),
    ({"low_deg": 20.0, "high_deg": 30.0}, ("loop",)),
)
"""States, and the parts of each that are held against the table."""


def test_what_a_part_is_kept_by_is_all_that_it_depends_on() -> None:
    """All that `OF_PART` leaves out of a part is changed at once: were the part changed by it, a page would be shown another's numbers."""
    for base, parts in BASES:
        for name in parts:
            state = {**base, **{key: value for key, value in CHANGES.items() if key not in OF_PART.get(name, CHANGES)}}
            same = key_of(name, parse_state(base).model_dump()) == key_of(name, parse_state(state).model_dump())
            assert same, name
            assert answer_parts(base, [name]) == answer_parts(state, [name]), (name, base)
    assert set(ORDER) == set(QUICK)


def test_what_a_part_is_kept_by_tells_states_apart() -> None:
    entries = parse_state({}).model_dump()
    for name in PARTS:
        for key in set(entries) - {"schema"}:
            other = {**entries, key: CHANGES[key]}
            assert (key_of(name, entries) == key_of(name, other)) == (name in OF_PART and key not in OF_PART[name]), (name, key)


def test_the_page_asks_by_what_the_server_keeps_by() -> None:
    """The page's table of what parts depend on is the server's, which is held against the parts themselves above."""
    source = (Path(__file__).parents[2] / "page" / "src" / "needs.ts").read_text(encoding="utf-8")
    lists = {
        name: re.findall(r'"(\w+)"', body) for name, body in re.findall(r"const (\w+): readonly Key\[\] = \[(.*?)\];", source, re.DOTALL)
    }
    table = source[source.index("const OF_PART") : source.index("const ALL")]
    found = {}
    for part, one, many in re.findall(r"^  (\w+): (?:(\w+)|\[(.*?)\]),$", table, re.MULTILINE | re.DOTALL):
        spread = re.sub(r"\.\.\.(\w+)", lambda name: ",".join(f'"{key}"' for key in lists[name[1]]), many)
        found[part] = set(lists[one] if one else re.findall(r'"(\w+)"', spread))
    assert found == {part: set(keys) for part, keys in OF_PART.items()}


def test_kept_answers_are_bounded_and_the_oldest_are_forgotten() -> None:
    kept = Kept(size=1000)
    keys = [key_of("margins", {"kp": float(k)}) for k in range(20)]
    for key in keys:
        kept.keep(key, 100 * b"x")
        kept.find({"margins": keys[0]})  # asked for again and again
    assert kept.size == 1000
    found = [k for k, key in enumerate(keys) if kept.find({"margins": key})]
    assert found == [0, *range(11, 20)]
    kept.keep(keys[0], 40 * b"x")
    assert kept.size == 940


class Crew:
    """Stands for processes: answers with the names of the parts, the first of many where little time is given."""

    def __init__(self, count: int = 1) -> None:
        self.count, self.turns = count, Turns(count)
        self.asked: list[tuple[list[str], float]] = []

    async def at(self, place: int, function: Any, entries: dict[str, Any], names: Sequence[str], seconds: float) -> dict[str, bytes]:
        del place, function, entries
        self.asked.append((list(names), seconds))
        await asyncio.sleep(0.001)
        return dict.fromkeys(names if seconds == math.inf else names[:1], b'{"at":1}')


def views() -> tuple[Views, Crew, Crew]:
    live, slow = Crew(), Crew()
    pools: Any = live, slow
    return Views(*pools), live, slow


def test_parts_are_left_for_later_only_where_allowed_and_many_wait_and_are_all_found_in_the_end() -> None:
    async def run() -> None:
        made, live, _ = views()

        async def page(number: int, *, whole: bool) -> tuple[int, dict[str, Any]]:
            state, asked, rounds = State(kp=1.0 + number), ["point", "loop", "margins", "gains"], 0
            found: dict[str, Any] = {}
            while asked:
                record = json.loads(await made.find(f"page {number}", state, asked, newest=True, whole=whole))
                assert set(record["parts"]) | set(record.get("later", ())) == set(asked)
                assert not set(record["parts"]) & set(record.get("later", ()))
                found |= record["parts"]
                asked, rounds = record.get("later", []), rounds + 1
            return rounds, found

        few = await asyncio.gather(*(page(number, whole=False) for number in range(FEW)))
        assert [rounds for rounds, _ in few] == [1] * FEW
        many = await asyncio.gather(*(page(10 + number, whole=False) for number in range(20)))
        assert all(set(found) == {"point", "loop", "margins", "gains"} for _, found in many)
        assert max(rounds for rounds, _ in many) > 1
        assert any(seconds < 0.1 for _, seconds in live.asked)
        patient = await asyncio.gather(*(page(40 + number, whole=True) for number in range(20)))
        assert [rounds for rounds, _ in patient] == [1] * 20

    asyncio.run(run())


def test_slow_parts_are_left_for_later_only_while_others_wait_for_their_process() -> None:
    async def run() -> None:
        made, _, slow = views()

        async def asked(kp: float, *, whole: bool = False) -> tuple[set[str], list[str]]:
            record = json.loads(await made.find("page", State(kp=kp), ["margins", "cycle"], newest=True, whole=whole))
            return set(record["parts"]), record.get("later", [])

        async with asyncio.timeout(5.0):
            await turns(asked, slow)

    async def turns(asked: Any, slow: Crew) -> None:
        assert await asked(1.0) == ({"margins", "cycle"}, [])
        async with slow.turns.turn("another"):
            assert await asked(2.0) == ({"margins"}, ["cycle"])
            waits = asyncio.create_task(asked(3.0, whole=True))
            await asyncio.sleep(0.02)
            assert not waits.done()
        assert await waits == ({"margins", "cycle"}, [])

    asyncio.run(run())


def test_where_a_process_gives_no_answer_its_parts_have_a_problem_that_is_not_kept() -> None:
    class Lame(Crew):
        async def at(self, *arguments: Any) -> dict[str, bytes]:
            if len(self.asked) == 1:
                self.asked.append(([], 0.0))
                raise WorkerError("took-too-long", "the answer took too long", "it took longer than 1 s")
            return await super().at(*arguments)

    async def run() -> list[Any]:
        pools: Any = Lame(), Crew()
        made = Views(*pools)
        bodies = [await made.find("page", State(kp=kp), ["margins"], newest=True, whole=True) for kp in (1.0, 2.0, 2.0, 2.0)]
        assert len(pools[0].asked) == 3  # the last one is kept
        return [json.loads(body)["parts"]["margins"] for body in bodies]

    first, lost, again, kept = asyncio.run(run())
    assert first == again == kept == {"at": 1}
    assert lost["problem"]["type"] == "/problems/took-too-long"


def test_a_process_begins_no_further_part_once_half_of_its_time_is_over() -> None:
    names = ("point", "margins", "loop_roots")
    assert list(answer_parts({}, names, 1e-9)) == ["point"]
    assert list(answer_parts({}, names, 1e3)) == list(names)


def test_pages_that_show_the_same_are_answered_once() -> None:
    async def run() -> None:
        made, live, slow = views()
        parts = ["point", "margins", "map", "contours"]
        for _ in range(2):
            bodies = await asyncio.gather(*(made.find(f"page {n}", State(), parts, newest=True, whole=True) for n in range(10)))
            assert all(set(json.loads(body)["parts"]) == set(parts) for body in bodies)
        assert live.asked == [(["point", "margins"], math.inf)]
        assert [names for names, _ in slow.asked] == [["map", "contours"]]
        with pytest.raises(InvalidInputError, match="a view has no part 'nix'"):
            await made.find("page", State(), ["nix"], newest=True, whole=True)

    asyncio.run(run())


@pytest.mark.parametrize("gains", [{}, {"kp": 0.0, "ki": 0.0, "kd": 0.0}, {"kd": 0.0, "throttle_deg": 31.0}], ids=["pid", "none", "pi"])
def test_promises_made_from_models_that_are_handed_on_are_the_same_to_the_last_byte(gains: dict[str, float]) -> None:
    found = answer_parts(gains, ["models", "promises"])
    assert b"problem" not in found["models"]
    assert answer_promises(gains, found["models"]) == {"promises": found["promises"]}


class Pair(Crew):
    """Two processes, of which the first fits the models, or tells why it cannot, or ends."""

    def __init__(self, models: bytes) -> None:
        super().__init__(2)
        self.models, self.told = models, list[tuple[int, str, Any]]()

    async def at(self, place: int, function: Any, entries: dict[str, Any], *rest: Any) -> dict[str, bytes]:
        del entries
        self.told.append((place, function.__name__, rest[0]))
        await asyncio.sleep(0.001)
        if function is answer_promises:
            return {"promises": b'{"from":"models"}'}
        if "models" in rest[0] and not self.models:
            raise WorkerError("process-ended", "the process ended", "it was killed")
        return dict.fromkeys(rest[0], b"{}") | ({"models": self.models} if "models" in rest[0] else {})


@pytest.mark.parametrize("models", [b'{"g1":{}}', b'{"problem":{}}', b""], ids=["fitted", "not fitted", "ended"])
def test_what_the_models_promise_waits_for_them_in_the_other_process(models: bytes) -> None:
    pair, slow = Pair(models), Crew()
    pools: Any = pair, slow
    asked = ["response", "models", "roots", "promises", "answers", "point", "loop"]
    made = json.loads(asyncio.run(Views(*pools).find("page", State(), asked, newest=True, whole=False)))
    assert set(made["parts"]) == set(asked)
    steps = {place: [(name, what) for at, name, what in pair.told if at == place] for place in (0, 1)}
    assert steps[0] == [("answer_parts", ["response", "models"]), ("answer_parts", ["roots", "answers"])]
    assert steps[1][0] == ("answer_parts", ["point", "loop"])
    handed = models.startswith(b'{"g1"')
    assert steps[1][1:] == [("answer_promises", models) if handed else ("answer_parts", ["promises"])]
    assert made["parts"]["promises"] == ({"from": "models"} if handed else {})
    assert ("problem" in made["parts"]["models"]) == (not handed)


class Held(Crew):
    """A process that takes as long as the test wants."""

    def __init__(self) -> None:
        super().__init__()
        self.go_on = asyncio.Event()

    async def at(self, place: int, function: Any, entries: dict[str, Any], names: Sequence[str], seconds: float) -> dict[str, bytes]:
        await self.go_on.wait()
        return await super().at(place, function, entries, names, seconds)


def test_the_steady_map_is_left_for_later_where_it_takes_longer_and_is_found_once() -> None:
    """Of states that a page moves through meanwhile only the newest one's map is found after the first."""

    async def run() -> None:
        live, slow = Crew(), Held()
        pools: Any = live, slow
        made, parts = Views(*pools), ["point", "map"]
        for load in (1.0, 2.0, 3.0):
            record = json.loads(await made.find("page", State(load_n_m=load), parts, newest=True, whole=False))
            assert (set(record["parts"]), record["later"]) == ({"point"}, ["map"])
        rest = asyncio.create_task(made.find("page", State(load_n_m=3.0), ["map"], newest=True, whole=False))
        await asyncio.sleep(0)
        slow.go_on.set()
        assert set(json.loads(await rest)["parts"]) == {"map"}
        again = json.loads(await made.find("page", State(load_n_m=3.0), parts, newest=True, whole=False))
        assert set(again["parts"]) == set(parts)
        assert len(slow.asked) == 2

    asyncio.run(run())
