"""The page of a built device in Chromium, used by mouse, keyboard and touch-sized windows."""

from __future__ import annotations

import re
import shutil

import pytest

from defsense_fab.core.device.device_file import DEVICE, load_device
from defsense_fab.core.errors import LayoutError, MeshingError
from tests.studio.browser.conftest import PHONE, until
from tests.studio.browser.screens import dismiss_introduction, enter, inspector, step_button
from tests.support.unmakeable_cord import unmakeable_cord

pytest.importorskip("playwright")
from playwright.sync_api import expect

pytestmark = pytest.mark.slow
CORD_Y_MM = 8.0  # of the straight cord `A`
SCALE = re.compile(r"Scale: (\d+) mm")


@pytest.fixture
def folder(made_bar, tmp_path):
    return shutil.copytree(made_bar, tmp_path / "bar")


@pytest.fixture
def studio(serve, folder):
    return serve(folder)


@pytest.fixture
def open_sensors(open_page, studio):
    """Return a function that opens the step Sensors in a new browser."""

    def open_step(**options):
        page = open_page(studio.url, **options)
        dismiss_introduction(page)
        enter(page, "Sensors")
        return page

    return open_step


def cord(page, name):
    """Return the row of a cord in the tree."""
    return page.get_by_role("treeitem", name=re.compile(rf"^{name}(:|$)"))


def select(page, name):
    """Select a cord in the tree, and wait for its handles."""
    page.get_by_role("button", name="Show the list of parts").click()
    cord(page, name).click()
    point(page, name).wait_for()


def point(page, name):
    """Return the handle in the middle of a cord."""
    return page.get_by_role("button", name=f"{name}, point 4 of 8")


def headline(page):
    """Return the error of the drawn cords, as it is displayed."""
    panel = page.get_by_role("region", name="Expected error and signals")
    return panel.get_by_text("without the cuts", exact=False).first


def middle(locator):
    """Return the middle of an element in the window, px, once it is at rest."""
    box, last = locator.bounding_box(), None
    while box != last:
        locator.page.wait_for_timeout(300)
        last, box = box, locator.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def undo(page):
    return page.get_by_role("button", name="Undo", exact=True).first


def test_a_cord_clicked_in_the_scene_is_selected_everywhere(open_sensors):
    page = open_sensors()
    page.get_by_role("button", name="Show the list of parts").click()
    page.get_by_role("button", name="Standard views").click()
    page.get_by_role("menuitem", name="Top").click()
    scale = page.get_by_role("img", name=SCALE)
    x, y = middle(page.get_by_role("application"))
    middle(scale)  # until the view is turned
    length_mm = float(SCALE.search(scale.get_attribute("aria-label"))[1])
    px_per_mm = scale.locator("div").bounding_box()["width"] / length_mm
    page.mouse.click(x, y - CORD_Y_MM * px_per_mm)
    expect(cord(page, "A")).to_have_attribute("aria-selected", "true")
    expect(cord(page, "B")).to_have_attribute("aria-selected", "false")
    heading = inspector(page, "Sensors").get_by_role("heading", name="A", exact=True)
    expect(heading).to_be_visible()
    page.keyboard.press("Escape")
    expect(cord(page, "A")).to_have_attribute("aria-selected", "false")


def test_a_dragged_point_is_judged_at_once_and_is_one_undo_step(open_sensors, folder):
    page = open_sensors()
    select(page, "A")
    text, error = (folder / DEVICE).read_text(), headline(page).inner_text()
    x, y = middle(point(page, "A"))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 4, y - 12, steps=3)
    expect(headline(page)).not_to_have_text(error)  # while the button is down
    assert (folder / DEVICE).read_text() == text
    page.mouse.move(x + 8, y - 24, steps=3)
    page.mouse.up()
    assert until(lambda: (folder / DEVICE).read_text() != text)
    expect(undo(page)).to_be_enabled()
    page.keyboard.press("Control+z")
    expect(undo(page)).to_be_disabled()
    assert (folder / DEVICE).read_text() == text
    expect(headline(page)).to_have_text(error)


def test_escape_restores_a_dragged_point(open_sensors, folder):
    page = open_sensors()
    select(page, "A")
    text, error = (folder / DEVICE).read_text(), headline(page).inner_text()
    x, y = middle(point(page, "A"))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 30, steps=3)
    expect(headline(page)).not_to_have_text(error)
    page.keyboard.press("Escape")
    expect(headline(page)).to_have_text(error)
    page.mouse.up()
    assert middle(point(page, "A")) == pytest.approx((x, y), abs=1)
    expect(undo(page)).to_be_disabled()
    assert (folder / DEVICE).read_text() == text


def test_a_cord_is_deleted_and_restored_by_keys(open_sensors, folder):
    page = open_sensors()
    select(page, "A")
    page.keyboard.press("Delete")
    expect(cord(page, "A")).to_have_count(0)
    assert [sensor.name for sensor in load_device(folder).sensors] == ["B"]
    page.keyboard.press("Control+z")
    expect(cord(page, "A")).to_be_visible()
    page.keyboard.press("Control+Shift+z")
    expect(cord(page, "A")).to_have_count(0)


def test_a_cord_is_drawn_by_keys(open_sensors, folder):
    page = open_sensors()
    keys = page.keyboard
    scene = page.get_by_role("application")
    middle(page.get_by_role("img", name=SCALE))  # until the body is shown
    keys.press("d")
    expect(scene).to_be_focused()
    expect(scene).to_have_accessible_name(re.compile("arrow keys move the pen"))
    keys.press("z")
    expect(page.get_by_role("radio", name="z", exact=True)).to_be_checked()
    keys.press("Shift+PageUp")
    expect(page.get_by_role("slider", name="Offset of the plane")).to_have_value("5")
    for key, count in (("Shift+ArrowLeft", 14), ("Shift+ArrowDown", 2), ("Space", 1)):
        for _ in range(count):
            keys.press(key)
    page.get_by_text("Point 1 at x 5.0, y -10.0 mm").wait_for(state="attached")
    for _ in range(28):
        keys.press("Shift+ArrowRight")
    keys.press("Space")
    keys.press("Backspace")
    page.get_by_text("Point 2 removed").wait_for(state="attached")
    keys.press("ArrowUp")
    keys.press("Enter")
    assert len(load_device(folder).sensors) == 2
    keys.press("Enter")
    page.get_by_text("C added").wait_for(state="attached")
    added = load_device(folder).sensors[-1]
    assert added.plane.origin[2] == 5
    assert added.curve.points[0] == pytest.approx((2, -10), abs=3)
    assert added.curve.points[-1] == pytest.approx((148, -9.5), abs=3)
    expect(scene).to_be_focused()
    keys.press("Space")
    keys.press("Escape")  # the point
    keys.press("Escape")  # the mode
    expect(page.get_by_role("radio", name="Select")).to_be_checked()


def test_a_cord_is_drawn_by_clicks(open_sensors, folder):
    page = open_sensors()
    page.keyboard.press("Control+a")
    page.get_by_role("radio", name="Select").focus()
    page.keyboard.press("Delete")  # also while a tool has the focus
    page.get_by_role("button", name="Add a cord").click()
    expect(page.get_by_role("radio", name="Draw")).to_be_checked()
    expect(page.locator(".viewer-board")).to_be_visible()  # the view has turned to the plane
    x, y = middle(page.get_by_role("application"))
    page.mouse.click(x - 150, y)
    page.get_by_text(re.compile("Point 1 at")).wait_for(state="attached")
    page.mouse.click(x, y - 10)
    page.get_by_text(re.compile("Point 2 at")).wait_for(state="attached")
    page.mouse.dblclick(x + 150, y)
    page.get_by_text("A added").wait_for(state="attached")
    (added,) = load_device(folder).sensors
    assert added.curve.points[:, 0].min() < added.curve.points[:, 0].mean() - 30


def test_a_broken_limit_is_labeled_at_its_place(open_sensors):
    page = open_sensors()
    panel = page.get_by_role("region", name="Expected error and signals")
    expect(panel.get_by_text("All limits are kept, and the cords can be made")).to_be_visible()
    expect(panel.get_by_text(re.compile("^[0-9.]+ mm in the parts"))).to_be_visible()
    expect(step_button(page, "Sensors")).to_have_accessible_name(re.compile("done"))
    select(page, "A")
    point(page, "A").click()
    field = inspector(page, "Sensors").get_by_role("spinbutton", name="y")
    field.fill("40")
    field.press("Enter")
    scene = page.get_by_role("main", name="Scene")
    label = scene.get_by_role("button", name="Leaves the body").first
    expect(label).to_be_visible()
    expect(step_button(page, "Sensors")).to_have_accessible_name(re.compile("out of date"))
    expect(cord(page, "A")).to_have_accessible_name(re.compile("^A: "))
    page.keyboard.press("Escape")
    label.click()
    expect(cord(page, "A")).to_have_attribute("aria-selected", "true")
    inspector(page, "Sensors").get_by_role("button", name="Repair this cord").click()
    expect(label).to_have_count(0)
    expect(step_button(page, "Sensors")).to_have_accessible_name(re.compile("done"))


def test_a_cord_that_cannot_be_made_is_labeled_at_its_place(open_sensors, studio):
    page = open_sensors()
    panel = page.get_by_role("region", name="Expected error and signals")
    scene = page.get_by_role("main", name="Scene")
    studio.draw(unmakeable_cord(), replaces="B")
    expect(scene.get_by_role("button", name="Groove cuts a part").first).to_be_visible()
    broken = panel.get_by_role("list", name="Broken limits")
    expect(broken.get_by_role("button")).to_have_count(1)
    expect(step_button(page, "Sensors")).to_have_accessible_name(re.compile("out of date"))
    page.get_by_role("button", name="Fix the limits").click()
    expect(panel.get_by_role("button", pressed=True)).to_have_count(1)


def test_a_search_for_another_cord_is_a_job_that_can_be_canceled(open_sensors, folder):
    page = open_sensors(size={"width": 1280, "height": 800})
    enter(page, "Optimize")
    panel, text = inspector(page, "Optimize"), (folder / DEVICE).read_text(encoding="utf-8")
    expect(panel.get_by_text(re.compile("^(Hardly|Not) sensed"))).to_be_visible()
    panel.get_by_role("button", name="Propose another cord").click()
    strip = page.get_by_role("contentinfo", name="Job")
    expect(strip.get_by_role("progressbar", name="Search for another cord")).to_be_visible()
    strip.get_by_role("button", name="Cancel").click()
    messages = page.get_by_role("region", name="Messages")
    expect(messages.get_by_text("Search canceled")).to_be_visible()
    assert (folder / DEVICE).read_text(encoding="utf-8") == text
    inspector(page, "Sensors").get_by_role("button", name="Propose").click()
    expect(messages.get_by_text(re.compile(r"Added .*: [\d.]+ → [\d.]+ mm"))).to_be_visible()


def test_what_lies_outside_a_changed_body_is_marked_and_fitted(open_page, studio, folder):
    page = open_page(studio.url, size={"width": 1280, "height": 800})
    dismiss_introduction(page)
    enter(page, "Body")
    text = (folder / DEVICE).read_text()
    length = page.get_by_role("textbox", name="length, number")
    length.fill("100")
    length.press("Enter")
    message = page.get_by_role("alert").filter(has_text="2 cords and 1 region")
    expect(cord(page, "A")).to_have_accessible_name(re.compile("^A: "))
    expect(page.get_by_role("treeitem", name=re.compile("^tip: "))).to_be_visible()
    expect(step_button(page, "Sensors")).to_have_accessible_name(re.compile("out of date"))
    page.get_by_role("main", name="Scene").get_by_role("button", name=re.compile("^tip: ")).click()
    message.get_by_role("button", name="Fit them to the body").click()
    expect(message).to_have_count(0)
    expect(page.get_by_role("treeitem", name="tip", exact=True)).to_be_visible()
    assert load_device(folder).regions["tip"].high[0] < 105
    undo(page).click()
    expect(message).to_be_visible()
    undo(page).click()
    expect(message).to_have_count(0)
    assert (folder / DEVICE).read_text() == text


def test_browsers_share_the_device_and_nothing_else(open_sensors, folder):
    one, two = open_sensors(), open_sensors()
    enter(two, "Body")
    two.get_by_role("button", name="Show the list of parts").click()
    one.get_by_role("button", name="Menu").click()
    one.get_by_role("menuitemradio", name="Dark").click()
    select(one, "A")
    one.keyboard.press("Delete")
    expect(cord(two, "A")).to_have_count(0)
    expect(cord(one, "A")).to_have_count(0)
    cord(one, "B").click()
    expect(cord(one, "B")).to_have_attribute("aria-selected", "true")
    expect(cord(two, "B")).to_have_attribute("aria-selected", "false")
    expect(step_button(one, "Sensors")).to_have_attribute("aria-current", "step")
    expect(step_button(two, "Body")).to_have_attribute("aria-current", "step")
    expect(one.locator("html")).to_have_attribute("data-theme", "dark")
    expect(two.locator("html")).not_to_have_attribute("data-theme", "dark")
    one.context.close()
    undo(two).click()
    expect(cord(two, "A")).to_be_visible()
    assert len(load_device(folder).sensors) == 2


def test_a_reload_keeps_the_step(open_sensors):
    page = open_sensors()
    page.reload()
    expect(step_button(page, "Sensors")).to_have_attribute("aria-current", "step")
    expect(headline(page)).to_be_visible()


def test_the_page_returns_when_the_studio_does(open_sensors, studio, folder):
    page = open_sensors()
    page.get_by_role("button", name="Show the list of parts").click()
    cord(page, "A").wait_for()
    banner = page.get_by_role("alert").filter(has_text="The studio does not answer")
    studio.close()
    expect(banner).to_be_visible()
    expect(cord(page, "A")).to_be_visible()
    text = (folder / DEVICE).read_text(encoding="utf-8")
    (folder / DEVICE).write_text(text.replace('name = "A"', 'name = "port"'), encoding="utf-8")
    studio.open()
    expect(banner).to_have_count(0)
    expect(cord(page, "port")).to_be_visible()
    expect(cord(page, "A")).to_have_count(0)
    cord(page, "port").click()
    point(page, "port").wait_for()
    page.keyboard.press("Delete")
    assert until(lambda: [sensor.name for sensor in load_device(folder).sensors] == ["B"])


def test_a_name_with_markup_is_shown_as_text(open_sensors, folder):
    page = open_sensors()
    name = "<script>window.wasRun = 1</script>"
    field = page.get_by_role("textbox", name="Device name")
    field.fill(name)
    field.press("Enter")
    assert until(lambda: load_device(folder).name == name)
    expect(page).to_have_title(re.compile(re.escape(name)))
    expect(page.get_by_role("heading", name=name, exact=True)).to_have_count(1)
    page.reload()
    expect(field).to_have_value(name)
    assert page.evaluate("window.wasRun") is None


def test_errors_use_the_labels_of_the_page_and_offer_what_cures_them(open_sensors, studio, folder):
    page = open_sensors()
    alert = page.get_by_role("region", name="Messages").get_by_role("alert")
    studio.show_error(
        LayoutError(
            "no layout of 9 cords keeps the lengths allowed by [cord] length and min_stretch",
            code="no-room-for-cords",
            where="[design] sensors = 9",
            action="Ask for 3, or draw them as [[sensors]]",
            key="design.sensors",
            suggested=3,
        )
    )
    expect(alert).to_contain_text("“Number of cords” = 9: no layout of 9 cords keeps the lengths")
    expect(alert).to_contain_text("“Length of a cord” and “Smallest stretched length”")
    expect(alert).to_contain_text("Ask for 3, or draw them in Sensors")
    alert.get_by_role("button", name="Set “Number of cords” to 3").click()
    assert until(lambda: load_device(folder).propose == 1)
    expect(alert).to_have_count(0)  # the change ended the error
    studio.show_error(MeshingError("is too slow", code="slow", action="Raise [mesh] time_limit"))
    alert.get_by_role("button", name="Show “Time limit of the mesh”").click()
    expect(step_button(page, "Body")).to_have_attribute("aria-current", "step")
    expect(page.get_by_label("Time limit of the mesh", exact=True)).to_be_focused()


def test_a_phone_has_the_scene_above_a_sheet_with_the_guide(open_page, studio):
    page = open_page(studio.url, size=PHONE, has_touch=True)
    dismiss_introduction(page)
    enter(page, "Make")
    scene = page.get_by_role("application").bounding_box()
    title = page.get_by_role("heading", name="Make").bounding_box()
    assert scene["x"] == 0
    assert scene["width"] == PHONE["width"]
    assert scene["y"] < title["y"] < PHONE["height"]
    strip = page.get_by_role("list", name="Steps of the assembly")
    strip.get_by_role("button", name="Print the parts").click()
    card = page.get_by_role("region", name=re.compile("^Step 1 of"))
    expect(card.get_by_role("heading", name="Print the parts")).to_be_in_viewport()
    card.get_by_role("checkbox", name="This step is done").check(force=True)
    expect(strip.get_by_role("checkbox", name="Step 1 is done")).to_be_checked()
    page.get_by_role("button", name="Make the panel larger").click()
    heading = page.get_by_role("heading", name="Make")
    assert until(lambda: heading.bounding_box()["y"] < title["y"])
    x, y = middle(heading)
    for to in (y + 120, PHONE["height"] - 10):  # swiped down to half, and to its header
        page.mouse.move(*middle(heading))
        page.mouse.down()
        page.mouse.move(x, to, steps=4)
        page.mouse.up()
        middle(heading)
    assert heading.bounding_box()["y"] > title["y"] + 100
    expect(page.get_by_role("button", name="Close the panel")).to_be_disabled()
