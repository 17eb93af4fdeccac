"""A browser that looks at the studio: the distribution's Chromium, without a graphics card."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

SIZE = {"width": 800, "height": 600}  # small: it is drawn by the processor
#: A fourth of the pixels to draw; places on the page stay what they are.
COARSE = {"device_scale_factor": 0.5}
WAIT = 60_000.0  # ms that a loaded machine may take


@pytest.fixture
def opened(browser, studio_server, studio_page):
    """Opens the studio in a browser of its own, of a size, in the mode of cords."""
    contexts = []
    studio_page.enter("Cords")

    def open_studio(size=SIZE):
        context = browser.new_context(**COARSE, viewport=size)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(WAIT)
        page.goto(f"http://127.0.0.1:{studio_server.get_port()}")
        page.get_by_text("Expected error in unseen states").wait_for()
        return page

    yield open_studio
    for context in contexts:
        context.close()


def until(holds, seconds=60.0):
    """Wait until something holds, and tell whether it does."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if holds():
            return True
        time.sleep(0.05)
    return False


def on_screen(client, points):
    """Where a browser shows points (n, 3) mm, in px of its canvas."""
    camera = client.camera
    w, x, y, z = camera.wxyz
    local = (points - camera.position) @ Rotation.from_quat([x, y, z, w]).as_matrix()
    focal = camera.image_height / 2 / np.tan(camera.fov / 2)
    middle = np.array([camera.image_width, camera.image_height]) / 2
    return middle + focal * local[:, :2] / local[:, 2:]


def around_arc(client, gizmo, axis):
    """Places on the screen along a gizmo's arc that turns about its axis (0 to 2)."""
    w, x, y, z = gizmo.wxyz
    axes = Rotation.from_quat([x, y, z, w]).as_matrix()
    one, two = axes[:, (axis + 1) % 3], axes[:, (axis + 2) % 3]
    angle = np.radians(np.linspace(40, 65, 8))[:, None]
    radius = 0.65 * gizmo.scale  # as the page draws it
    arc = np.asarray(gizmo.position) + radius * (np.cos(angle) * one + np.sin(angle) * two)
    return on_screen(client, arc)
