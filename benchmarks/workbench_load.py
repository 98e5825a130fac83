"""Many pages at one server: each moves a slider several times a second, and gets the answer to its newest move.

Usage: workbench_load.py [CLIENTS] [SECONDS]. Each client is as a page: one request under way, and the newest state sent when its answer
is there. Prints answers, the time from a move to the answer that shows it (or a newer one), and the server's memory.
"""

import asyncio
import json
import random
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import httpx

MOVES_PER_SECOND = 5.0
PARTS = ("point", "response", "models", "roots", "gains", "margins", "promises", "loop", "answers", "words")
PROGRAM = (str(Path(sys.executable).with_name("revline")), "serve", "--no-browser", "-q", "--port", "0")


class Client:
    """A page: what it moves, and how long it waited."""

    def __init__(self, number: int, link: str, line: httpx.AsyncClient) -> None:
        self.name, self.link, self.line = f"load-{number}", link, line
        self.random = random.Random(number)
        self.state = {"throttle_deg": 15.0 + 0.6 * number, "kp": 1.2}
        self.moves: list[float] = []
        self.waits: list[float] = []
        self.failed: list[str] = []
        self.changed = asyncio.Event()
        self.answers = 0
        self.last: object = None

    async def move(self, ends: float) -> None:
        """Move a slider at the pace of a hand: mostly the gain, at times the operating point."""
        await asyncio.sleep(self.random.random() / MOVES_PER_SECOND)
        while time.monotonic() < ends:
            if self.random.random() < 0.2:
                self.state = {**self.state, "throttle_deg": self.random.uniform(15.0, 45.0)}
            self.state = {**self.state, "kp": self.random.uniform(0.3, 2.0)}
            self.moves.append(time.monotonic())
            self.changed.set()
            await asyncio.sleep(1.0 / MOVES_PER_SECOND)

    async def follow(self, ends: float) -> None:
        """Send the newest state as long as there is one that was not sent."""
        while time.monotonic() < ends or self.changed.is_set():
            try:
                await asyncio.wait_for(self.changed.wait(), 0.2)
            except TimeoutError:
                continue
            self.changed.clear()
            sent, asked = len(self.moves), self.state
            answer = await self.line.post(f"{self.link}api/v1/view", json={"state": asked, "parts": PARTS}, headers={"x-client": self.name})
            now = time.monotonic()
            self.answers += 1
            if answer.status_code != 200:
                self.failed.append(f"{answer.status_code} {answer.text[:200]}")
            else:
                self.last = answer.json()["parts"]["gains"]
            self.waits += [now - moved for moved in self.moves[:sent]]
            del self.moves[:sent]


class Outcome(NamedTuple):
    """What a run came to."""

    answers: int
    moves: int
    failed: list[str]
    lost: int
    waits: list[float]
    memory: list[float]


def memory_of(pid: int) -> float:
    """Resident memory of a process and those below it, in MB."""
    total = 0.0
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                pages = int((folder / "statm").read_text().split()[1])
            except (OSError, IndexError):
                continue
            if pid in {parent, int(folder.name)}:
                total += pages * 4096 / 1e6
    return total


async def run(link: str, pid: int, clients: int, seconds: float) -> Outcome:
    """Let clients move sliders for a while."""
    limits = httpx.Limits(max_connections=clients, max_keepalive_connections=clients)
    memory = []
    async with httpx.AsyncClient(timeout=120.0, limits=limits) as line:
        pages = [Client(number, link, line) for number in range(clients)]
        ends = time.monotonic() + seconds

        async def watch() -> None:
            while time.monotonic() < ends:
                memory.append(memory_of(pid))
                await asyncio.sleep(seconds / 12.0)

        await asyncio.gather(watch(), *(page.move(ends) for page in pages), *(page.follow(ends) for page in pages))
    waits = sorted(wait for page in pages for wait in page.waits)
    lost = sum(bool(page.moves) or page.last is None for page in pages)
    failed = [text for page in pages for text in page.failed]
    return Outcome(sum(page.answers for page in pages), len(waits), failed, lost, waits, memory)


def measure(clients: int, seconds: float, folder: str) -> Outcome:
    """Start a server, load it, and stop it."""
    with subprocess.Popen([*PROGRAM, "--data", folder], stdout=subprocess.PIPE, text=True) as process:
        if process.stdout is None:
            raise RuntimeError
        link = process.stdout.readline().split()[-1]
        try:
            return asyncio.run(run(link, process.pid, clients, seconds))
        finally:
            process.terminate()
            process.wait(20)


def main(clients: int = 50, seconds: float = 60.0) -> None:
    found = measure(clients, seconds, "/nonexistent")
    at = {part: found.waits[int(part * (len(found.waits) - 1))] for part in (0.5, 0.95, 1.0)}
    print(f"{clients} pages, {MOVES_PER_SECOND:g} moves per second each, {seconds:g} s: {found.moves} moves, {found.answers} answers")
    print(f"failed: {len(found.failed)} {found.failed[:3]}; clients without their last answer: {found.lost}")
    print(f"from a move to its answer or a newer one: median {at[0.5]:.3f} s, 95 % {at[0.95]:.3f} s, longest {at[1.0]:.3f} s")
    print(f"memory of the server, MB: {json.dumps([round(value) for value in found.memory])}")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
