"""Views for many pages at once: what is kept is given at once, the rest is found in turns, and told where it is left for later."""

import asyncio
import json
import math
import time
from collections.abc import Awaitable, Mapping, Sequence
from typing import Final, NamedTuple

from revline.io.json_files import format_compact_json
from revline.web.answers import answer_parts, answer_promises
from revline.web.kept import Kept, key_of
from revline.web.state import State
from revline.web.turns import SupersededError, Turn
from revline.web.view.build import GROUPS, OF_WORDS, WORDS, check_parts
from revline.web.view.words import view_words
from revline.web.workers import Crew, WorkerError

ROUND: Final = 0.25
"""Seconds in which each client that waits has its turn, where it lets parts be left for later."""

FEW: Final = 2
"""While no more clients than this wait, nothing is left for later."""

FIRST: Final = ("point", "loop", "margins", "promises", "gains", "answers")
ORDER: Final = (*FIRST, *(name for group in GROUPS for name in group if name not in FIRST))
"""Live parts, those first that a page shows a move by, the quickest before; the verdict in words is made once its parts are there."""

MODELS: Final = "models"
PROMISES: Final = "promises"
"""What the models promise is found from their part alone, by whichever process has time."""

PROBLEM: Final = b'{"problem":'


class Wanted:
    """What a client asks for, and what was found of it.

    Args:
        client: who asks.
        state: what is shown.
        parts: their names.
        whole: whether all parts are wanted in one answer, however long it takes.

    Raises:
        InvalidInputError: there is no part of a name.
    """

    def __init__(self, client: str, state: State, parts: Sequence[str], *, whole: bool) -> None:
        check_parts(parts)
        self.client, self.whole, self.parts = client, whole, tuple(dict.fromkeys(parts))
        self.entries = state.model_dump(exclude_none=True)
        needed = [*(name for name in self.parts if name != WORDS), *(OF_WORDS if WORDS in self.parts else ())]
        self.keys = {name: key_of(name, self.entries) for name in needed}
        self.found: dict[str, bytes] = {}

    def missing(self, names: Sequence[str]) -> list[str]:
        """Those of some parts that are needed and not found yet."""
        return [name for name in names if name in self.keys and name not in self.found]

    @property
    def slow(self) -> list[str]:
        """Parts that are needed, not found yet, and take long."""
        return [name for name in self.missing(tuple(self.keys)) if name not in ORDER]

    def answer(self) -> tuple[dict[str, bytes], list[str]]:
        """Give the parts that were found, and the names of those that were left for later."""
        given = {name: self.found[name] for name in self.parts if name in self.found}
        if WORDS in self.parts and all(name in self.found for name in OF_WORDS):
            words = view_words(*(json.loads(self.found[name]) for name in OF_WORDS))
            given[WORDS] = format_compact_json(words).encode()
        return given, [name for name in self.parts if name not in given]


class Share(NamedTuple):
    """What one of two processes finds of a view: some parts, then others."""

    first: list[str]
    then: list[str]


class Views:
    """Finds views.

    Args:
        live: processes for what a page follows each move with.
        slow: processes for what takes longer.
    """

    def __init__(self, live: Crew, slow: Crew) -> None:
        self._live, self._slow, self._kept = live, slow, Kept()
        self._beside: set[asyncio.Task[None]] = set()

    async def find(self, client: str, state: State, parts: Sequence[str], *, newest: bool, whole: bool) -> bytes:
        """Find a view, as JSON.

        Args:
            client: who asks.
            state: what is shown.
            parts: their names.
            newest: whether it displaces what the client asked for before, and that still waits.
            whole: whether all parts are wanted in one answer; else some are left for later while many clients wait, and named.

        Raises:
            InvalidInputError: there is no part of a name.
            SupersededError: the client asked for something newer meanwhile.
        """
        began = time.perf_counter()
        wanted = Wanted(client, state, parts, whole=whole)
        wanted.found |= self._kept.find(wanted.keys)
        if wanted.missing(ORDER):
            most = len(_split(wanted))
            async with self._live.turns.turn(client, newest=newest, most=most) as turn:
                wanted.found |= self._kept.find(wanted.keys)  # another client may have asked for the same meanwhile
                await asyncio.gather(*self._shares(turn, wanted), *self._slow_share(wanted))
        elif wanted.slow:
            await self._find_slow(wanted, newest=newest)
        given, later = wanted.answer()
        body = b",".join(b'"' + name.encode() + b'":' + part for name, part in given.items())
        left = f',"later":{json.dumps(later)}' if later else ""
        return b'{"parts":{' + body + b"}" + f'{left},"seconds":{time.perf_counter() - began:.6f}}}'.encode()

    def _shares(self, turn: Turn, wanted: Wanted) -> list[Awaitable[None]]:
        """Live parts, side by side where nobody else waits; else one process finds what there is time for."""
        if len(turn.places) > 1:
            fitted, shares = asyncio.Event(), zip(tuple(turn.places), _split(wanted), strict=False)
            return [turn.work(place, self._in_steps(place, wanted, share, fitted)) for place, share in shares]
        names = wanted.missing(ORDER)
        if not names:
            return []
        seconds = math.inf if wanted.whole or turn.others <= FEW else ROUND * self._live.count / (turn.others + 1)
        return [self._share(self._live, turn, turn.places[0], wanted, names, seconds)]

    def _slow_share(self, wanted: Wanted) -> list[Awaitable[None]]:
        """Parts that take longer, beside the live ones, which do not wait for them unless all parts are wanted in one answer."""
        if not wanted.slow or not (wanted.whole or self._slow.turns.unused):
            return []
        if wanted.whole:
            return [self._find_slow(wanted, newest=False)]
        task = asyncio.create_task(self._find_slow(wanted, newest=True))
        self._beside.add(task)
        task.add_done_callback(self._end)
        return []

    def _end(self, task: asyncio.Task[None]) -> None:
        """Forget what was found beside: it is kept, or its client asked for something newer."""
        self._beside.discard(task)
        if not task.cancelled() and not isinstance(task.exception(), SupersededError | None):
            task.result()

    async def _find_slow(self, wanted: Wanted, *, newest: bool) -> None:
        async with self._slow.turns.turn(wanted.client, newest=newest) as turn:
            wanted.found |= self._kept.find(wanted.keys)
            if wanted.slow:
                await self._share(self._slow, turn, turn.places[0], wanted, wanted.slow)

    async def _share(self, crew: Crew, turn: Turn, place: int, wanted: Wanted, names: Sequence[str], seconds: float = math.inf) -> None:
        await turn.work(place, self._find(wanted, names, crew.at(place, answer_parts, wanted.entries, list(names), seconds)))

    async def _in_steps(self, place: int, wanted: Wanted, share: Share, fitted: asyncio.Event) -> None:
        """One share of two: who fits the models gives them on at once, and what they promise waits for them."""
        if share.first:
            try:
                await self._find(wanted, share.first, self._live.at(place, answer_parts, wanted.entries, share.first, math.inf))
            finally:
                if MODELS in share.first:
                    fitted.set()
        if PROMISES in share.then:
            await fitted.wait()
        models = wanted.found.get(MODELS, PROBLEM)
        if PROMISES in share.then and not models.startswith(PROBLEM):
            await self._find(wanted, share.then, self._live.at(place, answer_promises, wanted.entries, models))
        elif share.then:
            await self._find(wanted, share.then, self._live.at(place, answer_parts, wanted.entries, share.then, math.inf))

    async def _find(self, wanted: Wanted, names: Sequence[str], asked: Awaitable[Mapping[str, bytes]]) -> None:
        found = await find_share(asked, names)
        wanted.found |= found
        for name, body in found.items():
            if not body.startswith(PROBLEM):
                self._kept.keep(wanted.keys[name], body)


def _split(wanted: Wanted) -> list[Share]:
    """Live parts that are needed, in groups that share what they need; what models promise that are fitted now is the other's to find."""
    first, second = (wanted.missing(group) for group in GROUPS)
    if MODELS in first and PROMISES in first:
        cut = first.index(MODELS) + 1
        return [Share(first[:cut], [name for name in first[cut:] if name != PROMISES]), Share(second, [PROMISES])]
    return [Share(names, []) for names in (first, second) if names]


async def find_share(asked: Awaitable[Mapping[str, bytes]], names: Sequence[str]) -> Mapping[str, bytes]:
    """Have some parts found; where their process gives no answer, that is the problem of these parts and of no others.

    Args:
        asked: of their process.
        names: of the parts.
    """
    try:
        return await asked
    except WorkerError as error:
        body = format_compact_json({"problem": error.problem}).encode()
        return dict.fromkeys(names, body)
