"""A browser and a server for the tests of the page; without a browser they are skipped, and say so."""

import os
import shutil
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from revline.web.app import page_folder
from tests.web.serving import Server, end, start

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
SCREEN = {"width": 1280, "height": 720}


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    program = next((path for name in NAMES if (path := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the path")
    if not (page_folder() / "index.html").is_file():
        pytest.skip("the page was not built: run `make page`")
    with sync_playwright() as playwright:
        options = ["--no-sandbox"] if os.getuid() == 0 else []
        running = playwright.chromium.launch(executable_path=program, args=options)
        yield running
        running.close()


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    running = start()
    yield running
    _, said = end(running)
    assert "Traceback" not in said


class Faults(list[str]):
    """What a page complained of."""


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """A page whose console must stay free of errors, those of the content security policy among them."""
    context = browser.new_context(viewport=SCREEN)  # type: ignore[arg-type]  # a mapping of its two keys
    opened = context.new_page()
    faults = Faults()
    opened.on("console", lambda message: faults.append(message.text) if message.type in {"error", "warning"} else None)
    opened.on("pageerror", lambda error: faults.append(str(error)))
    yield opened
    context.close()
    allowed = ("net::ERR_", "409 (Conflict)", "422 (Unprocessable")  # what a browser says of answers that the page itself tells
    assert [fault for fault in faults if not any(text in fault for text in allowed)] == []
