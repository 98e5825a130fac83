"""Connections that are not kept for who does not use them: a request's head has to come, and an answer be read, within a while."""

import asyncio
from typing import Any, ClassVar

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class PatientProtocol(HttpToolsProtocol):
    """HTTP as uvicorn speaks it, but a connection whose next request's head takes too long is closed, or whose answer is not read.

    Attributes:
        patience: seconds from a connection's beginning, or from a later request's first byte, to the end of the request's head; and
            in which what was written has to be read, beside the time that it takes at the slowest pace.
        pace: bytes per second at which an answer is read at least.
    """

    patience: ClassVar[float] = 20.0
    pace: ClassVar[float] = 32 * 1024

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._timer: asyncio.TimerHandle | None = None
        self._reader: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Wait for the first request."""
        super().connection_made(transport)  # type: ignore[arg-type]  # a transport of TCP, as uvicorn knows it
        self.transport.set_write_buffer_limits(high=0)  # so that all that waits to be read is known of
        self._wait()

    def pause_writing(self) -> None:
        """Wait until what was written is read; where it is not, the connection ends without it."""
        super().pause_writing()
        longest = self.patience + self.transport.get_write_buffer_size() / self.pace
        self._reader = self.loop.call_later(longest, self.transport.abort)

    def resume_writing(self) -> None:
        """Wait no more: all was read."""
        self._end_reader()
        super().resume_writing()

    def on_message_begin(self) -> None:
        """Wait for the rest of a request's head."""
        super().on_message_begin()
        if self._timer is None:
            self._wait()

    def on_headers_complete(self) -> None:
        """Wait no more: a request's body is the application's to wait for."""
        self._rest()
        super().on_headers_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._rest()
        self._end_reader()
        super().connection_lost(exc)

    def _end_reader(self) -> None:
        if self._reader is not None:
            self._reader.cancel()
            self._reader = None

    def _wait(self) -> None:
        self._timer = self.loop.call_later(self.patience, self.transport.close)

    def _rest(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
