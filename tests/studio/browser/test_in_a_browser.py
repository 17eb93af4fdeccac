"""The studio in Chromium, used by mouse and keyboard."""

from __future__ import annotations

import numpy as np
import pytest

from tests.studio.browser.conftest import drag_until, until

pytestmark = pytest.mark.slow
PHONE = {"width": 390, "height": 844}


def cords_of(studio_page):
    return {s.name: s for s in studio_page.bench.project.device.sensors}


def draw(page, points):
    """Drag with the left button through points on the screen."""
    page.mouse.move(*points[0])
    page.mouse.down()
    for x, y in points[1:]:
        page.mouse.move(x, y)
        page.wait_for_timeout(60)
    page.mouse.up()


def test_a_cord_is_drawn_by_hand_and_undone_by_keys(open_browser, studio_page):
    page, before = open_browser(), set(cords_of(studio_page))
    page.get_by_role("button", name="Draw by hand").click()
    page.get_by_role("button", name="End drawing").wait_for()
    stroke = [(40 + 33 * k, 300 - 10 * np.sin(k / 2)) for k in range(13)]
    assert drag_until(page, lambda: draw(page, stroke), lambda: set(cords_of(studio_page)) - before)
    (new,) = set(cords_of(studio_page)) - before
    page.get_by_text(f"Undo: draw {new}").wait_for()
    x = cords_of(studio_page)[new].curve.points[:, 0]
    assert np.ptp(x) > 0.5 * studio_page.bench.size
    page.keyboard.press("Control+z")
    assert until(lambda: set(cords_of(studio_page)) == before)
    page.keyboard.press("Control+Shift+z")
    assert until(lambda: new in cords_of(studio_page))


def test_two_browsers_show_the_same_device_and_one_can_be_closed(open_browser, studio_page):
    one, two = open_browser(), open_browser()
    one.get_by_role("button", name="Straight cord").click()
    assert until(lambda: len(cords_of(studio_page)) == 3)
    two.get_by_text("Undo: draw cord").wait_for()
    one.context.close()
    two.get_by_role("button", name="Undo", exact=True).click()
    assert until(lambda: len(cords_of(studio_page)) == 2)


def test_a_phone_shows_the_panel_and_the_modes(open_browser, studio_page):
    page = open_browser(PHONE)
    for text in ("Expected error in unseen states", "Straight cord"):
        box = page.get_by_text(text).bounding_box()
        assert 0 <= box["x"] < box["x"] + box["width"] <= PHONE["width"] + 1
    page.get_by_role("button", name="Make", exact=True).click()
    assert until(lambda: studio_page.bench.mode == "Make")
