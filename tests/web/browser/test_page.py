"""The page in a browser: each control moves what it should, and what is shown is what the server says."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.web.serving import Server, end, start

PLOTS = ("map", "magnitude", "phase", "plane", "errors", "roots", "speed", "throttle")
AXE = Path(__file__).parents[3] / "page" / "node_modules" / "axe-core" / "axe.min.js"

WATCH = """() => {
    window.drawn = 0; window.settled = 0;
    document.addEventListener('revline:drawn', () => { window.drawn += 1; });
    document.addEventListener('revline:settled', () => { window.settled += 1; });
}"""


def open_page(page: Page, server: Server, address: str = "") -> None:
    page.add_init_script(f"({WATCH})()")
    page.goto("about:blank")
    page.goto(f"{server.link}{address}")
    settle(page)


def settle(page: Page) -> None:
    """Wait until the newest state is shown with its slow parts, and nothing moves."""
    quiet, last = 0, None
    for _ in range(400):
        now = page.evaluate("[window.drawn, window.settled, location.hash]")
        quiet = quiet + 1 if now == last and now[0] and now[1] else 0
        if quiet >= 7:
            return
        last = now
        page.wait_for_timeout(50)
    pytest.fail("the page does not come to rest")


def pictures(page: Page) -> dict[str, str]:
    """What each plot shows."""
    found: dict[str, str] = page.evaluate(
        "(names) => Object.fromEntries(names.map((n) => [n, document.querySelector('#' + n + ' canvas').toDataURL()]))", list(PLOTS)
    )
    return found


def asked(page: Page, server: Server) -> dict[str, Any]:
    """The server's own answer to the state in the page's address."""
    entries: dict[str, Any] = page.evaluate("Object.fromEntries(new URLSearchParams(location.hash.slice(1)))")
    state: dict[str, Any] = {"parameters": {}}
    for key, text in entries.items():
        if key.startswith("parameters."):
            state["parameters"][key.removeprefix("parameters.")] = float(text)
        elif key != "v":
            state[key] = text if key in {"step", "engine"} else float(text)
    parts = ["point", "margins", "promises", "loop", "words"]
    answer = httpx.post(f"{server.link}api/v1/view", json={"state": state, "parts": parts}, timeout=30)
    return dict(answer.json()["parts"])


ROWS = ("stable", "gain (dB)", "phase (deg)", "delay (ms)", "Ms")
NONE = "\N{EN DASH}"


def numbers(page: Page) -> dict[str, list[str]]:
    """The table of margins: a row's cells by its name."""
    rows: list[list[str]] = page.evaluate(
        "[...document.querySelectorAll('#numbers tbody tr')].map((r) => [...r.children].map((c) => c.textContent))"
    )
    found = {row[0]: row[1:] for row in rows}
    assert tuple(found) == ROWS
    return found


def check_numbers(page: Page, server: Server) -> None:
    """The numbers on the page are the server's for the state in the address."""
    expected = asked(page, server)
    assert page.locator("#verdict").inner_text() == expected["words"]["verdict"]
    shown = numbers(page)
    for k, found in enumerate((expected["margins"], *expected["promises"].values())):
        cells = {name: row[k] for name, row in shown.items()}
        if "problem" in found:
            assert set(cells.values()) == {NONE}
            continue
        assert cells["stable"] == ("yes" if found["stable"] else "no")
        if found["stable"]:
            assert cells["gain (dB)"] == (f"{found['gain_margin_db']:.2f}" if "gain_margin_db" in found else "any")
            assert cells["phase (deg)"] == (f"{found['phase_margin_deg']:.1f}" if "phase_margin_deg" in found else "any")
            assert cells["delay (ms)"] == (f"{1e3 * found['delay_margin_s']:.2f}" if "delay_margin_s" in found else "any")
            assert cells["Ms"] == f"{found['ms']:.2f}"


def test_the_first_view_is_whole(page: Page, server: Server) -> None:
    open_page(page, server)
    check_numbers(page, server)
    assert page.title() == "revline workbench"
    for name in PLOTS:
        assert page.locator(f"#{name} canvas").count() == 1
        assert page.locator(f"#{name} .legend li").count() >= 2
        assert page.locator(f"#{name} .unseen").inner_text() != ""
    assert not page.locator(".stale").count()
    wide = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight, innerWidth, innerHeight]")
    assert wide[0] <= wide[2]
    assert wide[1] <= wide[3]


def slide(key: str, step: int) -> Callable[[Page], None]:
    """Move a slider by keys, as who uses no mouse does."""

    def move(page: Page) -> None:
        page.locator(f"[id='{key}-slider']").focus()
        for _ in range(abs(step)):
            page.keyboard.press("ArrowRight" if step > 0 else "ArrowLeft")

    return move


def write(key: str, text: str) -> Callable[[Page], None]:
    def move(page: Page) -> None:
        page.locator(f"[id='{key}-number']").fill(text)
        page.keyboard.press("Enter")

    return move


BODE = {"magnitude", "phase", "errors"}
TIMES = {"speed", "throttle"}


MOVES: tuple[tuple[str, Callable[[Page], object], set[str]], ...] = (
    ("throttle", slide("throttle_deg", 30), set(PLOTS)),
    ("load", write("load_n_m", "8"), set(PLOTS)),
    ("amplitude", write("amplitude_deg", "9"), {"errors", "map"}),
    ("kp", slide("kp", 20), {"plane", "speed", "throttle"}),
    ("ki", write("ki", "4"), {"plane", "speed", "throttle"}),
    ("kd", write("kd", "0.05"), {"plane", "speed", "throttle"}),
    ("command", write("command_rad_s", "-30"), TIMES),
    ("time", write("until_s", "2"), TIMES),
    ("load step", lambda page: page.get_by_label("load", exact=True).check(), TIMES),
    ("throttle step", lambda page: page.get_by_label("throttle, open loop").check(), TIMES),
    ("C1", lambda page: page.get_by_role("button", name="C1").click(), {"plane", "speed", "throttle", "roots"}),
)
"""Each control: how it is moved, and which plots must change."""


def test_each_control_changes_the_plots_it_should(page: Page, server: Server) -> None:
    open_page(page, server)
    before = pictures(page)
    for name, move, changed in MOVES:
        move(page)
        settle(page)
        after = pictures(page)
        assert {plot for plot in PLOTS if before[plot] != after[plot]} >= changed, name
        check_numbers(page, server)
        before = after


def test_an_engine_parameter_is_marked_and_reset(page: Page, server: Server) -> None:
    open_page(page, server)
    page.locator("summary", has_text="Engine").click()
    field = page.locator("[id='parameters.rotation.inertia-number']")
    field.fill("0.3")
    page.keyboard.press("Enter")
    settle(page)
    assert "parameters.rotation.inertia=0.3" in page.url
    expect(page.locator("summary .count")).to_have_text("1 changed")
    check_numbers(page, server)
    page.get_by_role("button", name=re.compile("Reset inertia")).click()
    settle(page)
    assert "inertia" not in page.url
    expect(page.locator("summary .count")).to_have_text("as published")


def drag(page: Page, plot: str, start: tuple[float, float], to: tuple[float, float]) -> None:
    box = page.locator(f"#{plot} .u-over").bounding_box()
    assert box is not None
    at = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (start, to)]
    page.mouse.move(*at[0])
    page.mouse.down()
    page.mouse.move(*at[1], steps=5)
    page.mouse.up()


def test_gains_and_operating_point_are_dragged_and_each_drag_is_one_step_back(page: Page, server: Server) -> None:
    open_page(page, server)
    drag(page, "plane", (0.3, 0.9), (0.5, 0.6))
    settle(page)
    dragged = page.url
    assert "kp=" in dragged
    assert "ki=" in dragged
    check_numbers(page, server)
    drag(page, "map", (0.3, 0.5), (0.5, 0.5))
    settle(page)
    assert "throttle_deg=45" in page.url
    check_numbers(page, server)
    page.keyboard.press("Control+z")
    settle(page)
    assert page.url == dragged
    page.get_by_role("button", name="Undo").click()
    settle(page)
    assert "#" not in page.url
    page.keyboard.press("Control+Shift+z")
    page.get_by_role("button", name="Redo").click()
    settle(page)
    assert "throttle_deg=45" in page.url


def test_a_link_shows_the_same_in_another_browser(page: Page, browser: Browser, server: Server) -> None:
    address = "#v=1&throttle_deg=33&kp=0.5&ki=3&kd=0.02&parameters.rotation.inertia=0.2&step=load&load_step_n_m=8"
    open_page(page, server, address)
    other = browser.new_context(viewport={"width": 1280, "height": 720})
    second = other.new_page()
    open_page(second, server, page.url.removeprefix(server.link))
    assert pictures(page) == pictures(second)
    assert page.locator("#verdict").inner_text() == second.locator("#verdict").inner_text()
    for key in ("throttle_deg", "kp", "load_step_n_m", "parameters.rotation.inertia"):
        assert page.locator(f"[id='{key}-number']").input_value() == second.locator(f"[id='{key}-number']").input_value()
    other.close()


def test_a_broken_link_says_what_is_wrong(page: Page, server: Server) -> None:
    open_page(page, server, "#v=1&kp=lots&ki=3")
    expect(page.locator("#banner")).to_contain_text("kp = lots in the link means nothing here")
    assert page.locator("#ki-number").input_value() == "3"


def test_a_value_that_cannot_be_is_told_at_its_control_and_the_last_plots_stay_greyed(page: Page, server: Server) -> None:
    open_page(page, server)
    write("throttle_deg", "2")(page)
    settle(page)
    expect(page.locator("#throttle_deg-fault")).to_contain_text("no trim at throttle = 2 deg")
    assert page.locator("#throttle_deg-number").get_attribute("aria-invalid") == "true"
    assert page.locator("#speed.stale").count() == 1
    assert page.locator("#speed canvas").count() == 1
    expect(page.locator("#verdict")).to_contain_text("no operating point")
    write("throttle_deg", "25")(page)
    settle(page)
    expect(page.locator("#throttle_deg-fault")).to_be_hidden()
    assert not page.locator(".stale").count()
    write("amplitude_deg", "60")(page)
    page.wait_for_timeout(300)
    expect(page.locator("#amplitude_deg-fault")).to_contain_text("amplitude_deg = 60 is outside its range; give 45 or less")


def test_the_tour_retells_the_thesis_and_ends_where_it_began(page: Page, server: Server) -> None:
    open_page(page, server, "#v=1&kp=0.7")
    page.get_by_role("button", name="Tour").click()
    told = []
    for k in range(8):
        settle(page)
        heading = page.locator("#guide h2").inner_text()
        assert heading.startswith(f"{k + 1} of 8: ")
        told.append(page.locator("#verdict").inner_text())
        check_numbers(page, server)
        assert page.locator(".looked-at").count() >= 1
        page.locator("#guide").get_by_role("button", name="Finish" if k == 7 else "Next").click()
    assert "hunts between 291.1 and 310.1 rad/s" in told[4]
    assert "hunts between 292.2 and 306.9 rad/s" in told[5]
    assert told[6].startswith("stable, gain margin 3.5 dB")
    settle(page)
    assert page.locator("#guide").is_hidden()
    assert page.url.endswith("#v=1&kp=0.7")


def test_a_plot_is_saved(page: Page, server: Server, tmp_path: Path) -> None:
    open_page(page, server)
    page.locator("#speed").hover()
    files = {}
    for kind in ("PNG", "SVG", "CSV"):
        with page.expect_download() as caught:
            page.get_by_role("button", name=f"Save Speed as {kind}").click()
        assert caught.value.suggested_filename == f"speed.{kind.lower()}"
        caught.value.save_as(tmp_path / kind)
        files[kind] = (tmp_path / kind).read_bytes()
    assert files["PNG"].startswith(b"\x89PNG")
    assert files["SVG"].startswith(b"<svg xmlns=")
    lines = files["CSV"].decode().splitlines()
    assert lines[0] == "curve,time (s),speed (rad/s)"
    assert sum(line.startswith("engine,") for line in lines) > 100


def test_a_study_file_is_saved(page: Page, server: Server, tmp_path: Path) -> None:
    open_page(page, server, "#v=1&throttle_deg=20")
    with page.expect_download() as caught:
        page.get_by_role("button", name="Study file").click()
    caught.value.save_as(tmp_path / "study.toml")
    assert "throttle_deg = 20.0" in (tmp_path / "study.toml").read_text()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_no_serious_fault(browser: Browser, server: Server, theme: str) -> None:
    """With the policy that forbids foreign scripts lifted, for axe itself is one."""
    context = browser.new_context(viewport={"width": 1280, "height": 720}, bypass_csp=True, color_scheme=theme)  # type: ignore[arg-type]  # one of its words
    page = context.new_page()
    open_page(page, server)
    page.locator("summary", has_text="Engine").click()
    page.add_script_tag(path=str(AXE))
    found = page.evaluate("axe.run().then((r) => r.violations.map((v) => [v.impact, v.id, v.nodes.map((n) => n.html.slice(0, 120))]))")
    serious = [entry for entry in found if entry[0] in {"serious", "critical"}]
    assert serious == [], json.dumps(serious, indent=1)
    context.close()


def test_a_tablet_sees_all(browser: Browser, server: Server) -> None:
    context = browser.new_context(viewport={"width": 820, "height": 1180}, has_touch=True)
    page = context.new_page()
    open_page(page, server)
    wide = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert wide[0] <= wide[1]
    for name in PLOTS:
        box = page.locator(f"#{name} canvas").bounding_box()
        assert box is not None
        assert box["width"] > 250
        assert box["height"] > 120
    context.close()


def test_a_lost_server_is_told_and_comes_back(page: Page) -> None:
    first = start()
    try:
        open_page(page, first)
    finally:
        end(first)
    write("kp", "0.9")(page)
    expect(page.locator("#banner")).to_contain_text("The server does not answer")
    assert page.locator(".stale").count() >= len(PLOTS)
    second = start(port=first.port)
    try:
        expect(page.locator("#banner")).to_be_hidden(timeout=20_000)
        settle(page)
        assert not page.locator(".stale").count()
        check_numbers(page, second)
        assert "kp=0.9" in page.url
    finally:
        end(second)
