"""Speed of the workbench in headless Chromium: slider to redrawn plots, first useful view, size of the page.

Run with the page built: python benchmarks/workbench_speed.py [MOVES]. The budgets are those of the workbench: 50 ms median and 100 ms in
95 of 100 moves from a slider to all plots redrawn, 1.5 s to the first view once the server is ready, 400 kB compressed.
"""

import contextlib
import gzip
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

BUDGETS = {"median": 50.0, "p95": 100.0, "first view": 1500.0, "kB": 400.0}

MOVES = """async ([name, moves]) => {
  const slider = document.getElementById(name + "-slider");
  const html = document.documentElement;
  const seen = (window.seen ??= new Set());
  const start = (slider.start ??= slider.valueAsNumber);
  const taken = [];
  for (let k = 0; taken.length < moves && k < 10 * moves; k++) {
    slider.tries = (slider.tries ?? 0) + 1;
    slider.value = String(Math.round(start + 240 * ((0.618034 * slider.tries) % 1 - 0.5)));
    const began = performance.now();
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    const state = JSON.stringify(window.workbench.state());
    while (html.dataset.view === "busy") await new Promise((done) => setTimeout(done, 0));
    await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));
    if (!seen.has(state)) taken.push(performance.now() - began);
    seen.add(state);
  }
  slider.dispatchEvent(new Event("change", { bubbles: true }));
  return taken;
}"""
"""Moves about where the slider stands; those to a state seen before, of which the server keeps the answer, do not count."""


@contextlib.contextmanager
def serving() -> Iterator[tuple[str, float]]:
    """Run `revline serve`, and give its address and how long it took to be ready."""
    began = time.perf_counter()
    command = [str(Path(sys.executable).with_name("revline")), "serve", "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        first = server.stdout.readline() if server.stdout else ""
        found = re.search(r"https?://\S+", first)
        if found is None:
            raise SystemExit(f"the server did not say where it is, but {first!r}")
        yield found[0], time.perf_counter() - began
        server.terminate()


def measure(page: Page, name: str, moves: int) -> None:
    page.evaluate(MOVES, [name, 20])  # warm
    page.wait_for_selector("html[data-view=settled]")
    taken = page.evaluate(MOVES, [name, moves])
    page.wait_for_selector("html[data-view=settled]")
    median, p95 = statistics.median(taken), statistics.quantiles(taken, n=20)[-1]
    shown = f"median {median:5.1f} ms (budget {BUDGETS['median']:g}), p95 {p95:5.1f} ms (budget {BUDGETS['p95']:g})"
    print(f"{name:>14}: {shown}, {len(taken)} moves")


def main() -> None:
    moves = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    program = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
    if program is None:
        raise SystemExit("there is no chromium on this machine")
    built = Path(__file__).parents[1] / "src" / "revline" / "web" / "page"
    size = sum(len(gzip.compress(path.read_bytes())) for path in built.rglob("*") if path.is_file()) / 1000.0
    print(f"page: {size:.1f} kB compressed (budget {BUDGETS['kB']:g})")
    options = ["--no-sandbox"] if os.geteuid() == 0 else []
    with serving() as (address, ready), sync_playwright() as playwright:
        print(f"server: ready after {ready:.2f} s")
        browser = playwright.chromium.launch(executable_path=program, args=options)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        began = time.perf_counter()
        page.goto(address)
        page.wait_for_selector("html[data-view=drawn], html[data-view=settled]")
        print(f"first view: {1000.0 * (time.perf_counter() - began):.0f} ms (budget {BUDGETS['first view']:g})")
        page.wait_for_selector("html[data-view=settled]")
        for name in ("kp", "ki", "throttle_deg", "load_n_m", "amplitude_deg", "command_rad_s"):
            measure(page, name, moves)
        browser.close()


if __name__ == "__main__":
    main()
