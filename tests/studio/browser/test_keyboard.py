"""The studio by keyboard: the order of the focus, and where it goes when its element disappears."""

from __future__ import annotations

import re
import shutil

import pytest

from defsense_fab.core.device.device_file import load_device
from tests.studio.browser.conftest import until
from tests.studio.browser.screens import (
    STEPS,
    dismiss_introduction,
    enter,
    inspector,
    step_button,
)

pytest.importorskip("playwright")
from playwright.sync_api import expect

pytestmark = pytest.mark.slow

DESKTOP = {"width": 1280, "height": 800}
#: The regions in their visual order.
REGIONS = ("skip link", "bar", "tree", "scene", "inspector", "bottom", "job")
#: The focused element: its region, name, and whether it is visible with its mark; null for none.
FOCUSED = """() => {
    const element = document.activeElement;
    if (element === document.body) return null;
    const selectors = [".skip-link", ".top-bar", "aside:has([role=tree])", "main", "aside",
                       "section.bottom-panel", "footer"];
    const shown = element.closest("label:has(.visually-hidden)") ?? element;
    const { left, top, right, bottom } = shown.getBoundingClientRect();
    const hasOutline = (node) => node && getComputedStyle(node).outlineStyle !== "none";
    return {
        region: selectors.findIndex((selector) => element.closest(selector)),
        name: element.ariaLabel || element.textContent || element.id,
        tabIndex: element.tabIndex,
        isInside: left >= -1 && top >= -1 && right <= innerWidth + 1 && bottom <= innerHeight + 1,
        isMarked: hasOutline(shown) || hasOutline(element.closest(".input-frame")) ||
            element instanceof SVGElement || element.matches("canvas"),
    };
}"""
MAX_TABS = 150
#: After which the page has moved a focus whose element disappeared, as when a result arrives.
RESTORED_MS = 200


@pytest.fixture
def folder(made_bar, tmp_path):
    return shutil.copytree(made_bar, tmp_path / "bar")


@pytest.fixture
def page(serve, open_page, folder):
    page = open_page(serve(folder).url, DESKTOP)
    dismiss_introduction(page)
    return page


def focused_elements(page):
    """Press Tab from the skip link to the end of the page; return what each element is."""
    page.get_by_role("button", name="Skip to the scene").focus()
    found = []
    for _ in range(MAX_TABS):
        page.keyboard.press("Tab")
        element = page.evaluate(FOCUSED)
        if element is None:
            page.wait_for_timeout(RESTORED_MS)
            element = page.evaluate(FOCUSED)
        if element is None:
            return found
        found.append(element)
    raise AssertionError(f"more than {MAX_TABS} elements")


@pytest.mark.timeout(600)
def test_the_keyboard_follows_the_visual_order_in_each_step(page):
    faults = []
    for step in STEPS:
        enter(page, step)
        elements = focused_elements(page)
        regions = [element["region"] for element in elements]
        assert regions == sorted(regions), step
        shown = [REGIONS[k] for k in sorted(set(regions))]
        assert shown[:4] == list(REGIONS[1:5]), (step, elements[-3:])
        faults += [
            (step, element)
            for element in elements
            if element["tabIndex"] > 0 or not element["isInside"] or not element["isMarked"]
        ]
    assert not faults


def test_the_skip_link_and_f6_lead_to_the_regions(page):
    enter(page, "Sensors")
    skip = page.get_by_role("button", name="Skip to the scene")
    page.get_by_role("button", name="Hide the list of parts").press("Shift+Tab")
    expect(skip).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.get_by_role("application")).to_be_focused()
    page.keyboard.press("F6")
    expect(inspector(page, "Sensors").get_by_role("button", name="Draw")).to_be_focused()
    page.keyboard.press("Shift+F6")
    page.keyboard.press("Shift+F6")
    expect(page.get_by_role("treeitem", name="Body")).to_be_focused()


def test_the_focus_is_not_lost(page):
    enter(page, "Make")
    page.keyboard.press("4")
    expect(page.get_by_role("heading", name="Sensors", exact=True)).to_be_focused()
    menu = page.get_by_role("button", name="Menu")
    menu.press("Enter")
    page.get_by_role("menuitem", name="Keyboard shortcuts").click()
    page.get_by_role("dialog", name="Keyboard shortcuts").wait_for()
    page.keyboard.press("Escape")
    expect(menu).to_be_focused()

    rows = {name: page.get_by_role("treeitem", name=name, exact=True) for name in ("A", "B")}
    rows["A"].focus()
    page.keyboard.press("Enter")
    delete = inspector(page, "Sensors").get_by_role("button", name="Delete", exact=True)
    delete.press("Enter")
    expect(rows["A"]).to_have_count(0)
    expect(page.get_by_role("heading", name="Sensors", exact=True)).to_be_focused()
    page.keyboard.press("Control+z")
    rows["A"].focus()
    page.keyboard.press("Enter")
    page.keyboard.press("Delete")
    expect(rows["B"]).to_be_focused()

    step_button(page, "Poses").click()
    states = page.get_by_role("group", name="States")
    card = states.get_by_role("button", name="bend_up", exact=True)
    card.press("Enter")
    page.keyboard.press("Delete")
    expect(card).to_have_count(0)
    expect(states.locator(":focus")).to_have_count(1)


@pytest.mark.parametrize(
    "loss",
    [
        "element.hidden = true",
        "element.style.visibility = 'hidden'",
        "element.disabled = true",
        "element.inert = true",
        "element.remove()",
    ],
)
def test_a_lost_focus_stays_in_its_region(page, loss):
    enter(page, "Inside")
    page.get_by_role("button", name="Move the plane along its normal").wait_for()
    scene, panel = page.get_by_role("main"), inspector(page, "Inside")
    for region, role, name in (
        (scene, "button", "Turn the plane over"),
        (scene, "button", "Move the plane along its normal"),
        (panel, "radio", "Surface to surface"),
    ):
        element = region.get_by_role(role, name=name)
        element.focus()
        element.evaluate(f"element => {{ {loss} }}")
        page.wait_for_timeout(RESTORED_MS)
        focused = region.locator(":focus")
        expect(focused).to_have_count(1)
        expect(focused).not_to_have_accessible_name(name)


def test_a_lost_focus_stays_in_its_dialog(page):
    menu = page.get_by_role("button", name="Menu")
    menu.press("Enter")
    page.get_by_role("menuitem", name="Keyboard shortcuts").click()
    dialog = page.get_by_role("dialog", name="Keyboard shortcuts")
    close = dialog.get_by_role("button").first
    close.focus()
    close.evaluate("element => element.remove()")
    page.wait_for_timeout(RESTORED_MS)
    expect(dialog.locator(":focus")).to_have_count(1)
    page.keyboard.press("Escape")
    expect(menu).to_be_focused()


def test_refused_names_stay_and_escape_restores_them(page, folder):
    enter(page, "Sensors")
    page.get_by_role("treeitem", name="A", exact=True).press("Enter")
    field = inspector(page, "Sensors").get_by_role("textbox", name="Name")
    field.fill("B")
    field.press("Enter")
    expect(field).to_have_accessible_description(re.compile("used already"))
    expect(field).to_have_value("B")
    page.keyboard.press("Escape")
    expect(field).to_have_value("A")
    expect(field).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.get_by_role("application")).to_be_focused()
    field.fill("A, \u00e9tage 2")
    field.press("Enter")
    assert until(lambda: load_device(folder).sensors[0].name == "A, \u00e9tage 2")

    page.get_by_role("treeitem", name="twist", exact=True).press("F2")
    page.keyboard.type("bend_up")
    page.keyboard.press("Enter")
    name = page.get_by_role("textbox", name="New name of twist")
    expect(name).to_have_accessible_description(re.compile("used already"))
    expect(name).to_have_value("bend_up")
    name.fill("turn left")
    expect(name).to_have_value("turn_left")
    expect(name).to_have_accessible_description(re.compile("Spaces become _"))
    page.keyboard.press("Enter")
    row = page.get_by_role("treeitem", name="turn_left", exact=True)
    expect(row).to_be_focused()

    enter(page, "Poses")
    page.get_by_role("group", name="States").get_by_role("button", name="turn_left").dblclick()
    page.keyboard.type("twist")
    page.keyboard.press("Enter")
    assert until(lambda: [pose.name for pose in load_device(folder).poses] == ["bend_up", "twist"])

    page.get_by_role("treeitem", name="twist", exact=True).press("Enter")
    inspector(page, "Poses").get_by_role("button", name="Actions for twist").click()
    page.get_by_role("menuitem", name="Rename").click()
    expect(page.get_by_role("textbox", name="New name of twist")).to_be_focused()


def test_undo_beyond_the_first_change_leaves_typed_texts(page, folder):
    """The browser's own undo would change the field that was typed last, and focus it."""
    enter(page, "Body")
    before = load_device(folder)
    field = page.get_by_role("textbox", name="Device name")
    field.focus()
    page.keyboard.press("Control+a")
    page.keyboard.type("other")
    page.keyboard.press("Enter")
    assert until(lambda: load_device(folder).name == "other")
    scene = page.get_by_role("application")
    scene.focus()
    page.keyboard.press("Control+z")
    expect(field).to_have_value(before.name)
    for key in ("Control+z", "Control+z", "Control+Shift+z", "Control+Shift+z"):
        page.keyboard.press(key)
        expect(scene).to_be_focused()
    assert until(lambda: load_device(folder).name == "other")
    expect(field).to_have_value("other")


def test_errors_of_the_file_are_named_and_end_with_its_correction(page, folder):
    enter(page, "Body")
    path = folder / "device.toml"
    valid = path.read_text()
    path.write_text(re.sub("edge_length = .*", "edge_length = -5", valid))
    banner = page.get_by_role("alert").filter(has_text="edge_length").first
    banner.wait_for()
    searches = page.get_by_label("Largest number of searches", exact=True)
    shown = searches.input_value()
    searches.fill("7")
    searches.press("Enter")
    expect(searches).to_have_accessible_description(re.compile("[Ee]dge.length.* -5"))
    path.write_text(valid)
    expect(banner).to_have_count(0)
    expect(page.locator("[aria-invalid]")).to_have_count(0)
    expect(searches).to_have_value(shown)
    searches.fill("7")
    searches.press("Enter")
    assert until(lambda: load_device(folder).searches == 7)


def test_arrow_keys_move_a_point_as_the_screen_shows_it(page):
    enter(page, "Sensors")
    page.get_by_role("treeitem", name="A", exact=True).press("Enter")
    point = page.get_by_role("button", name="A, point 4 of 8")
    for view in ("Top", "Back"):
        page.get_by_role("button", name="Standard views").click()
        page.get_by_role("menuitem", name=view).click()
        x = place_at_rest(point)["x"]
        point.press("Shift+ArrowRight")
        assert until(lambda x=x: point.bounding_box()["x"] > x + 5)
        place_at_rest(point)


def test_the_palette_has_the_actions_of_all_steps_with_reasons(page):
    enter(page, "Body")
    page.keyboard.press("Control+k")
    search = page.get_by_role("combobox", name="Search commands")
    for name, reason in (
        ("Export as zip", None),
        ("Draw a cord", None),
        ("Compare all layouts", None),
        ("Open the print list", None),
        ("Mirror across x", "Select a cord first"),
        ("Train a model", "Record a session first"),
        ("Cancel the job", "No job is running"),
    ):
        search.fill(name)
        entry = page.get_by_role("option", name=name).first
        expect(entry).to_contain_text(reason or name)
        assert (entry.get_attribute("aria-disabled") == "true") == (reason is not None), name
    page.keyboard.press("Enter")  # of an entry that is not possible
    expect(search).to_be_focused()
    search.fill("Open the print list")
    page.keyboard.press("Enter")
    expect(step_button(page, "Make")).to_have_attribute("aria-current", "step")
    summary = inspector(page, "Make").locator("summary").filter(has_text="Print list")
    expect(summary).to_be_focused()

    page.keyboard.press("?")
    help_text = page.get_by_role("dialog", name="Keyboard shortcuts")
    rows = [row.inner_text() for row in help_text.get_by_role("row").all()]
    assert len(rows) == len(set(rows))
    last = help_text.get_by_role("row").last
    expect(last).not_to_be_in_viewport()
    page.keyboard.press("End")
    expect(last).to_be_in_viewport()


#: Returns the names of the buttons under a box; all at once, since buttons come and go.
COVERED_BUTTONS = """box => [...document.querySelectorAll("button, [role=button]")]
  .filter((button) => button.checkVisibility() && !button.closest("[popover]"))
  .filter((button) => {
    const { left, right, top, bottom } = button.getBoundingClientRect();
    const [x, y] = [box.x + box.width, box.y + box.height];
    return left < x && right > box.x && top < y && bottom > box.y;
  })
  .map((button) => button.ariaLabel || button.textContent)"""


def test_messages_cover_no_button_and_are_dismissed_by_a_key(page):
    enter(page, "Sensors")
    page.get_by_role("treeitem", name="A", exact=True).press("Enter")
    page.keyboard.press("Delete")
    messages = page.get_by_role("region", name="Messages")
    messages.get_by_text("Deleted A").wait_for()
    page.wait_for_timeout(1000)  # until the page has settled
    box = place_at_rest(messages)
    assert page.evaluate(COVERED_BUTTONS, box) == []
    page.keyboard.press("Escape")
    expect(messages).to_be_hidden()


def place_at_rest(locator):
    """Return the box of an element once it no longer moves, px."""
    box, last = locator.bounding_box(), None
    while box != last:
        locator.page.wait_for_timeout(500)
        last, box = box, locator.bounding_box()
    return box
