"""Many pages at one server: each moves a slider several times a second, and gets the answer to its newest move.

Usage: workbench_load.py [CLIENTS] [SECONDS] [gains|mixed|points] [whole]

Each client is as the page: it sends its newest state, and a newer one once that is answered; what an answer leaves for later it asks for
when it has nothing newer to show. With `whole` nothing may be left for later. The time of a move lasts until an answer to it or to a newer
one has come, and that of a rest from a client's last move until it has all parts. Prints both, what was left for later, the processors'
time for each view, and the server's memory.
"""

import asyncio
import contextlib
import json
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

MOVES_PER_SECOND = 5.0
PARTS = ("point", "response", "models", "roots", "gains", "margins", "loop_roots", "promises", "loop", "answers", "words")
PROGRAM = (str(Path(sys.executable).with_name("revline")), "serve", "--no-browser", "-q", "--port", "0")
LONGEST = 120.0
"""Seconds after which an answer counts as lost."""

PROCESSORS = 2

TICKS = 100.0
"""Of the processors' time, in a second. Source: proc(5)."""


class Mix(NamedTuple):
    """What is moved: how often the operating point, and whether all clients begin at one."""

    points: float
    spread: float


MIXES = {"gains": Mix(0.0, 0.6), "mixed": Mix(0.2, 0.6), "points": Mix(1.0, 0.6)}


class Line:
    """A connection that sends one request after the other; a bare one, for it shares the processors with the server."""

    def __init__(self, port: int, name: str) -> None:
        self.port, self.name = port, name
        self.streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def view(self, state: dict[str, Any], parts: list[str], *, whole: bool) -> tuple[int, bytes]:
        """Ask for parts of a view: status and body."""
        if self.streams is None:
            self.streams = await asyncio.open_connection("127.0.0.1", self.port, limit=2**22)
        reader, writer = self.streams
        body = json.dumps({"state": state, "parts": parts, "whole": whole}).encode()
        head = f"POST /api/v1/view HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\nContent-Type: application/json\r\nX-Client: {self.name}\r\n"
        writer.write(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)
        answer = await reader.readuntil(b"\r\n\r\n")
        length = next(line for line in answer.lower().split(b"\r\n") if line.startswith(b"content-length:"))
        return int(answer.split(b" ", 2)[1]), await reader.readexactly(int(length.partition(b":")[2]))

    def close(self) -> None:
        if self.streams is not None:
            self.streams[1].close()


class Client:
    """A page: what it moves, and how long it waited."""

    def __init__(self, number: int, port: int, mix: Mix, *, whole: bool) -> None:
        self.name, self.line, self.mix, self.whole = f"load-{number}", Line(port, f"load-{number}"), mix, whole
        self.random = random.Random(number)
        self.state: dict[str, Any] = {"throttle_deg": 15.0 + mix.spread * number, "kp": 1.2}
        self.moved: list[float] = []
        self.answered, self.shown = 0, -1
        self.parts: dict[str, Any] = {}
        self.waits: list[float] = []
        self.rest = LONGEST
        self.failed: list[str] = []
        self.views = self.partial = 0
        self.later: list[str] = []
        self.news = asyncio.Event()

    async def move(self, ends: float) -> None:
        """Move a slider at the pace of a hand."""
        await asyncio.sleep(self.random.random() / MOVES_PER_SECOND)
        while time.monotonic() < ends:
            if self.random.random() < self.mix.points:
                self.state = {**self.state, "throttle_deg": self.random.uniform(15.0, 45.0)}
            self.state = {**self.state, "kp": self.random.uniform(0.3, 2.0)}
            self.moved.append(time.monotonic())
            self.news.set()
            await asyncio.sleep(1.0 / MOVES_PER_SECOND)

    async def follow(self, ends: float) -> None:
        """Send the newest state, and what was left for later where there is nothing newer, until all of the last one is there."""
        while True:
            if self.answered < len(self.moved):
                await self.ask(len(self.moved), list(PARTS))
            elif self.later:
                await self.ask(self.answered, list(self.later))
            elif time.monotonic() > ends:
                return
            else:
                self.news.clear()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self.news.wait(), 0.1)

    async def ask(self, number: int, parts: list[str]) -> None:
        """Ask for parts of the state after so many moves."""
        status, body = await asyncio.wait_for(self.line.view(self.state, parts, whole=self.whole), LONGEST)
        now = time.monotonic()
        self.views += 1
        if status != 200:
            self.failed.append(f"{status} {body[:200]!r}")
        self.waits += [now - moved for moved in self.moved[self.answered : number]]
        self.answered = number
        record = json.loads(body)
        self.parts = {**({} if number > self.shown else self.parts), **record.get("parts", {})}
        self.shown, self.later = number, record.get("later", [])
        self.partial += bool(self.later)
        if not self.later:
            self.rest = now - self.moved[-1]


class Outcome(NamedTuple):
    """What a run came to: counts, seconds, and MB.

    Attributes:
        times: of the processors in s: of the server with its processes, of its own process alone, of the clients.
        share: part of both processors that server and clients had while sliders moved.
    """

    clients: list[Client]
    seconds: float
    times: tuple[float, float, float]
    share: float
    memory: list[float]

    @property
    def waits(self) -> list[float]:
        return sorted(wait for client in self.clients for wait in client.waits)

    @property
    def failed(self) -> list[str]:
        return [text for client in self.clients for text in client.failed]

    @property
    def lost(self) -> list[str]:
        """Clients whose last state was not answered, or not wholly."""
        return [one.name for one in self.clients if one.answered < len(one.moved) or set(one.parts) != set(PARTS)]


def processes(pid: int) -> Iterator[Path]:
    """Folders of a process and of those directly below it."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError, IndexError):
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                if pid in {parent, int(folder.name)}:
                    yield folder


def memory_of(pid: int) -> float:
    """Resident memory of a process and those below it, in MB."""
    return sum(int((folder / "statm").read_text().split()[1]) for folder in processes(pid)) * 4096 / 1e6


def processors_of(*folders: Path) -> float:
    """Processors' time of some processes, in s."""
    fields = [(folder / "stat").read_text().rpartition(")")[2].split()[11:13] for folder in folders]
    return sum(int(user) + int(system) for user, system in fields) / TICKS


async def run(port: int, pid: int, count: int, seconds: float, mix: Mix, *, whole: bool) -> Outcome:
    """Let clients move sliders for a while."""
    clients = [Client(number, port, mix, whole=whole) for number in range(count)]
    family, main = tuple(processes(pid)), Path(f"/proc/{pid}")
    began, before, first, own = time.monotonic(), processors_of(*family), processors_of(main), time.process_time()
    ends, memory, shares = began + seconds, [], []

    async def watch() -> None:
        while time.monotonic() < ends:
            memory.append(memory_of(pid))
            await asyncio.sleep(seconds / 12.0)
        used = processors_of(*family) - before + time.process_time() - own
        shares.append(used / (PROCESSORS * (time.monotonic() - began)))

    await asyncio.gather(watch(), *(client.move(ends) for client in clients), *(client.follow(ends) for client in clients))
    memory.append(memory_of(pid))
    for client in clients:
        client.line.close()
    times = processors_of(*family) - before, processors_of(main) - first, time.process_time() - own
    return Outcome(clients, time.monotonic() - began, times, shares[0], memory)


def measure(count: int, seconds: float, mix: Mix, *, whole: bool = False) -> Outcome:
    """Start a server, load it, and stop it."""
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen([*PROGRAM, "--data", folder], stdout=subprocess.PIPE, text=True) as process,
    ):
        if process.stdout is None:
            raise RuntimeError
        port = int(process.stdout.readline().split()[-1].rstrip("/").rpartition(":")[2])
        try:
            return asyncio.run(run(port, process.pid, count, seconds, mix, whole=whole))
        finally:
            process.terminate()
            process.wait(20)


def main(count: int = 50, seconds: float = 60.0, mix: str = "mixed", *options: str) -> None:
    found = measure(int(count), float(seconds), MIXES[mix], whole="whole" in options)
    clients, waits = found.clients, found.waits
    at = {part: waits[int(part * (len(waits) - 1))] for part in (0.5, 0.95, 1.0)}
    rests = sorted(client.rest for client in clients)
    views, partial = sum(client.views for client in clients), sum(client.partial for client in clients)
    print(f"{count} pages, {MOVES_PER_SECOND:g} moves of {mix} per second each, {seconds} s; {' '.join(options)}")
    print(f"{len(waits)} moves, {views} answers, {partial} of them left parts for later")
    print(f"failed: {len(found.failed)} {found.failed[:3]}; clients without all of their last answer: {len(found.lost)}")
    print(f"from a move to an answer to it or a newer one: median {at[0.5]:.3f} s, 95 % {at[0.95]:.3f} s, longest {at[1.0]:.3f} s")
    print(f"from the last move to all parts: median {rests[len(rests) // 2]:.2f} s, longest {rests[-1]:.2f} s")
    alone = at[0.95] * found.share
    print(f"server and clients had {found.share:.0%} of the processors meanwhile; with all of them, 95 % about {alone:.3f} s")
    server, own, client = (1e3 * seconds / max(views, 1) for seconds in found.times)
    print(f"processors for an answer: server {server:.1f} ms, {own:.1f} of them in its own process; client {client:.1f} ms")
    print(f"memory of the server, MB: {json.dumps([round(value) for value in found.memory])}")


if __name__ == "__main__":
    main(*sys.argv[1:])  # type: ignore[arg-type]  # texts, taken as numbers
