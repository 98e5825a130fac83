"""Steps that run side by side, but one after the other where they name the same files."""

import os
import re
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from itertools import pairwise

PROCESSORS = len(os.sched_getaffinity(0))
AHEAD = 4 * PROCESSORS
"""How many steps may be under way or wait for others."""

WRITING = frozenset({"--out", "--csv", "--plot", "--cells", "--step-out"})
"""Options whose value is a file or folder that the command writes."""


def files_named(arguments: Sequence[str], given: frozenset[str]) -> frozenset[str]:
    """Files and folders that a command names: words with a dot, what it writes, and their folders; not those that were given."""
    words = {part for word in arguments[1:] for part in re.split("[:=,+]", word) if "." in part and not re.match(r"[-+.@\d]", part)}
    return frozenset(name for word in words - given | files_written(arguments) for name in (word, word.partition("/")[0]))


def files_written(arguments: Sequence[str]) -> frozenset[str]:
    """What a command is asked to write."""
    return frozenset(word for option, word in pairwise(arguments) if option in WRITING)


def run_in_order(steps: Sequence[tuple[frozenset[str], Callable[[], None]]]) -> None:
    """Run steps side by side, each after the earlier ones with which it has a name in common; wait for all."""
    latest: dict[str, list[Future[None]]] = {}

    def run(step: Callable[[], None], before: list[Future[None]]) -> None:
        wait(before)  # all were started earlier, so that the earliest under way never waits
        step()

    with ThreadPoolExecutor(AHEAD) as pool:
        running = []
        for names, step in steps:
            before = [future for name in names for future in latest.get(name, ())]
            running.append(pool.submit(run, step, before))
            for name in names:
                latest.setdefault(name, []).append(running[-1])
        _ = [ended.result() for ended in running]
