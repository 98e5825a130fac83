"""Ctrl-C as a wish to stop soon, so that a long computation keeps what it has."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from revline.cli.shell import say


class Interruption:
    """Whether Ctrl-C was pressed; until `begin`, when there is nothing to keep, it ends the command at once."""

    def __init__(self) -> None:
        self._begun = False
        self._wished = False

    def begin(self) -> None:
        """From now on there is something to keep."""
        self._begun = True

    def wished(self) -> bool:
        """Whether the computation shall stop."""
        return self._wished

    def notice(self, number: int, frame: FrameType | None) -> None:
        """Take Ctrl-C; the second one ends the command at once."""
        del number, frame
        if self._wished or not self._begun:
            raise KeyboardInterrupt
        self._wished = True
        say("stopping; Ctrl-C again ends at once and keeps nothing", style="yellow")


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Take Ctrl-C as a wish to stop, for as long as the context lasts; only where signals arrive, in the main thread."""
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    before = signal.signal(signal.SIGINT, interruption.notice)
    try:
        yield interruption
    finally:
        signal.signal(signal.SIGINT, before)
