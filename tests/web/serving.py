"""Servers as processes, for tests."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import httpx

PROGRAM = (str(Path(sys.executable).with_name("revline")), "serve", "--no-browser", "-q")


class Server(NamedTuple):
    """A running server."""

    process: subprocess.Popen[str]
    link: str

    @property
    def port(self) -> int:
        return httpx.URL(self.link).port or 0


def start(*options: str, port: int = 0) -> Server:
    process = subprocess.Popen([*PROGRAM, "--port", str(port), *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603 - our own program
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("workbench ready: http://"), line + (process.stderr.read() if process.stderr and process.poll() else "")
    return Server(process, line.split()[-1])


def children(pid: int) -> list[int]:
    """Processes below one, all generations."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, IndexError):
                continue
            if parent == pid:
                found += [int(folder.name), *children(int(folder.name))]
    return found


def end(server: Server, how: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
    """Stop a server: its exit status and what it said on stderr; no process of it is left."""
    below = children(server.process.pid)
    server.process.send_signal(how)
    _, said = server.process.communicate(timeout=20)
    for _ in range(100):
        if not any(Path(f"/proc/{pid}").exists() for pid in below):
            break
        time.sleep(0.05)
    assert not [pid for pid in below if Path(f"/proc/{pid}").exists()]
    return server.process.returncode, said
