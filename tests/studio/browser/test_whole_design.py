"""A design from an empty folder to exported parts, by mouse and keyboard, and by keyboard alone."""

from __future__ import annotations

import hashlib
import shutil
import sys
import zipfile

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.workflow.build.build import build
from tests.studio.browser.conftest import until
from tests.studio.browser.person import Person
from tests.studio.browser.screens import inspector, step_button

pytest.importorskip("playwright")
from playwright.sync_api import expect

pytest.importorskip("playwright")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

#: Whether the path of a ring has not changed for a second.
AT_REST = """path => {
    const [shape, now] = [path.getAttribute("d"), performance.now()];
    if (path.lastShape !== shape) Object.assign(path, { lastShape: shape, changedAt: now });
    return now - path.changedAt > 1000;
}"""
#: Five points of a ring in the window that are next to each other and not covered.
VISIBLE_PART = """path => {
    const place = (share) => {
        const point = path.getPointAtLength(share * path.getTotalLength());
        const { x, y } = point.matrixTransform(path.getScreenCTM());
        return document.elementFromPoint(x, y) === path ? [x, y] : null;
    };
    const places = Array.from({ length: 40 }, (_, k) => place((k + 0.5) / 40));
    const parts = places.map((_, k) => places.slice(k, k + 5));
    return parts.find((part) => part.length === 5 && part.every(Boolean));
}"""


class Design:
    """A new device and the user who designs it.

    Attributes:
        person: The user.
        folder: The device's folder.
    """

    def __init__(self, page, folder):
        self.page, self.person, self.folder = page, Person(page), folder

    @property
    def device(self):
        """The device as its file describes it."""
        return load_device(self.folder)

    def button(self, name):
        """Return the button of a name in the entered step, or in the bar of the page."""
        return self.page.get_by_role("button", name=name, exact=True)

    def next(self, label):
        """Return the button of the next action, once it has a label."""
        return self.page.get_by_role("banner").get_by_role("button", name=label)

    def cords(self, count):
        """Wait until the predicted error is that of a number of cords."""
        table = self.page.get_by_role("table", name="Expected error and signals of each pose")
        fixed = 2  # columns of the pose and its error
        assert until(lambda: table.get_by_role("columnheader").count() == fixed + count)

    def angle(self):
        """Return the angle of the tip in the first pose, degrees."""
        return float(self.page.get_by_role("spinbutton", name="Angle").input_value())


@pytest.fixture
def design(serve, open_page, tmp_path):
    folder = tmp_path / "arm"
    studio = serve(folder, trusted=False)
    return Design(open_page(studio.url, accept_downloads=True), folder)


def along_visible_part(ring):
    """Return points of the window along a part of a ring that nothing covers, px."""
    ring.page.wait_for_function(AT_REST, arg=ring.element_handle())
    return ring.evaluate(VISIBLE_PART)


def hashes(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.glob("*.st*")}


def check_export(design, download, copy, tmp_path):
    """Compare the exported parts with those that the library builds from a copy of the device."""
    zipped = tmp_path / "export.zip"
    download.save_as(zipped)
    build(load_device(copy), "fabricate")
    with zipfile.ZipFile(zipped) as whole:
        whole.extractall(tmp_path / "out")
    (exported,) = (p for p in (tmp_path / "out").rglob("parts") if p.is_dir())
    assert hashes(exported) == hashes(copy / "build" / "parts") != {}
    sys.stdout.write(f"{design.person}\n")  # with pytest -s


def test_a_device_is_designed_and_exported(design, tmp_path):
    page, person = design.page, design.person
    person.click(page.get_by_role("main").get_by_role("button", name="Bar Three cords"))
    expect(page.get_by_text("New here?")).to_have_count(1)
    person.click(design.button("Create the device"))

    # Few elements, one decoder and one search: they take a fraction of the time.
    page.get_by_label("Edge length", exact=True).wait_for()
    expect(page.get_by_text("New here?")).to_have_count(0)  # it was offered on the start page
    for label, value in (("Edge length", "20"), ("Largest number of searches", "1")):
        person.click(page.get_by_label(label, exact=True))
        person.write(value)
    page.get_by_label("Decoder", exact=True).select_option("affine")
    assert until(lambda: design.device.decoder == "affine")
    assert (design.device.mesh.edge_length, design.device.searches) == (20, 1)

    design.next("Simulate the poses").wait_for()  # once the body is made
    expect(step_button(page, "Body")).to_have_attribute("aria-current", "step")
    person.click(step_button(page, "Poses"))  # where it is meshed
    ring = page.get_by_role("slider", name="Turn tip about y")
    ring.wait_for()
    states = page.get_by_role("group", name="States")
    person.click(states.get_by_role("button", name="bend_down"))
    person.press("Delete")
    assert until(lambda: [pose.name for pose in design.device.poses] == ["bend_up", "twist"])
    person.click(states.get_by_role("button", name="bend_up"))
    ring.wait_for()
    before = design.angle()
    person.drag(along_visible_part(ring))
    assert until(lambda: design.angle() != before)

    person.click(design.next("Simulate the poses"))
    design.next("Optimize the cords").wait_for()

    person.click(step_button(page, "Sensors"))
    page.get_by_text("Select a cord to see and change it").wait_for()
    person.press("Control+a")
    person.click(inspector(page, "Sensors").get_by_role("button", name="Delete"))
    page.get_by_text("The device has no cords yet").wait_for()
    person.click(inspector(page, "Sensors").get_by_role("button", name="Draw"))
    page.get_by_role("slider", name="Offset of the plane").wait_for()
    for count, level in enumerate((-0.05, 0.05), start=1):
        person.draw(level)
        design.cords(count)
    person.press("Escape")

    person.click(step_button(page, "Make"))
    person.click(page.get_by_role("button", name="Build the parts"))
    question = page.get_by_role("dialog", name="Which cords should the parts contain?")
    question.get_by_role("button", name="Build these cords as drawn").wait_for()
    person.press("Escape")
    question.wait_for(state="detached")
    assert all(sensor.free for sensor in design.device.sensors)

    person.click(design.next("Optimize the cords"))
    person.click(design.button("Use the optimized cords"))
    page.get_by_text("The drawn cords are the optimized ones").wait_for()
    copy = shutil.copytree(design.folder, tmp_path / "elsewhere")  # with its search

    person.click(design.next("Build the parts"))
    page.get_by_text("The parts are up to date").wait_for()
    with page.expect_download() as download:
        person.click(design.button("Export as zip"))
    check_export(design, download.value, copy, tmp_path)


def test_a_device_is_designed_by_keyboard_alone(design, tmp_path):
    page, person = design.page, design.person
    bar = page.get_by_role("main").get_by_role("button", name="Bar Three cords")
    bar.wait_for()
    person.tab_to(bar)
    person.press("Enter")
    page.get_by_role("dialog").get_by_role("textbox", name="Name").wait_for()
    person.press("Enter")

    edge = page.get_by_label("Edge length", exact=True)
    edge.wait_for()
    person.tab_to(edge)
    person.write("20")
    person.tab_to(page.get_by_label("Decoder", exact=True))
    person.choose("affine")
    person.tab_to(page.get_by_label("Largest number of searches", exact=True))
    person.write("1")
    assert until(lambda: design.device.searches == 1)
    assert (design.device.mesh.edge_length, design.device.decoder) == (20, "affine")

    person.command("Go to Poses")
    states = page.get_by_role("group", name="States")
    person.tab_to(states.get_by_role("button", name="bend_down"))
    person.press("Enter", "Delete")
    assert until(lambda: [pose.name for pose in design.device.poses] == ["bend_up", "twist"])
    person.tab_to(states.get_by_role("button", name="bend_up"))
    person.press("Enter")
    person.tab_to(page.get_by_role("spinbutton", name="Angle"))
    person.write("-25")
    design.next("Simulate the poses").wait_for()
    person.press("Control+Enter")
    design.next("Optimize the cords").wait_for()

    person.command("Go to Sensors")
    page.get_by_text("Select a cord to see and change it").wait_for()
    person.press("Control+a")
    page.get_by_role("heading", name="3 cords").wait_for()
    person.press("Delete")
    page.get_by_text("The device has no cords yet").wait_for()
    for count, name in enumerate(("A", "B"), start=1):
        person.press("n")
        page.get_by_role("heading", name=name, exact=True).wait_for()
        design.cords(count)
    person.press("g")
    person.tab_to(page.get_by_role("button", name="Move the plane along its normal"))
    person.press("Shift+ArrowUp", "g")  # by 5 mm
    person.tab_to(page.get_by_role("button", name="B, point 3 of 6"))
    before = design.device.sensors[1].curve.points[2].copy()
    person.press("ArrowUp")
    assert until(lambda: design.device.sensors[1].curve.points[2][1] == before[1] + 0.5)

    design.next("Optimize the cords").wait_for()
    person.press("Control+Enter")
    use = design.button("Use the optimized cords")
    use.wait_for()
    person.tab_to(use)
    person.press("Enter")
    page.get_by_text("The drawn cords are the optimized ones").wait_for()
    copy = shutil.copytree(design.folder, tmp_path / "elsewhere")
    design.next("Build the parts").wait_for()
    person.press("Control+Enter")
    page.get_by_text("The parts are up to date").wait_for()
    person.tab_to(design.button("Export as zip"))
    with page.expect_download() as download:
        person.press("Enter")
    check_export(design, download.value, copy, tmp_path)
    assert person.clicks == 0
