"""The step Inside, used by mouse and keyboard in a browser."""

from __future__ import annotations

import re
import shutil

import pytest

from defsense_fab.core.device.device_file import load_device
from tests.studio.browser.conftest import until
from tests.studio.browser.screens import dismiss_introduction, enter

pytest.importorskip("playwright")
from playwright.sync_api import expect

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(live_bar, tmp_path):
    return shutil.copytree(live_bar.folder, tmp_path / "bar")


@pytest.fixture
def page(serve, open_page, folder):
    """Open the step Inside of a built bar."""
    page = open_page(serve(folder).url)
    dismiss_introduction(page)
    enter(page, "Inside")
    return page


def offset(page):
    return float(page.get_by_label("Offset, number").input_value())


def test_the_plane_is_moved_by_keys_and_numbers(page):
    handle = page.get_by_role("button", name="Move the plane along its normal")
    box = None
    while box != (box := handle.bounding_box()):  # until the view is at rest
        page.wait_for_timeout(1000)
    handle.press("Shift+ArrowUp")
    expect(page.get_by_label("Offset, number")).not_to_have_value("0")
    assert abs(offset(page)) == 5
    assert until(lambda: handle.bounding_box()["y"] < box["y"])  # upward on the screen
    field = page.get_by_label("Offset, number")
    field.fill("900")
    field.press("Enter")
    expect(page.get_by_text("you typed 900")).to_be_visible()
    page.get_by_role("radio", name="X", exact=True).check(force=True)
    expect(page.get_by_label("Offset, number")).to_have_value("0")


def middle(handle):
    box = None
    while box != (box := handle.bounding_box()):  # until the view is at rest
        handle.page.wait_for_timeout(1000)
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_the_plane_is_dragged_by_its_arrow(page):
    x, y = middle(page.get_by_role("button", name="Move the plane along its normal"))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 40, steps=5)
    expect(page.get_by_text(re.compile(r"^Offset .* mm$"))).to_be_visible()
    page.mouse.up()
    expect(page.get_by_label("Offset, number")).not_to_have_value("0")


def test_a_plane_that_leaves_the_body_returns_when_it_is_dropped(page):
    handle = page.get_by_role("button", name="Move the plane along its normal")
    x, y = middle(handle)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 300, steps=10)
    expect(page.get_by_text("The plane misses the body")).to_be_visible()
    page.mouse.up()
    expect(page.get_by_text("The plane misses the body")).to_have_count(0)
    expect(handle).to_be_visible()
    assert abs(offset(page)) < 20


def test_states_are_scrubbed(page):
    slider = page.get_by_role("slider", name="State")
    slider.press("Home")
    expect(slider).to_have_attribute("aria-valuetext", "At rest")
    slider.press("ArrowRight")
    expect(slider).to_have_attribute("aria-valuetext", re.compile(r"%"))


def test_the_best_cord_of_the_plane_is_added(page, folder):
    names = [sensor.name for sensor in load_device(folder).sensors]
    toggle = page.get_by_role("button", name="Where a cord would help")
    toggle.click()
    expect(toggle).to_have_attribute("aria-pressed", "true")
    add = page.get_by_role("button", name="Add the best")
    expect(add).not_to_have_attribute("aria-disabled", "true")
    page.get_by_text("Short", exact=True).click()
    expect(add).to_have_attribute("aria-disabled", "true")  # until the new search has a result
    expect(add).not_to_have_attribute("aria-disabled", "true")
    add.click()
    expect(page.get_by_text(re.compile("^Added [A-Z]"))).to_be_visible()
    assert len(load_device(folder).sensors) == len(names) + 1
    page.get_by_role("button", name="Undo", exact=True).first.click()
    assert until(lambda: [sensor.name for sensor in load_device(folder).sensors] == names)
