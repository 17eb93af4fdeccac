"""The 3D view of a page that is opened from its file, in Chromium, with WebGL and without."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.report.viewer.scene import view3d
from tests.report.twisted_bar import BACK, FRONT, MISS, displaced, twisted_bar

WAIT = 240_000.0  # ms that a loaded machine may take
SIZE = {"width": 700, "height": 900}  # small: it is drawn by the processor
VIEW = "document.querySelector('[data-view3d]').view"
PICTURE = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA="


class Page:
    """A page with the view and a picture; records its errors and requests."""

    def __init__(self, browser, path, **settings):
        self.context = browser.new_context(viewport=SIZE, offline=True, **settings)
        self.page = self.context.new_page()
        self.page.set_default_timeout(WAIT)
        self.errors, self.requests = [], []
        self.page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", self._record)
        self.page.goto(path.as_uri())
        self.path = path

    def _record(self, request):
        if not request.url.startswith("blob:null/"):  # three.js, from the page itself
            self.requests.append(request.url)

    def wait_until_ready(self):
        self.page.locator("[data-ready]").wait_for()
        return self

    def js(self, code):
        """Return the value of an expression in which `view` is the page's view."""
        self.page.wait_for_function(f"!{VIEW}.rig.isChanging")
        return self.page.evaluate(f"(() => {{ const view = {VIEW}; return {code}; }})()")

    def slide(self, name, value):
        self.page.locator(f"[data-{name}]").evaluate(
            "(it, value) => { it.value = value; it.dispatchEvent(new Event('input')); }", value
        )

    def part_shifts(self):
        """Return the displacements of the parts, mm."""
        return np.array(self.js("view.parts.map(p => p.object.position.toArray())"))

    def surface(self, name="points"):
        """Return the vertices (n, 3) of the body at rest, in the pose, or as predicted, mm."""
        return np.array(self.js(f"Array.from(view.surface.{name})")).reshape(-1, 3)

    def picture(self):
        """Return the picture of the view after the changes so far are drawn."""
        self.page.wait_for_timeout(300)
        return self.page.locator("canvas").screenshot()

    def text(self, name):
        return self.page.locator(f"[data-{name}]").inner_text()

    def is_quiet(self):
        return not self.errors and self.requests == [self.path.as_uri()]


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    return twisted_bar(tmp_path_factory.mktemp("build"))


@pytest.fixture(scope="module")
def file(bar):
    path = bar.folder / "report.html"
    view = view3d(bar.scene())
    path.write_text(
        "<!doctype html><html lang=en><meta charset=utf-8><title>bar</title>"
        f"<body>{view}<img src='{PICTURE}' alt='picture'></body></html>",
        encoding="utf-8",
    )
    return path


@pytest.fixture(scope="module")
def open_page(browser, file):
    """The page with its view, opened once."""
    page = Page(browser, file, reduced_motion="reduce").wait_until_ready()
    yield page
    page.context.close()


@pytest.fixture
def page(open_page):
    open_page.page.get_by_role("button", name="Reset").click()
    open_page.page.locator("canvas").press("Escape")
    yield open_page
    assert open_page.is_quiet()


def test_the_slider_opens_the_joint_that_is_closed_last_first(page):
    size = page.js("view.content.size")
    assert (page.part_shifts() == 0).all()
    page.slide("open", 0.5)
    second = 0.1 * size * np.array([[0, 0, -1], [0, 0, -1], [0, 0, 1]])
    assert page.part_shifts() == pytest.approx(second, abs=0.01)
    assert "Joint 2 of 2" in page.text("joint")
    page.slide("open", 1)
    first = 0.1 * size * np.array([[0, -1, 0], [0, 1, 0], [0, 0, 0]])
    assert page.part_shifts() == pytest.approx(first + second, abs=0.01)
    assert f"{FRONT} and {BACK}" in page.text("joint")
    assert page.page.locator("b").count() == 0  # names are text, not elements
    page.page.get_by_role("button", name="Reset").click()
    assert (page.part_shifts() == 0).all()


def test_interpolated_shapes_are_close_to_the_true_ones(page):
    page.page.locator("[data-pose]").select_option("twist")
    rest = page.surface("rest")
    at = rest + np.array([60.0, 0, 0])  # the page's origin is the middle of the body
    for amount in (1.0, 0.75, 0.5, 0.25):
        page.slide("amount", amount)
        off = page.surface() - rest - displaced(at, {"twist": amount})
        linear = displaced(at, {"twist": 1.0}) * amount - displaced(at, {"twist": amount})
        assert np.abs(off).max() < 0.15 * max(np.abs(linear).max(), 0.2)
    assert "Simulated at 50\u00a0%, 100\u00a0%" in page.text("state")


def test_a_pose_plays_and_stops(page):
    page.page.locator("[data-pose]").select_option("twist")
    page.slide("amount", 0)
    page.page.get_by_role("button", name="Play").click()
    page.page.wait_for_function(f"{VIEW}.state.amount > 0.2")
    page.page.get_by_role("button", name="Pause").click()
    assert np.abs(page.surface() - page.surface("rest")).max() > 1
    stopped = page.js("view.state.amount")
    page.page.wait_for_timeout(300)
    assert page.js("view.state.amount") == stopped


def test_the_predicted_shape_is_over_or_next_to_the_simulated_one(page):
    page.page.locator("[data-pose]").select_option("twist")
    page.page.locator("[data-predicted]").select_option("over")
    off = page.surface("predictedPoints") - page.surface()
    assert off == pytest.approx(np.tile([0, MISS, 0], (len(off), 1)), abs=0.01)
    assert "0.80 mm" in page.text("state")
    page.page.locator("[data-predicted]").select_option("next")
    assert page.js("view.surface.offset.z") < -24  # below a wide body


def test_colors_show_the_error_or_the_strain_with_a_scale(page):
    page.page.locator("[data-pose]").select_option("twist")
    assert "Error without noise, mm" in page.text("quantity")
    error = page.picture()
    page.page.locator("[data-colors]").select_option("strain")
    assert "Largest principal strain, %" in page.text("quantity")
    assert page.picture() != error
    page.page.locator("[data-colors]").select_option("none")
    assert not page.page.locator("[data-scale]").is_visible()


def test_a_click_selects_what_is_visible_there(page):
    page.page.get_by_role("button", name="Top", exact=True).click()
    box = page.page.locator("canvas").bounding_box()

    def click(x, y):
        page.page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        return page.text("selected")

    assert click(0.5, 0.5).startswith("tag 3 (marker seat)")  # above a cord
    assert click(0.3, 0.5).startswith("upright (cord)")  # shines through the part
    details = click(0.3, 0.55)
    assert details.startswith("top (part)")
    assert "120.0 × 24.0 × 12.0 mm" in details
    assert click(0.02, 0.05) == ""


def test_a_button_selects_a_cord_and_its_resistance_follows_the_pose(page):
    button = page.page.get_by_role("button", name="level")
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    details = page.text("selected")
    assert "1.0 to 10.0 %" in details
    assert "1600 Ω" in details
    page.page.locator("[data-pose]").select_option("twist")
    assert "1760 Ω" in page.text("selected")  # 10 % more in the full twist


def test_keys_turn_zoom_open_and_play(page):
    canvas = page.page.locator("canvas")
    position = "view.rig.camera.position.toArray()"
    distance = "view.rig.camera.position.distanceTo(view.rig.controls.target)"
    before, far = page.js(position), page.js(distance)
    canvas.press("ArrowLeft")
    turned = page.js(position)
    assert turned[2] == pytest.approx(before[2])
    assert turned[:2] != pytest.approx(before[:2], rel=0.01)
    assert page.js(distance) == pytest.approx(far)
    canvas.press("+")
    assert page.js(distance) == pytest.approx(far / 1.15)
    for _ in range(30):
        canvas.press("ArrowUp")
    canvas.press("2")
    side = page.js(position)
    assert side[0] > 5 * max(abs(side[1]), abs(side[2]), 1)
    canvas.press("o")
    assert page.js("view.state.open") == 1
    canvas.press("p")
    assert page.js("view.state.open") == 0
    page.page.get_by_role("button", name="Pause").wait_for()
    canvas.press("p")
    page.page.get_by_role("button", name="Play").wait_for()


def test_the_device_keeps_its_share_of_the_picture_while_joints_open(page):
    corners = "view.rig.corners.map(c => c.clone().project(view.rig.camera))"
    reach = f"Math.max(...{corners}.map(c => Math.max(Math.abs(c.x), Math.abs(c.y))))"
    before = page.js(reach)
    page.slide("open", 1)
    page.page.wait_for_function(f"!{VIEW}.frame")  # is drawn
    assert page.js(reach) == pytest.approx(before, abs=0.02)


def test_kinds_are_shown_and_hidden(page):
    kinds = "view.followers.filter(t => t.object.visible).map(t => t.kind)"
    assert set(page.js(kinds)) == {"cord", "wire", "pin", "seat"}
    page.page.get_by_role("checkbox", name="cords").uncheck()
    page.page.get_by_label("marker seats").uncheck()
    assert set(page.js(kinds)) == {"wire", "pin"}
    page.page.get_by_role("checkbox", name="cords").check()
    page.page.get_by_label("marker seats").check()


def test_drawing_takes_few_calls_and_pauses_without_changes(page):
    page.page.wait_for_timeout(300)
    frames = page.js("view.frames")
    page.page.wait_for_timeout(300)
    assert page.js("view.frames") == frames
    assert page.js("view.renderer.info.render.calls") <= 16


def test_paper_shows_the_picture_and_no_empty_canvas(page):
    page.page.emulate_media(media="print")
    assert not page.page.locator("canvas").is_visible()
    assert page.page.get_by_alt_text("picture").is_visible()
    page.page.emulate_media(media="screen")


def test_without_webgl_a_sentence_replaces_the_view(launch_browser, file):
    plain = launch_browser("--disable-gpu", "--disable-3d-apis")
    page = Page(plain, file)
    page.page.locator("[data-view3d-note]").get_by_text("WebGL").wait_for()
    assert not page.page.locator("[data-view3d]").is_visible()
    assert page.page.get_by_alt_text("picture").is_visible()
    assert page.is_quiet()
    plain.close()


def test_without_scripts_a_sentence_replaces_the_view(browser, file):
    page = Page(browser, file, java_script_enabled=False)
    assert page.page.locator("[data-view3d-note]").is_visible()
    assert not page.page.locator("[data-view3d]").is_visible()
    page.context.close()


def test_without_modules_a_sentence_replaces_the_view(browser, file, tmp_path):
    text = file.read_text(encoding="utf-8")
    path = tmp_path / "report.html"
    path.write_text(text.replace('type="module"', 'type="text/unknown"'), encoding="utf-8")
    page = Page(browser, path)
    assert "JavaScript with modules" in page.page.locator("[data-view3d-note]").inner_text()
    assert not page.page.locator("[data-view3d]").is_visible()
    assert page.page.get_by_alt_text("picture").is_visible()
    page.context.close()
