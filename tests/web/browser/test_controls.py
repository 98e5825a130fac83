"""Controls and links of the page beyond the numbers: limits, engines, panels, keys, fingers, and what is said where something cannot be."""

import re
from collections.abc import Callable

from playwright.sync_api import CDPSession, Page, expect

from tests.web.browser.conftest import Window

Open = Callable[..., Window]


def test_limits_and_engines_are_chosen_and_taken_back(open_page: Open) -> None:
    window = open_page("#v=1&open=engine")
    page = window.page
    expect(page.locator("#high_deg-number")).to_have_attribute("placeholder", "79.46")
    window.set("high_deg", 40.0)
    assert "upper limit,0,40" in window.curves("throttle")
    window.set("low_deg", 50.0)
    expect(page.locator("#low_deg-fault")).to_contain_text("low_deg = 50 deg is not below high_deg = 40 deg")
    page.keyboard.press("Control+z")  # while the field has the focus
    window.settle()
    assert page.input_value("#low_deg-number") == ""
    page.get_by_role("button", name="Reset the limits").click()
    window.settle()
    assert "upper limit,0,79.46" in window.curves("throttle")
    page.route("**/api/v1/view", lambda route: route.fulfill(json={"parts": {}}))  # another engine's kernels would have to be built
    page.select_option("#engine-choice", "lee1995-generic")
    expect(page.locator('[id="parameters.efficiency.line_slope-number"]')).to_be_visible()
    expect(page).to_have_url(re.compile("engine=lee1995-generic"))  # written once things have rested


def test_a_link_shows_what_is_open_too(open_page: Open) -> None:
    window = open_page()
    here = window.page
    here.select_option("#phase-error select", "distortion")
    here.click("summary:has-text('Engine')")
    here.click("#data-open")
    here.click("#tour")
    for _ in range(2):
        here.keyboard.press("ArrowRight")
    here.wait_for_selector("#guide h2:has-text('3 of 8')")
    window.settle()
    there = open_page("#" + here.url.partition("#")[2])
    for shown in ("#distortion", "#data[open]", "details[open]", "#guide h2:has-text('3 of 8')"):
        expect(there.page.locator(shown)).to_be_visible()
    assert there.page.url == here.url
    there.page.keyboard.press("Escape")
    assert open_page("#v=1&errors=all").page.inner_text("#banner").startswith("errors = all in the link means nothing here")


def reach(page: Page, selector: str) -> None:
    """Go on by Tab until something has the focus, and see that it is marked."""
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate("wanted => document.activeElement.matches(wanted)", selector):
            assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
            return
    message = f"Tab never reaches {selector}"
    raise AssertionError(message)


def test_the_keyboard_alone_does_all(open_page: Open) -> None:
    window = open_page("#v=1&kp=0.9")
    page, press = window.page, window.page.keyboard.press
    reach(page, ".skip")
    press("Enter")
    expect(page.locator("#plots")).to_be_focused()
    assert window.state()["kp"] == 0.9  # nothing but the focus has moved
    reach(page, "#map .handle")
    press("ArrowRight")
    press("Shift+ArrowUp")
    reach(page, "#plane .handle")
    for key in ("ArrowRight", "ArrowRight", "Shift+ArrowUp", "ArrowDown"):
        press(key)
    expect(page.locator("#plane .handle")).to_have_attribute("aria-valuetext", "kp 0.92, ki 2.9")
    moved = window.settle().state()
    assert (moved["throttle_deg"], moved["kp"], moved["ki"]) == (26.1, 0.92, 2.9)
    page.keyboard.down("ArrowLeft")
    page.keyboard.down("ArrowLeft")
    page.keyboard.up("ArrowLeft")
    assert window.settle().state()["kp"] == 0.9
    press("Control+z")  # a key that is held is one step
    assert window.settle().state() == moved
    page.evaluate("document.activeElement.blur()")
    reach(page, "#tour")
    press("Enter")
    expect(page.locator("#guide h2")).to_be_focused()
    reach(page, "#guide button:nth-of-type(2)")
    press("Enter")
    expect(page.locator("#guide h2")).to_contain_text("2 of 8")
    press("Escape")
    expect(page.locator("#tour")).to_be_focused()
    assert window.settle().state() == moved
    reach(page, "#throttle_deg-slider")
    press("ArrowRight")
    assert window.settle().state()["throttle_deg"] != moved["throttle_deg"]
    reach(page, "summary")
    press("Enter")
    page.route("**/api/v1/view", lambda route: route.fulfill(json={"parts": {}}))  # another engine's kernels would have to be built
    reach(page, "#engine-choice")
    press("ArrowDown")
    expect(page.locator("summary .count")).to_contain_text("generic efficiency")


def touch(session: CDPSession, kind: str, *points: tuple[float, float]) -> None:
    session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]})


def test_one_finger_drags_and_two_do_not(open_page: Open) -> None:
    window = open_page(viewport={"width": 768, "height": 1024}, has_touch=True)
    session = window.page.context.new_cdp_session(window.page)
    box = window.page.locator("#map .u-over").bounding_box()
    assert box is not None
    x, y = box["x"] + 80.0, box["y"] + 80.0
    touch(session, "touchStart", (x, y))
    for k in range(1, 4):
        touch(session, "touchMove", (x + 12.0 * k, y))
    touch(session, "touchEnd")
    dragged = window.settle().state()
    assert dragged["throttle_deg"] != 25.0
    assert window.page.is_enabled("#undo")
    touch(session, "touchStart", (x, y))
    touch(session, "touchStart", (x, y), (x + 60.0, y + 30.0))
    for k in range(1, 6):
        touch(session, "touchMove", (x, y - 12.0 * k), (x + 60.0, y + 30.0 - 12.0 * k))
    touch(session, "touchEnd")
    window.page.wait_for_function("throttle => window.workbench.state().throttle_deg === throttle", arg=dragged["throttle_deg"])


def test_what_cannot_be_is_said_where_it_is_asked_for(open_page: Open) -> None:
    window = open_page("#v=1&amplitude_deg=40")
    page = window.page
    expect(page.locator("#amplitude_deg-number")).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#phase-error .why")).to_contain_text("give 25 deg or less")
    assert {line.split(",")[0] for line in window.curves("magnitude").splitlines()[1:]} == {'"exact'}
    assert '"engine, exact, loop"' in window.curves("roots")
    expect(page.locator("#plane .legend")).to_contain_text("Ms 1.4: none")
    window.set("amplitude_deg", 5).set("throttle_deg", 79.4)
    expect(page.locator("#throttle_deg-fault.remark")).to_contain_text("begins near by, at throttle = 79.5569 deg")
    assert page.get_attribute("#throttle_deg-number", "aria-invalid") is None
    window.set("throttle_deg", 25).set("kp", 0).set("ki", 0).set("kd", 0)
    assert page.inner_text("#verdict").startswith("no control: ")
    expect(page.locator("#said")).to_have_text(page.inner_text("#verdict"))
