"""A user's own files on the page, and long work."""

import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.web.browser.conftest import Server, Window

Open = Callable[..., Window]


def give(window: Window, name: str, text: str) -> None:
    window.page.set_input_files("#file", {"name": name, "mimeType": "text/csv", "buffer": text.encode()})


def test_a_response_is_shown_fitted_and_compared(open_page: Open) -> None:
    window = open_page()
    window.page.click("#data-open")
    rows = "\n".join(
        f"{w},{12.0 / (1.0 + (0.58 * w) ** 2) ** 0.5:.6f},{-57.3 * 0.0228 * w - 20.0 * w**0.5:.4f}" for w in (0.1, 0.5, 1, 2, 5, 10, 20)
    )
    give(window, "mine.csv", f"frequency_rad_s,magnitude,phase_deg\n{rows}\n")
    window.page.wait_for_selector("#data h3:has-text('mine.csv')")
    lines = window.page.locator("#data li").all_inner_texts()
    assert lines[0].startswith("7 frequencies")
    assert any(line.startswith("2nd order + delay fitted") for line in lines)
    assert any(line.startswith("exact linear engine: differs") for line in lines)
    for plot in ("magnitude", "phase"):
        assert sum(line.startswith("own data,") for line in window.curves(plot).splitlines()) == 7
    window.page.click("#data button:has-text('Take it off')")
    assert "own data" not in window.curves("magnitude")


def test_a_log_is_played_on_the_engine(open_page: Open) -> None:
    window = open_page()
    window.page.click("#data-open")
    rows = "\n".join(f"{k / 50},{25 if k < 50 else 28},{240.8 if k < 50 else 276.0}" for k in range(200))
    give(window, "log.csv", f"time_s,throttle_deg,speed_rad_s\n{rows}\n")
    window.page.wait_for_selector("#data h3:has-text('log.csv')")
    assert any("nonlinear engine: rms error" in line for line in window.page.locator("#data li").all_inner_texts())
    assert window.page.is_visible("#log canvas")


def test_an_engine_file_changes_the_engine(open_page: Open) -> None:
    window = open_page("#v=1&parameters.rotation.inertia=0.2")
    with (
        window.page.expect_download() as _,
        window.page.expect_event("download", lambda found: found.suggested_filename == "engine.toml") as engine,
    ):
        window.page.click("#study")
    text = engine.value.path().read_text()
    window.page.click("#reset")
    window.settle()
    window.page.click("#data-open")
    give(window, "mine.toml", text)
    window.page.wait_for_selector("#data li:has-text('rotation.inertia = 0.2')")
    assert window.settle().state()["parameters"] == {"rotation.inertia": 0.2}


def test_what_is_no_such_file_is_told(open_page: Open) -> None:
    window = open_page()
    window.page.click("#data-open")
    give(window, "picture.csv", "\x89PNG\nnothing")
    window.page.wait_for_selector("#data .fault:has-text('no file known here')")
    give(window, "holes.csv", "frequency_rad_s,magnitude,phase_deg\n1,2,much\n")
    window.page.wait_for_selector("#data .fault:has-text('line 2')")
    give(window, "large.csv", "frequency_rad_s\n" + 2_600_000 * "1\n")
    window.page.wait_for_selector("#data .fault:has-text('5 MB at most')")
    window.complaints = [text for text in window.complaints if "422" not in text]  # the browser's own word for a refused file


def test_a_job_is_started_survives_a_reload_and_is_cancelled(open_page: Open) -> None:
    window = open_page()
    window.page.click("#jobs-open")
    window.page.click("#jobs button:has-text('Start a study')")
    window.page.wait_for_selector("#jobs li[data-status=running], #jobs li[data-status=queued]")
    window.page.reload()
    window.settle()
    assert window.page.is_visible("#jobs")  # the address says that it is open
    window.page.click("#jobs li >> nth=0 >> button:has-text('Cancel')")
    window.page.wait_for_selector("#jobs li[data-status=cancelled]", timeout=20_000)
    window.page.click("#jobs li >> nth=0 >> button:has-text('Delete')")
    window.page.wait_for_selector("#jobs li:has-text('none yet')")


@pytest.fixture
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


@pytest.mark.usefixtures("ended")
def test_a_server_that_stops_with_a_job_under_way_says_so_and_knows_how_it_ended(open_page: Open, server: Server) -> None:
    window = open_page()
    begin_study(window)
    server.stop()
    try:
        window.page.fill("#kp-number", "0.8")
        window.page.press("#kp-number", "Enter")
        window.page.wait_for_selector("#banner:has-text('does not answer')")
        for shown in ("#speed", "#numbers", "#verdict"):
            assert "stale" in str(window.page.get_attribute(shown, "class")), shown
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


@pytest.mark.usefixtures("ended")
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
