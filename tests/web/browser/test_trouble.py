"""What happens around a page: its server goes with a job under way, another page is quicker, many ask at once, a file is dropped."""

import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Route, expect

from tests.web.browser.conftest import Server, Window

Open = Callable[..., Window]


@pytest.fixture(autouse=True)
def ended(server: Server) -> Iterator[None]:
    """No job goes on when a test ends."""
    yield
    for note in notes(server):
        end(note)


def notes(server: Server) -> list[dict[str, Any]]:
    return [json.loads(path.read_text()) for path in (server.data / "revline" / "jobs").glob("2*/job.json")]


def end(note: dict[str, Any]) -> None:
    try:
        os.killpg(note["process"]["pid"], signal.SIGKILL)
    except (KeyError, ProcessLookupError):
        return


def forgive(window: Window, *words: str) -> None:
    """The browser's own words for what was refused or lost."""
    window.complaints = [text for text in window.complaints if not any(word in text for word in words)]


def begin_study(window: Window) -> None:
    window.page.click("#jobs-open")
    window.page.click("#jobs button:has-text('Start a study')")
    window.page.wait_for_selector("#jobs li[data-status=running]")


def test_a_server_that_stops_with_a_job_under_way_says_so_and_knows_how_it_ended(open_page: Open, server: Server) -> None:
    window = open_page()
    begin_study(window)
    server.stop()
    try:
        window.page.fill("#kp-number", "0.8")
        window.page.press("#kp-number", "Enter")
        window.page.wait_for_selector("#banner:has-text('does not answer')")
        assert "stale" in str(window.page.get_attribute("#speed", "class"))
        (note,) = notes(server)
        os.kill(note["process"]["pid"], 0)  # the job goes on without its server
        end(note)
    finally:
        server.start()
    window.page.wait_for_selector("#banner", state="hidden", timeout=30_000)
    assert window.settle().state()["kp"] == 0.8
    assert "stale" not in str(window.page.get_attribute("#speed", "class"))
    job = window.page.locator("#jobs li[data-status=interrupted]")
    expect(job).to_have_count(1, timeout=20_000)
    expect(job.get_by_role("button", name="Go on")).to_be_visible()
    job.get_by_role("button", name="Delete").click()
    expect(window.page.locator("#jobs li:has-text('none yet')")).to_be_visible()
    forgive(window, "ERR_CONNECTION_REFUSED", "ERR_EMPTY_RESPONSE", "ERR_CONNECTION_RESET")


def test_of_two_pages_that_change_a_job_the_second_is_told(open_page: Open) -> None:
    here = open_page()
    begin_study(here)
    there = open_page()
    there.page.click("#jobs-open")
    there.page.wait_for_selector("#jobs li[data-status=running] button:has-text('Cancel')")
    there.page.route("**/api/v1/jobs", lambda route: route.abort())  # it has not heard of it yet
    here.page.click("#jobs li button:has-text('Cancel')")
    here.page.wait_for_selector("#jobs li[data-status=cancelled]", timeout=20_000)
    there.page.click("#jobs li button:has-text('Cancel')")
    expect(there.page.locator("#jobs [role=alert]")).to_contain_text("was changed meanwhile, perhaps from another page")
    there.page.unroute("**/api/v1/jobs")
    there.page.wait_for_selector("#jobs li[data-status=cancelled]", timeout=20_000)
    there.page.click("#jobs li button:has-text('Delete')")
    there.page.wait_for_selector("#jobs li:has-text('none yet')")
    forgive(there, "412", "ERR_FAILED")


def test_a_file_is_dropped_on_the_page(open_page: Open, tmp_path: Path) -> None:
    """A drop as the browser makes it of a file that the mouse brings: only over a page that lets it is there a drop at all."""
    window = open_page()
    rows = "\n".join(f"{w},{12.0 / (1.0 + (0.58 * w) ** 2) ** 0.5:.6f},{-1.3 * w - 20.0 * w**0.5:.4f}" for w in (0.1, 0.5, 1, 2, 5, 10, 20))
    (tmp_path / "dropped.csv").write_text(f"frequency_rad_s,magnitude,phase_deg\n{rows}\n")
    line = window.page.context.new_cdp_session(window.page)
    data = {"items": [], "files": [str(tmp_path / "dropped.csv")], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        line.send("Input.dispatchDragEvent", {"type": kind, "x": 700, "y": 400, "data": data})
    window.page.wait_for_selector("#data h3:has-text('dropped.csv')")
    assert window.page.locator("#data").is_visible()
    assert sum(row.startswith("own data,") for row in window.curves("magnitude").splitlines()) == 7
    assert window.page.url.startswith(window.address)


def test_what_is_left_for_later_is_greyed_and_follows(open_page: Open) -> None:
    """Where many ask at once a move is answered in pieces; none is shown beside the numbers of another state, and all are in the end."""
    window = open_page()
    before = {plot: window.curves(plot) for plot in ("speed", "plane", "magnitude")}
    asked: list[list[str]] = []
    seen: list[tuple[str, str, bool]] = []

    def pieces(route: Route) -> None:
        body: Any = route.request.post_data_json
        if body is None or "margins" not in body["parts"]:
            if "words" in (body or {}).get("parts", ()):
                asked.append(body["parts"])
                seen.append(
                    (
                        window.page.inner_text("#verdict"),
                        window.curves("plane"),
                        "stale" in str(window.page.get_attribute("#speed", "class")),
                    )
                )
            route.continue_()
            return
        asked.append(body["parts"])
        found = route.fetch().json()
        later = ["loop", "words", "answers"]
        route.fulfill(json={**found, "parts": {name: part for name, part in found["parts"].items() if name not in later}, "later": later})

    window.page.route("**/api/v1/view", pieces)
    window.set("kp", 0.7)
    assert asked[1] == ["loop", "answers", "words"]
    ((verdict, plane, stale),) = seen
    assert verdict == "many ask at once: the rest follows"
    assert plane != before["plane"]
    assert stale
    assert window.curves("speed") != before["speed"]
    assert window.page.inner_text("#verdict").startswith("stable")
    assert "stale" not in str(window.page.get_attribute("#speed", "class"))


def test_a_server_that_is_too_busy_is_asked_again(open_page: Open) -> None:
    window = open_page()
    refused = []

    def busy(route: Route) -> None:
        refused.append(route.request.url)
        if len(refused) > 1:
            route.continue_()
            return
        problem = {"type": "/problems/too-busy", "title": "too many", "status": 503, "detail": "200 requests are being answered already"}
        route.fulfill(status=503, content_type="application/problem+json", body=json.dumps(problem))

    window.page.route("**/api/v1/view", busy)
    window.page.fill("#kp-number", "0.6")
    window.page.press("#kp-number", "Enter")
    window.page.wait_for_selector("#banner:has-text('200 requests are being answered already')")
    window.page.wait_for_selector("#banner", state="hidden", timeout=20_000)
    assert window.settle().state()["kp"] == 0.6
    assert "stale" not in str(window.page.get_attribute("#speed", "class"))
    forgive(window, "503")
