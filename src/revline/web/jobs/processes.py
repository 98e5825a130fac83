"""Processes told apart by when they began: a number alone is given again to another process."""

import os
import signal
import sys
from pathlib import Path
from typing import Final, NamedTuple

BOOT: Final = Path("/proc/sys/kernel/random/boot_id")
STATE, START = 0, 19
"""Places of the state and of the time of its start, in what follows a process's name in its line. Source: proc_pid_stat(5)."""


class Identity(NamedTuple):
    """Which process it is.

    Attributes:
        pid: its number.
        start: when it began, in clock ticks since the machine started.
        boot: name of that start of the machine.
    """

    pid: int
    start: int
    boot: str


RUN = "import sys; from revline.web.jobs.run import main; sys.exit(main(sys.argv[1:]))"
"""What the process of a job executes."""


def identify(pid: int) -> Identity | None:
    """Say which process has a number now; none where none has it, or where it has ended and only its parent has not noticed."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        boot = BOOT.read_text(encoding="utf-8").strip()
    except OSError:
        return None
    return None if fields[STATE] in {"Z", "X"} else Identity(pid, int(fields[START]), boot)


def lives(identity: Identity) -> bool:
    """Whether the very process is there still."""
    return identify(identity.pid) == identity


def send(identity: Identity, number: signal.Signals) -> None:
    """Signal a process that leads its group, and those that it started; nothing if it has ended."""
    if not lives(identity):
        return
    try:
        os.killpg(identity.pid, number)
    except ProcessLookupError:  # it ended just now
        return


def start_process(folder: Path, log: str = "log.txt") -> int:
    """Start the process of a job, in a session of its own: it goes on when whoever started it stops.

    Args:
        folder: of the job.
        log: name of the file for what the process says.

    Returns:
        Its number.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
    opened = ((os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0), (os.POSIX_SPAWN_OPEN, 1, str(folder / log), flags, 0o600))
    actions = (*opened, (os.POSIX_SPAWN_DUP2, 1, 2))
    arguments = [sys.executable, "-P", "-c", RUN, str(folder)]
    return os.posix_spawn(sys.executable, arguments, os.environ, file_actions=actions, setsid=True)


def has_ended(pid: int) -> bool:
    """Whether a process that this one started has ended; if so it is gone for good."""
    try:
        return os.waitpid(pid, os.WNOHANG)[0] == pid
    except ChildProcessError:
        return True
