"""What the routes share while the server runs: processes, views and jobs."""

from pathlib import Path
from typing import Final

from revline.web.jobs.queue import Jobs
from revline.web.views import Views
from revline.web.workers import GIBIBYTE, Crew

BEHIND: Final = 2
"""Niceness of what takes longer: a processor does first what a page follows each move with."""


class Desk:
    """What the routes share while the server runs.

    Args:
        data: folder of the jobs.

    Attributes:
        live: processes for what a page follows each move with, and for the questions of programs.
        slow: for what takes longer, so that nothing else waits for it.
        readers: that read files.
        views: of the pages.
        jobs: long work.
    """

    def __init__(self, data: Path) -> None:
        self.live = Crew(count=2, seconds=30.0, memory=4 * GIBIBYTE)
        self.slow = Crew(count=1, seconds=60.0, memory=4 * GIBIBYTE, niceness=BEHIND)
        self.readers = Crew(count=1, seconds=20.0, memory=2 * GIBIBYTE)
        self.views = Views(self.live, self.slow)
        self.jobs = Jobs(data)

    def stop(self) -> None:
        """End all processes but those of jobs."""
        for crew in (self.live, self.slow, self.readers):
            crew.stop()
