"""What the page is as a whole: laid out for its screens, its parameters reset, its study file saved."""

import re
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import expect

from tests.web.browser.conftest import Window

Open = Callable[..., Window]


def test_the_first_view_fits_a_small_screen(open_page: Open) -> None:
    page = open_page().page
    size = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight, innerWidth, innerHeight]")
    assert size[0] <= size[2]
    assert size[1] <= size[3]
    for figure in page.locator(".plot:has(canvas)").all():
        box = figure.locator("canvas").bounding_box()
        assert box is not None
        assert box["width"] > 200
        assert box["height"] > 90
        assert figure.locator(".unseen").first.inner_text() != ""
    assert not page.locator(".stale").count()


def test_a_tablet_sees_all(open_page: Open) -> None:
    page = open_page(viewport={"width": 820, "height": 1180}, has_touch=True).page
    wide = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert wide[0] <= wide[1]
    for canvas in page.locator(".plot canvas").all():
        box = canvas.bounding_box()
        assert box is not None
        assert box["width"] > 250


def test_an_engine_parameter_is_marked_and_reset(open_page: Open) -> None:
    window = open_page()
    page = window.page
    page.locator("summary", has_text="Engine").click()
    window.set("parameters.rotation.inertia", 0.3)
    assert "parameters.rotation.inertia=0.3" in page.url
    expect(page.locator("summary .count")).to_have_text("1 changed")
    page.get_by_role("button", name=re.compile("Reset inertia")).click()
    window.settle()
    assert "inertia" not in page.url
    expect(page.locator("summary .count")).to_have_text("as published")


def test_a_study_file_is_saved(open_page: Open, tmp_path: Path) -> None:
    page = open_page("#v=1&throttle_deg=20").page
    with page.expect_download() as caught:
        page.get_by_role("button", name="Study file").click()
    caught.value.save_as(tmp_path / "study.toml")
    assert "throttle_deg = 20.0" in (tmp_path / "study.toml").read_text()
