"""The 3D view of a page that is opened from its file, in Chromium, with WebGL and without."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.report.viewer.scene import view3d
from tests.report.twisted_bar import BACK, FRONT, MISS, displaced, twisted_bar

WAIT = 240_000.0  # ms that a loaded machine may take
SIZE = {"width": 700, "height": 900}  # small: it is drawn by the processor
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
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())
        self.path = path

    def wait_until_ready(self):
        self.page.locator("[data-ready]").wait_for()
        return self

    def js(self, code):
        return self.page.evaluate(code)

    def slide(self, name, value):
        self.page.locator(f"[data-{name}]").evaluate(
            "(it, value) => { it.value = value; it.dispatchEvent(new Event('input')); }", value
        )

    def part_shifts(self):
        """Return the displacements of the parts, mm."""
        return np.array(self.js("defsenseView.stage.parts.map(p => p.mesh.position.toArray())"))

    def surface(self, mesh="mesh"):
        """Return the vertices (n, 3) of the visible body, mm."""
        array = f"defsenseView.stage.body.{mesh}.geometry.getAttribute('position').array"
        return np.array(self.js(f"Array.from({array})")).reshape(-1, 3)

    def rest(self):
        return np.array(self.js("Array.from(defsenseView.stage.body.rest)")).reshape(-1, 3)

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
    open_page.js("defsenseView.panel.pick(null)")
    yield open_page
    assert open_page.is_quiet()


def test_the_slider_opens_the_joint_that_is_closed_last_first(page):
    size = page.js("defsenseView.stage.content.size")
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
    rest = page.rest()
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
    page.page.wait_for_function("defsenseView.stage.state.amount > 0.2")
    page.page.get_by_role("button", name="Pause").click()
    assert np.abs(page.surface() - page.rest()).max() > 1
    stopped = page.js("defsenseView.stage.state.amount")
    page.page.wait_for_timeout(300)
    assert page.js("defsenseView.stage.state.amount") == stopped


def test_the_predicted_shape_is_over_or_next_to_the_simulated_one(page):
    page.page.locator("[data-pose]").select_option("twist")
    page.page.locator("[data-read]").select_option("over")
    off = page.surface("read") - page.surface()
    assert off == pytest.approx(np.tile([0, MISS, 0], (len(off), 1)), abs=0.01)
    assert "0.80 mm" in page.text("state")
    page.page.locator("[data-read]").select_option("next")
    place = page.js("defsenseView.stage.body.read.position.toArray()")
    assert place[2] < -24  # below a wide body
    reds = "Array.from(defsenseView.stage.body.mesh.geometry.getAttribute('color').array)"
    error = page.js(reds)
    page.page.locator("[data-colors]").select_option("strain")
    assert page.js(reds) != error


def test_a_click_selects_a_part_and_a_button_selects_a_cord(page):
    page.page.get_by_role("button", name="Top", exact=True).click()
    box = page.page.locator("canvas").bounding_box()
    middle = box["y"] + 0.5 * box["height"]
    page.page.mouse.click(box["x"] + 0.5 * box["width"], middle)
    assert page.text("picked").startswith("tag 3 (marker seat)")
    page.page.mouse.click(box["x"] + 0.3 * box["width"], middle)
    assert page.text("picked").startswith("top (part)")
    assert "120.0 × 24.0 × 12.0 mm" in page.text("picked")
    page.page.get_by_role("button", name="level").click()
    details = page.text("picked")
    assert "1.0 to 10.0 %" in details
    assert "1600 Ω" in details
    page.page.locator("[data-pose]").select_option("twist")
    assert "1760 Ω" in page.text("picked")  # 10 % more in the full twist


def test_keys_turn_open_and_play(page):
    canvas = page.page.locator("canvas")
    canvas.focus()
    where = "defsenseView.stage.eye.camera.position.toArray()"
    before = page.js(where)
    page.page.keyboard.press("ArrowLeft")
    turned = page.js(where)
    assert turned[2] == pytest.approx(before[2])
    assert turned[:2] != pytest.approx(before[:2], rel=0.01)
    page.page.keyboard.press("2")
    front = page.js(where)
    assert front[0] > 5 * max(abs(front[1]), abs(front[2]), 1)
    page.page.keyboard.press("o")
    assert page.js("defsenseView.stage.state.open") == 1
    page.page.keyboard.press("p")
    assert page.js("[defsenseView.stage.state.open, defsenseView.panel.playing]") == [0, True]
    page.page.keyboard.press("p")


def test_kinds_are_shown_and_hidden(page):
    kinds = "defsenseView.stage.followers.filter(t => t.mesh.visible).map(t => t.kind)"
    assert set(page.js(kinds)) == {"cord", "wire", "pin", "seat"}
    page.page.get_by_role("checkbox", name="cords").uncheck()
    page.page.get_by_label("marker seats").uncheck()
    assert set(page.js(kinds)) == {"wire", "pin"}
    page.page.get_by_role("checkbox", name="cords").check()
    page.page.get_by_label("marker seats").check()


def test_drawing_takes_few_calls_and_pauses_without_changes(page):
    page.page.wait_for_timeout(300)
    frames = page.js("defsenseView.frames")
    page.page.wait_for_timeout(300)
    assert page.js("defsenseView.frames") == frames
    assert page.js("defsenseView.stage.renderer.info.render.calls") <= 10


def test_paper_shows_the_picture_and_no_empty_canvas(page):
    page.page.emulate_media(media="print")
    assert not page.page.locator("canvas").is_visible()
    assert page.page.get_by_alt_text("picture").is_visible()
    page.page.emulate_media(media="screen")


def test_without_webgl_a_sentence_replaces_the_view(launch_browser, file):
    plain = launch_browser("--disable-gpu", "--disable-3d-apis")
    page = Page(plain, file)
    page.page.locator("[data-v3-note]").get_by_text("WebGL").wait_for()
    assert not page.page.locator("[data-v3]").is_visible()
    assert page.page.get_by_alt_text("picture").is_visible()
    assert page.is_quiet()
    plain.close()


def test_without_scripts_a_sentence_replaces_the_view(browser, file):
    page = Page(browser, file, java_script_enabled=False)
    assert page.page.locator("[data-v3-note]").is_visible()
    assert not page.page.locator("[data-v3]").is_visible()
    page.context.close()
