"""The step Inside of the new page, used by mouse and keyboard in a browser."""

import re
import shutil
import socket

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.machine.local_access import Access
from defsense_fab.studio.app.studio_app import StudioApp
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.workflow.view import HOST, WebServer

pytest.importorskip("playwright")
from playwright.sync_api import expect

pytestmark = pytest.mark.slow
SIZE = {"width": 800, "height": 600}  # small, because the processor draws it
TIMEOUT_MS = 240_000.0  # on a loaded machine

expect.set_options(timeout=TIMEOUT_MS)


def free_port():
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]


@pytest.fixture
def page(browser, live_bar, tmp_path):
    """Open the step Inside of a copy of a built bar."""
    folder = tmp_path / "bar"
    shutil.copytree(live_bar.folder, folder)
    port = free_port()
    server = WebServer(port, Access(HOST), HOST)
    app = StudioApp(server, folder, Agreement(trusted=True))
    server.start(app)
    context = browser.new_context(viewport=SIZE, device_scale_factor=0.5)
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.folder = folder
    page.goto(f"http://127.0.0.1:{port}/")
    page.get_by_role("button", name="Inside").click()
    page.get_by_role("button", name="Not now").click()
    page.get_by_role("figure", name="Colors: Largest principal strain").wait_for()
    yield page
    context.close()
    app.close()
    server.close()


def offset(page):
    return float(page.get_by_label("Offset, number").input_value())


def test_the_plane_is_moved_by_keys_and_numbers(page):
    handle = page.get_by_role("button", name="Move the plane along its normal")
    handle.press("ArrowUp")
    expect(page.get_by_label("Offset, number")).not_to_have_value("0")
    assert 0 < offset(page) < 2
    field = page.get_by_label("Offset, number")
    field.fill("900")
    field.press("Enter")
    expect(page.get_by_text("you typed 900")).to_be_visible()
    page.get_by_role("radio", name="X", exact=True).check(force=True)
    expect(page.get_by_label("Offset, number")).to_have_value("0")


def test_the_plane_is_dragged_by_its_arrow(page):
    handle = page.get_by_role("button", name="Move the plane along its normal")
    box = None
    while box != (box := handle.bounding_box()):  # until the view is at rest
        page.wait_for_timeout(1000)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 40, steps=5)
    expect(page.get_by_text(re.compile(r"^Offset .* mm$"))).to_be_visible()
    page.mouse.up()
    expect(page.get_by_label("Offset, number")).not_to_have_value("0")


def test_states_are_scrubbed(page):
    slider = page.get_by_role("slider", name="State")
    slider.press("Home")
    expect(slider).to_have_attribute("aria-valuetext", "At rest")
    slider.press("ArrowRight")
    expect(slider).to_have_attribute("aria-valuetext", re.compile(r"%"))


def test_the_best_cord_of_the_plane_is_added(page):
    names = [sensor.name for sensor in load_device(page.folder).sensors]
    toggle = page.get_by_role("button", name="Where a cord would help")
    toggle.click()
    expect(toggle).to_have_attribute("aria-pressed", "true")
    page.get_by_text("Short", exact=True).click()
    add = page.get_by_role("button", name="Add the best")
    expect(add).not_to_have_attribute("aria-disabled", "true")
    add.click()
    expect(page.get_by_text(re.compile("^Added cord"))).to_be_visible()
    assert len(load_device(page.folder).sensors) == len(names) + 1
    page.get_by_role("button", name="Undo", exact=True).first.click()
    page.wait_for_timeout(1000)
    assert [sensor.name for sensor in load_device(page.folder).sensors] == names
