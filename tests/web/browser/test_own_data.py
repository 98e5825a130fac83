"""A user's own files on the page, and long work."""

from collections.abc import Callable

from tests.web.browser.conftest import Window

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
