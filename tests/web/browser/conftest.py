"""The workbench in a real browser: one server and one browser for a module, a page of its own for each test.

Not for the session: the browser's loop would go on running in tests that have loops of their own.
"""

import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "src" / "revline" / "web" / "page" / "index.html"
PROGRAM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)


class Server:
    """`revline serve` on a port of its own, which can be stopped and started again."""

    def __init__(self, data: Path) -> None:
        self.data = data
        with socket.create_server(("127.0.0.1", 0)) as held:
            self.port = held.getsockname()[1]
        self.address = f"http://127.0.0.1:{self.port}/"
        self.process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        command = [str(Path(sys.executable).with_name("revline")), "serve", "--port", str(self.port), "--no-browser"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "XDG_DATA_HOME": str(self.data)})  # noqa: S603 - our own program
        assert self.process.stdout is not None
        assert re.search(re.escape(self.address.rstrip("/")), self.process.stdout.readline())

    def stop(self) -> None:
        if self.process is None:
            return
        self.process.terminate()
        self.process.communicate(timeout=20)
        self.process = None


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    if PROGRAM is None:
        pytest.skip("no browser here: the page is tried where chromium, chromium-browser or google-chrome is installed")
    if not PAGE.exists():
        pytest.skip("the page is not built here: `make page` builds it")
    running = Server(tmp_path_factory.mktemp("data"))
    running.start()
    yield running
    running.stop()


@pytest.fixture(scope="module")
def browser(server: Server) -> Iterator[Browser]:
    assert server.process is not None
    assert PROGRAM is not None
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=PROGRAM, args=["--no-sandbox"] if os.geteuid() == 0 else [])
        yield started
        started.close()


class Window:
    """A page of the workbench, and what its console said."""

    def __init__(self, context: BrowserContext, address: str) -> None:
        self.page: Page = context.new_page()
        self.complaints: list[str] = []
        self.address = address
        self.page.on("console", lambda message: self._note(message.type, message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))

    def _note(self, kind: str, text: str) -> None:
        if kind in {"error", "warning"}:
            self.complaints.append(text)

    def open(self, fragment: str = "") -> "Window":
        self.page.goto("about:blank")
        self.page.goto(self.address + fragment)
        return self.settle()

    def settle(self) -> "Window":
        self.page.wait_for_selector("html[data-view=settled]", timeout=30_000)
        return self

    def set(self, control: str, value: float) -> "Window":
        field = self.page.locator(f'[id="{control}-number"]')
        field.fill(str(value))
        field.press("Enter")
        return self.settle()

    def curves(self, plot: str) -> str:
        return str(self.page.evaluate("name => window.workbench.csv(name)", plot))

    def state(self) -> dict[str, object]:
        return dict(self.page.evaluate("() => window.workbench.state()"))


@pytest.fixture
def open_page(browser: Browser, server: Server) -> Iterator[Callable[..., Window]]:
    contexts: list[BrowserContext] = []
    windows: list[Window] = []

    def make(fragment: str = "", **options: Any) -> Window:
        contexts.append(browser.new_context(**{"viewport": {"width": 1280, "height": 720}, **options}))
        windows.append(Window(contexts[-1], server.address))
        return windows[-1].open(fragment)

    yield make
    for context in contexts:
        context.close()
    assert [text for window in windows for text in window.complaints] == []
