"""Turns of clients: one request of a client is answered at a time, and of those that wait only the newest."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

T = TypeVar("T")


class SupersededError(Exception):
    """A newer request of the same client came while this one waited."""


class _Client:
    """A client's turn."""

    def __init__(self) -> None:
        self.lock = asyncio.Lock()
        self.newest = 0
        self.present = 0


class Turns:
    """Keeps the turns of all clients that are being answered."""

    def __init__(self) -> None:
        self._clients: dict[str, _Client] = {}

    @property
    def clients(self) -> int:
        """How many clients are being answered or wait."""
        return len(self._clients)

    async def take(self, client: str, work: Callable[[], Awaitable[T]]) -> T:
        """Do a client's work when its turn comes.

        Args:
            client: who asks.
            work: what is asked.

        Raises:
            SupersededError: the client asked for something newer meanwhile.
        """
        entry = self._clients.setdefault(client, _Client())
        entry.newest += 1
        mine = entry.newest
        entry.present += 1
        try:
            async with entry.lock:
                if mine != entry.newest:
                    raise SupersededError
                return await work()
        finally:
            entry.present -= 1
            if not entry.present:
                self._clients.pop(client, None)
