"""The page of the workbench as a user meets it."""

import json
import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from playwright.sync_api import Route

from tests.web.browser.conftest import ROOT, Server, Window

Open = Callable[..., Window]
PLOTS = ("map", "magnitude", "phase", "plane", "magnitude-error", "phase-error", "distortion", "roots", "speed", "throttle")
PLANT = frozenset(PLOTS)
BY_GAIN = frozenset({"plane", "roots", "speed", "throttle"})
CHANGES = (
    ("throttle_deg", 30.0, PLANT),
    ("load_n_m", 5.0, PLANT),
    ("amplitude_deg", 8.0, PLANT - {"plane"}),
    ("kp", 0.8, BY_GAIN),
    ("ki", 4.0, BY_GAIN),
    ("kd", 0.05, BY_GAIN),
    ("command_rad_s", 20.0, frozenset({"speed", "throttle"})),
    ("until_s", 2.0, frozenset({"speed", "throttle"})),
    ("parameters.rotation.inertia", 0.2, PLANT - {"map"}),
)


def ask(server: Server, state: dict[str, Any], *parts: str) -> dict[str, Any]:
    answer = httpx.post(f"{server.address}api/v1/view", json={"state": state, "parts": list(parts)}, timeout=30.0)
    return dict(answer.json()["parts"])


def rounded(table: str) -> str:
    """A table with its numbers to 9 digits: what is found anew may differ in the last."""
    return re.sub(r"-?\d+\.\d+(?:e-?\d+)?", lambda number: f"{float(number[0]):.9g}", table)


def test_each_control_changes_each_plot_it_should(open_page: Open) -> None:
    window = open_page()
    window.page.click("summary:has-text('Engine')")
    for control, value, wanted in CHANGES:
        before = {plot: rounded(window.curves(plot)) for plot in PLOTS}
        window.set(control, value)
        changed = {plot for plot in PLOTS if rounded(window.curves(plot)) != before[plot]}
        assert changed == wanted, control


def test_numbers_shown_are_the_servers(open_page: Open, server: Server) -> None:
    window = open_page("#v=1&throttle_deg=30&kp=0.9&ki=3&kd=0.06&command_rad_s=25")
    found = ask(server, window.state(), "margins", "promises", "words", "loop")
    rows = {cells[0]: cells[1:] for row in window.page.locator("#numbers tr").all() if (cells := row.locator("th, td").all_inner_texts())}
    assert rows["gain (dB)"][0] == f"{found['margins']['gain_margin_db']:.2f}"
    assert rows["phase (deg)"][0] == f"{found['margins']['phase_margin_deg']:.1f}"
    assert rows["delay (ms)"][3] == f"{1000 * found['promises']['g2d']['delay_margin_s']:.2f}"
    assert window.page.inner_text("#verdict") == found["words"]["verdict"]
    last = f"engine,{json.dumps(found['loop']['time_s'][-1])}"
    drawn = next(line for line in window.curves("speed").splitlines() if line.startswith(last.removesuffix(".0")))
    assert float(drawn.split(",")[2]) == pytest.approx(found["loop"]["speed_rad_s"][-1], rel=1e-6)


def test_a_link_shows_the_same_elsewhere(open_page: Open) -> None:
    here = open_page()
    here.set("kp", 2.153).set("throttle_deg", 28)
    there = open_page(here.page.url.partition("/#")[2] and "#" + here.page.url.partition("#")[2])
    assert there.state() == here.state()
    assert {plot: there.curves(plot) for plot in PLOTS} == {plot: here.curves(plot) for plot in PLOTS}
    assert there.page.inner_text("#verdict") == here.page.inner_text("#verdict")


def test_a_broken_link_says_what_is_wrong(open_page: Open) -> None:
    window = open_page("#v=1&kp=much")
    assert "kp = much" in window.page.inner_text("#banner")
    assert window.state()["kp"] == 1.2


def test_a_drag_is_one_step_back(open_page: Open) -> None:
    window = open_page()
    for plot, keys in (("map", ("throttle_deg",)), ("plane", ("kp", "ki"))):
        before = window.state()
        box = window.page.locator(f"#{plot} .u-over").bounding_box()
        assert box is not None
        x, y = box["x"], box["y"]
        window.page.mouse.move(x + 0.3 * box["width"], y + 0.6 * box["height"])
        window.page.mouse.down()
        window.page.mouse.move(x + 0.4 * box["width"], y + 0.7 * box["height"], steps=5)
        window.page.mouse.up()
        window.settle()
        moved = window.state()
        assert all(moved[key] != before[key] for key in keys)
        window.page.keyboard.press("Control+z")
        window.settle()
        assert window.state() == before
        window.page.keyboard.press("Control+Shift+z")
        window.settle()
        assert window.state() == moved


def test_sliders_follow_the_arrows(open_page: Open) -> None:
    window = open_page()
    window.page.focus("#kp-slider")
    window.page.keyboard.press("ArrowRight")
    window.settle()
    assert window.state()["kp"] != 1.2


def test_the_tour_runs_to_its_end_and_leaves_all_as_it_was(open_page: Open) -> None:
    window = open_page("#v=1&kp=0.7")
    before = window.state()
    window.page.click("#tour")
    titles = []
    for _ in range(8):
        titles.append(window.page.inner_text("#guide h2"))
        if re.search("hunts", titles[-1]):
            window.settle()
            assert "hunts between 291" in window.page.inner_text("#verdict")
        window.page.keyboard.press("ArrowRight")
    assert [title[:6] for title in titles] == [f"{number} of 8" for number in range(1, 9)]
    assert window.settle().page.is_hidden("#guide")
    assert window.state() == before


def test_a_problem_stands_at_its_control_and_the_last_plots_stay(open_page: Open) -> None:
    window = open_page()
    before = window.curves("speed")
    window.set("load_n_m", 500)
    assert window.page.locator("#throttle_deg-fault, #load_n_m-fault").filter(visible=True).count() == 1
    assert "stale" in str(window.page.get_attribute("#speed", "class"))
    assert window.curves("speed") == before
    window.set("load_n_m", 0)
    assert "stale" not in str(window.page.get_attribute("#speed", "class"))
    assert window.page.locator(".fault").filter(visible=True).count() == 0
    window.complaints = [text for text in window.complaints if "422" not in text]  # the browser's own word for a refused state


def test_what_is_left_for_later_is_greyed_and_follows(open_page: Open) -> None:
    """Where many ask at once a move is answered in pieces; none is shown beside the numbers of another state, and all are in the end."""
    window = open_page()
    before = {plot: window.curves(plot) for plot in ("speed", "plane", "magnitude")}
    asked: list[list[str]] = []
    seen: list[tuple[str, str, bool]] = []

    def pieces(route: Route) -> None:
        body: Any = route.request.post_data_json
        asked.append(body["parts"])
        if len(asked) > 1:
            if "loop" in body["parts"]:
                greyed = "stale" in str(window.page.get_attribute("#speed", "class"))
                seen.append((window.page.inner_text("#verdict"), window.curves("plane"), greyed))
            route.continue_()
            return
        found = route.fetch().json()
        later = ["loop", "words", "answers"]
        route.fulfill(json={**found, "parts": {name: part for name, part in found["parts"].items() if name not in later}, "later": later})

    window.page.route("**/api/v1/view", pieces)
    window.set("kp", 0.7)
    assert {"loop", "words", "answers", "margins"} <= set(asked[0])
    assert set(asked[1]) == {"loop", "words", "answers"}
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
    window.complaints = [text for text in window.complaints if "503" not in text]


def test_an_answer_that_is_cut_off_is_asked_for_again(open_page: Open) -> None:
    window = open_page()
    asked: list[object] = []

    def cut(route: Route) -> None:
        asked.append(route.request.post_data_json)
        if len(asked) == 1:
            route.fulfill(status=200, content_type="application/json", body='{"parts":{"loop":')
        else:
            route.continue_()

    window.page.route("**/api/v1/view", cut)
    window.set("kp", 0.6)
    assert asked[1] == asked[0]
    assert str(window.page.text_content("#banner")).startswith("The server's answer was cut off; what is shown is the last it said.")
    assert window.page.is_hidden("#banner")
    assert "stale" not in str(window.page.get_attribute("#speed", "class"))


def test_a_map_of_another_state_is_greyed_until_its_own_comes(open_page: Open) -> None:
    window = open_page()
    window.set("load_n_m", 500)
    held: list[Route] = []

    def hold(route: Route) -> None:
        body: Any = route.request.post_data_json
        if body["parts"] == ["map"]:
            held.append(route)
        else:
            route.continue_()

    window.page.route("**/api/v1/view", hold)
    window.page.fill("#load_n_m-number", "5")
    window.page.press("#load_n_m-number", "Enter")
    window.page.wait_for_selector("#speed:not(.stale)")
    assert window.page.locator(".plot.stale:visible").evaluate_all("them => them.map(one => one.id)") == ["map"]
    (route,) = held
    route.continue_()
    window.settle()
    assert "stale" not in str(window.page.get_attribute("#map", "class"))
    assert "linear range,8." not in window.curves("map")  # that of no load
    window.complaints = [text for text in window.complaints if "422" not in text]


LOG = "time_s,throttle_deg,speed_rad_s\n" + "".join(f"{k / 20},{25 if k < 20 else 28},{240.8 if k < 20 else 276}\n" for k in range(80))


def serious(window: Window) -> list[str]:
    """What axe finds wrong with the page as it is, down to what is moderate."""
    found = window.page.evaluate("() => axe.run(document, {resultTypes: ['violations']})")
    return [f"{one['id']}: {one['nodes'][0]['html'][:120]}" for one in found["violations"] if one["impact"] != "minor"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault(open_page: Open, scheme: str) -> None:
    """As the page opens; and with all open, a log dropped, a problem told and the tour on its way."""
    window = open_page(color_scheme=scheme, bypass_csp=True)
    page = window.page
    page.add_script_tag(path=ROOT / "page" / "node_modules" / "axe-core" / "axe.min.js")
    assert serious(window) == []
    page.click("summary:has-text('Engine')")
    for opener in ("#tour", "#jobs-open", "#data-open"):
        page.click(opener)
    page.set_input_files("#file", {"name": "log.csv", "mimeType": "text/csv", "buffer": LOG.encode()})
    page.wait_for_selector("#log canvas")
    window.set("load_n_m", 500)
    assert serious(window) == []
    page.keyboard.press("Escape")
    page.locator("#plane [aria-label$='as a table']").focus()
    page.keyboard.press("Enter")
    assert page.locator("dialog:modal").count() == 1
    assert serious(window) == []
    window.complaints = [text for text in window.complaints if "422" not in text]


@pytest.mark.parametrize("kind", ["PNG", "SVG", "CSV"])
def test_plots_can_be_saved(open_page: Open, kind: str) -> None:
    window = open_page()
    window.page.hover("#plane")
    with window.page.expect_download() as coming:
        window.page.click(f"#plane .downloads button:has-text('{kind}')")
    content = coming.value.path().read_bytes()
    assert {"PNG": b"\x89PNG", "SVG": b"<svg", "CSV": b"curve,kp (deg/(rad/s)),"}[kind] in content[:60]
    assert len(content) > 1000
    if kind == "SVG":  # what is drawn in the plot is in the file: the shaded area, rings, the dot
        assert all(f'class="{part}"'.encode() in content for part in ("shade", "ring", "dot"))
