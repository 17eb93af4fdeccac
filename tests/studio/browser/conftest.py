"""Browsers on the studio: Chromium of the distribution, without a graphics card."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

SIZE = {"width": 800, "height": 600}  # small, because the processor draws it
#: A quarter of the pixels; positions on the page do not change.
COARSE = {"device_scale_factor": 0.5}
TIMEOUT_MS = 240_000.0  # on a loaded machine
#: The page draws five times per second at most: the processor draws it.
FEWER_FRAMES = """
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => setTimeout(() => draw(callback), 200);
window.cancelAnimationFrame = (number) => clearTimeout(number);
"""


def new_context(browser, **options):
    """Return a context of a browser that draws coarsely and seldom."""
    context = browser.new_context(**COARSE, **options)
    context.add_init_script(FEWER_FRAMES)
    return context


@pytest.fixture
def open_browser(browser, studio_server, studio_page):
    """Return a function that opens the studio's Cords mode in a new browser."""
    contexts = []
    studio_page.enter("Cords")

    def open_studio(size=SIZE):
        context = new_context(browser, viewport=size)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(f"http://127.0.0.1:{studio_server.get_port()}")
        page.get_by_text("Expected error in unseen states").wait_for()
        return page

    yield open_studio
    for context in contexts:
        context.close()


def until(condition, timeout_s=240.0):
    """Wait until a condition holds; return False after `timeout_s`."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.05)
    return False


def drag_until(page, drag, condition):
    """Drag until a condition holds, as a user would while a slow page still draws the scene."""
    for _ in range(4):
        page.wait_for_timeout(1000)
        drag()
        if until(condition, 30.0):
            return True
    return False


def on_screen(client, points):
    """Return the positions of points (n, 3) mm in a browser, px of its canvas."""
    camera = client.camera
    w, x, y, z = camera.wxyz
    local = (points - camera.position) @ Rotation.from_quat([x, y, z, w]).as_matrix()
    focal = camera.image_height / 2 / np.tan(camera.fov / 2)
    middle = np.array([camera.image_width, camera.image_height]) / 2
    return middle + focal * local[:, :2] / local[:, 2:]


def around_arc(client, gizmo, axis):
    """Return positions on the screen along the arc that turns a gizmo about an axis (0 to 2)."""
    w, x, y, z = gizmo.wxyz
    axes = Rotation.from_quat([x, y, z, w]).as_matrix()
    u, v = axes[:, (axis + 1) % 3], axes[:, (axis + 2) % 3]
    angle = np.radians(np.linspace(40, 65, 8))[:, None]
    radius = 0.65 * gizmo.scale  # of the arc that viser draws
    arc = np.asarray(gizmo.position) + radius * (np.cos(angle) * u + np.sin(angle) * v)
    return on_screen(client, arc)
