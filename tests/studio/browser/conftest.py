"""Browsers on the studio: Chromium of the distribution, without a graphics card."""

from __future__ import annotations

import socket
import threading
import time

import pytest

from defsense_fab.core.machine.local_access import Access
from defsense_fab.studio.app.studio_app import StudioApp
from defsense_fab.studio.edits import cords as edits
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.workflow.view import HOST, WebServer

pytest.importorskip("playwright")
from playwright.sync_api import expect

SIZE = {"width": 1000, "height": 640}  # small, because the processor draws it
PHONE = {"width": 390, "height": 844}
TIMEOUT_MS = 240_000.0  # on a loaded machine
POLL_INTERVAL_S = 0.5
#: A quarter of the pixels, and no transitions; positions on the page do not change.
COARSE = {"device_scale_factor": 0.5, "reduced_motion": "reduce"}
#: The page draws five times per second at most, without animations by style sheets and without
#: smoothing: the processor draws it.
FEWER_FRAMES = """
const still = new CSSStyleSheet();
still.replaceSync("* { animation: none !important; }");
document.adoptedStyleSheets = [still];
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => setTimeout(() => draw(callback), 200);
window.cancelAnimationFrame = (number) => clearTimeout(number);
const parameter = WebGL2RenderingContext.prototype.getParameter;
WebGL2RenderingContext.prototype.getParameter = function (name) {
  return name === 0x9246 ? "Coarse" : parameter.call(this, name);  // the renderer's name
};
"""

expect.set_options(timeout=TIMEOUT_MS)


def free_port():
    """Return a port that no program uses."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]


class Studio:
    """A studio that is served to this machine, as the command line does it.

    Attributes:
        folder: The device's folder.
        url: Address of the page.
    """

    def __init__(self, folder, *, trusted=True):
        self.folder, self._trusted, self._port = folder, trusted, free_port()
        self.url = f"http://{HOST}:{self._port}/"
        self._stop = threading.Event()
        self.open()

    def open(self):
        """Serve the studio at its address."""
        self._server = WebServer(self._port, Access(HOST), HOST)
        self._app = StudioApp(self._server, self.folder, Agreement(trusted=self._trusted))
        self._server.start(self._app)
        self._stop.clear()
        self._poll = threading.Thread(target=self._follow, daemon=True)
        self._poll.start()

    def show_error(self, error):
        """Show an error in all browsers, as failed work does."""
        self._app.device.session.show_error(error)

    def publish(self, event):
        """Publish an event in place of the studio's own, once these have been published."""
        assert self._app.device.check.wait(TIMEOUT_MS / 1000)
        for step in self._app.device.steps:
            if hasattr(step, "wait"):
                assert step.wait(TIMEOUT_MS / 1000)
        self._server.publish(event)

    def draw(self, cord, *, replaces):
        """Draw a cord in place of another one."""
        session = self._app.device.session
        session.apply(edits.remove_cord(replaces))
        session.apply(edits.add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))

    def close(self):
        """End the studio and all of its work."""
        self._stop.set()
        self._poll.join()
        self._app.close()
        self._server.close()

    def _follow(self):
        while not self._stop.wait(POLL_INTERVAL_S):
            self._app.poll()


@pytest.fixture
def serve():
    """Return a function that serves the studio of a folder until the test ends."""
    studios = []

    def serve_folder(folder, **options):
        studios.append(Studio(folder, **options))
        return studios[-1]

    yield serve_folder
    for studio in studios:
        studio.close()


@pytest.fixture
def open_page(browser):
    """Return a function that opens an address in a new browser."""
    contexts = []

    def open_in_browser(url, size=SIZE, **options):
        context = browser.new_context(viewport=size, **COARSE, **options)
        context.set_default_timeout(TIMEOUT_MS)
        context.add_init_script(FEWER_FRAMES)
        contexts.append(context)
        page = context.new_page()
        page.goto(url)
        return page

    yield open_in_browser
    for context in contexts:
        context.close()


def until(condition, timeout_s=TIMEOUT_MS / 1000):
    """Wait until a condition holds; return False after `timeout_s`."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.05)
    return False
