"""Take pictures of the workbench's page in its main states, to be looked at.

Usage: python docs/take_screenshots.py [FOLDER], from the project's root, once the page is built; a browser must be on this machine.
"""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser, Page, sync_playwright

SETTLED: Final = "html[data-view=settled]"
SCREEN: Final = (1280, 720)
TABLET: Final = (820, 1180)
TABLET_WIDE: Final = (1024, 768)


@contextlib.contextmanager
def serving() -> Iterator[str]:
    """Run `revline serve` on a free port, and give its address."""
    command = [str(Path(sys.executable).with_name("revline")), "serve", "--port", "0", "--no-browser"]
    with (
        tempfile.TemporaryDirectory() as data,  # jobs of the pictures are no jobs of the user's
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "XDG_DATA_HOME": data}) as server,  # noqa: S603 - our own program
    ):
        try:
            first = server.stdout.readline() if server.stdout else ""
            found = re.search(r"https?://\S+", first)
            if found is None:
                message = f"the server did not say where it is, but {first!r}"
                raise RuntimeError(message)
            yield found[0]
        finally:
            server.terminate()


def settle(page: Page) -> None:
    """Wait until nothing more is asked for."""
    page.wait_for_selector(SETTLED, timeout=60_000)
    page.wait_for_timeout(200)


def take_tour(page: Page) -> None:
    """Go to the fifth step of the tour: C1 hunts."""
    page.click("#tour")
    for _ in range(4):
        page.click("#guide button:has-text('Next')")
    settle(page)


def show_own_data(page: Page) -> None:
    """Give the page a frequency response of its own."""
    rows = "\n".join(
        f"{w},{12 / (1 + (0.56 * w) ** 2) ** 0.5},{-57.3 * (0.0214 * w) - 30 * w**0.5}" for w in (0.1, 0.3, 1, 2, 4, 8, 15, 30, 60)
    )
    page.click("#data-open")
    data = f"frequency_rad_s,magnitude,phase_deg\n{rows}\n".encode()
    page.set_input_files("#file", {"name": "measured.csv", "mimeType": "text/csv", "buffer": data})
    page.wait_for_selector("#data h3", timeout=60_000)
    page.wait_for_timeout(300)


def show_jobs(page: Page) -> None:
    """Start a study, and look at it run."""
    page.click("#jobs-open")
    page.click("#jobs button:has-text('study')")
    page.wait_for_timeout(3000)


SCENES: Final[tuple[tuple[str, tuple[int, int], str, bool, Callable[[Page], None] | None], ...]] = (
    ("default", SCREEN, "", False, None),
    ("hunting", SCREEN, "#v=1&kp=2.153&ki=16.85&kd=0&command_rad_s=60", False, None),
    ("hunting-dark", SCREEN, "#v=1&kp=2.153&ki=16.85&kd=0&command_rad_s=60&errors=distortion", True, None),
    ("load-step", SCREEN, "#v=1&step=load&load_step_n_m=10", False, None),
    ("throttle-step", SCREEN, "#v=1&step=throttle&low_deg=5&high_deg=60", False, None),
    ("no-control", SCREEN, "#v=1&kp=0&ki=0&kd=0", False, None),
    ("saturated", SCREEN, "#v=1&throttle_deg=85&amplitude_deg=8", False, None),
    ("limit-near-by", SCREEN, "#v=1&throttle_deg=79.4", False, None),
    ("engine", SCREEN, "#v=1&open=engine&parameters.rotation.inertia=0.2", False, None),
    ("dark", SCREEN, "", True, None),
    ("tablet", TABLET, "", False, None),
    ("tablet-wide", TABLET_WIDE, "", True, None),
    ("problem", SCREEN, "#v=1&throttle_deg=25&load_n_m=500", False, None),
    ("tour", SCREEN, "", False, take_tour),
    ("own-data", SCREEN, "", False, show_own_data),
    ("jobs", SCREEN, "", False, show_jobs),
)


def take(browser: Browser, address: str, folder: Path, wanted: tuple[str, ...]) -> None:
    """Take each scene in a page of its own."""
    for name, (width, height), fragment, dark, act in SCENES:
        if wanted and name not in wanted:
            continue
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light")
        page.goto(address + fragment)
        settle(page)
        if act is not None:
            act(page)
        page.screenshot(path=str(folder / f"{name}.png"))
        cancel = page.locator("#jobs button:has-text('Cancel')")
        if cancel.count():
            cancel.first.click()
            page.wait_for_selector("#jobs li[data-status=cancelled]")
        page.close()


def main() -> None:
    """Take all pictures, or those named after the folder."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/screenshots")
    folder.mkdir(parents=True, exist_ok=True)
    program = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
    if program is None:
        raise SystemExit("there is no chromium on this machine")
    options = ["--no-sandbox"] if os.geteuid() == 0 else []
    with serving() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=options)
        take(browser, address, folder, tuple(sys.argv[2:]))
        browser.close()


if __name__ == "__main__":
    main()
