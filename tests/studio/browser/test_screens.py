"""All screens of the studio: accessible, within the window, and without errors."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any

import pytest

from tests.studio.browser.conftest import PHONE, until
from tests.studio.browser.screens import (
    STEPS,
    dismiss_introduction,
    enter,
    open_live_view,
    upload,
    write_stl,
)

axe = pytest.importorskip("axe_playwright_python.sync_playwright")
pytestmark = pytest.mark.slow

DESKTOP = {"width": 1280, "height": 800}
SIZES = (PHONE, DESKTOP, {"width": 1920, "height": 1080})
SEVERE = ("serious", "critical")
FONTS_ARE_LOADED = "document.fonts.ready.then(() => undefined)"
FITS = "document.documentElement.scrollWidth <= window.innerWidth"
BENT = 0.5  # of any control: the model of this test was not trained on the simulated twin
FIT_TIMEOUT_S = 10.0  # in which the page follows a new size of the window


class Screens:
    """Examines the screens of one browser.

    Attributes:
        faults: What is wrong with the screens.
    """

    def __init__(self, page):
        self.page, self.faults = page, []
        page.on("console", lambda m: self.faults.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: self.faults.append(str(error)))

    def examine(self, name):
        """Examine the screen that is shown: in all sizes, light and dark."""
        page = self.page
        for size in SIZES:
            page.set_viewport_size(size)
            page.evaluate(FONTS_ARE_LOADED)
            if not until(lambda: page.evaluate(FITS), FIT_TIMEOUT_S):
                self.faults.append(f"{name}: wider than a window of {size['width']} px")
            for scheme in ("light", "dark") if size == DESKTOP else ("light",):
                page.emulate_media(color_scheme=scheme)
                if size != SIZES[-1]:
                    self.faults += self._violations(f"{name}, {size['width']} px, {scheme}")
        page.emulate_media(color_scheme="light")
        page.set_viewport_size(DESKTOP)

    def _violations(self, where):
        options = {"resultTypes": ["violations"]}
        found: list[dict[str, Any]] = (
            axe.Axe().run(self.page, options=options).response["violations"]
        )
        return [
            f"{where}: {violation['id']} at {node['target']}: {node['failureSummary']}"
            for violation in found
            if violation["impact"] in SEVERE
            for node in violation["nodes"]
        ]


@pytest.fixture
def screens(open_page):
    """Return a function that opens an address; all of its faults are reported at the end."""
    opened: list[Screens] = []

    def open_screens(url: str) -> Screens:
        page = open_page("about:blank", DESKTOP)
        opened.append(Screens(page))
        page.goto(url)
        return opened[-1]

    yield open_screens
    faults = [fault for screen in opened for fault in screen.faults]
    assert not faults, "\n".join(faults)


@pytest.fixture
def built_bar(made_bar, tmp_path):
    return shutil.copytree(made_bar, tmp_path / "bar")


def in_dialog(page, opened_by: Callable[[], Any], name: str) -> None:
    opened_by()
    page.get_by_role("dialog", name=name).wait_for()


def test_start_page_and_form_of_a_body(screens, serve, tmp_path):
    start = screens(serve(tmp_path / "new").url)
    start.page.get_by_role("button", name="Twist bar").wait_for()
    start.examine("start")
    upload(start.page, write_stl(tmp_path / "grip.stl"))
    start.examine("form of a body")


def test_steps_of_a_built_device(screens, serve, built_bar):
    device = screens(serve(built_bar).url)
    page = device.page
    page.get_by_role("dialog", name="Introduction").wait_for()
    device.examine("introduction")
    dismiss_introduction(page)
    for step in STEPS:
        enter(page, step)
        device.examine(step)


def test_dialogs_of_a_device(screens, serve, built_bar):
    device = screens(serve(built_bar).url)
    page = device.page
    dismiss_introduction(page)
    enter(page, "Body")
    dialogs = {
        "Choose the material": page.get_by_role("button", name="Material ninjaflex").click,
        "Commands": lambda: page.keyboard.press("Control+k"),
        "Keyboard shortcuts": lambda: page.keyboard.press("?"),
    }
    for name, opened_by in dialogs.items():
        in_dialog(page, opened_by, name)
        device.examine(name)
        page.keyboard.press("Escape")
        page.get_by_role("dialog").wait_for(state="hidden")
    page.get_by_role("treeitem", name="A", exact=True).click(button="right")
    page.get_by_role("menu").wait_for()
    device.examine("menu of a cord")


def test_question_whether_a_script_may_run(screens, serve, built_bar):
    device = screens(serve(built_bar, trusted=False).url)
    page = device.page
    dismiss_introduction(page)
    enter(page, "Body")
    again = page.get_by_role("button", name="Make the body again")
    in_dialog(page, again.click, "Run the script of this device?")
    device.examine("question")
    page.get_by_role("button", name="Do not run it").click()
    page.get_by_text("was not run").wait_for()


def test_live_view_of_the_simulated_twin(screens, serve, live_bar, tmp_path):
    folder = shutil.copytree(live_bar.folder, tmp_path / "bar")
    device = screens(serve(folder).url)
    dismiss_introduction(device.page)
    open_live_view(device.page)
    device.examine("live view")
    automatic = device.page.get_by_role("checkbox", name="Let it move automatically")
    device.page.get_by_role("slider", name="Bend by bend_up").press("End")
    assert until(lambda: not automatic.is_checked())
    controls = device.page.get_by_role("meter")
    assert until(
        lambda: any(float(c.get_attribute("aria-valuenow")) > BENT for c in controls.all())
    )
    device.page.get_by_role("region", name="Live view").get_by_role("button", name="Stop").click()
    device.page.get_by_role("dialog", name="Live").wait_for(state="hidden")
