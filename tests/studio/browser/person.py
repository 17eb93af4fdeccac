"""A user of the studio whose clicks and keys are counted."""

from __future__ import annotations

import time
from math import sin


class Person:
    """Uses a page by mouse and keyboard, or by keyboard alone.

    Attributes:
        page: The page in the browser.
        clicks: Number of clicks and drags.
        keys: Number of keys.
    """

    def __init__(self, page):
        self.page, self.clicks, self.keys, self._started_at = page, 0, 0, time.monotonic()

    def __str__(self):
        minutes = (time.monotonic() - self._started_at) / 60
        return f"{self.clicks} clicks, {self.keys} keys, {minutes:.1f} minutes"

    # Mouse

    def click(self, locator, **options):
        """Click an element."""
        locator.click(**options)
        self.clicks += 1

    def drag(self, points):
        """Drag with the left button through points of the window, px."""
        mouse = self.page.mouse
        mouse.move(*points[0])
        mouse.down()
        for point in points[1:]:
            mouse.move(*point, steps=2)
        mouse.up()
        self.clicks += 1

    def draw(self, level):
        """Draw a wave from one end of the body to the other, where a plane is faced.

        Args:
            level: Height above the middle of the scene, as a share of its width.
        """
        scene = self.page.get_by_role("application")
        box, last = None, None
        while box is None or box != last:  # until the scene is at rest
            last, box = box, scene.bounding_box()
            self.page.wait_for_timeout(500)
        self.page.locator(".viewer-board").wait_for()  # the view has turned to the plane
        x, y, width = box["x"], box["y"] + box["height"] / 2, box["width"]
        shares = [0.06 + 0.044 * k for k in range(21)]
        self.drag(
            [(x + share * width, y - (level + 0.005 * sin(9 * share)) * width) for share in shares]
        )

    # Keyboard

    def press(self, *keys):
        """Press keys, such as "Control+k", one after another."""
        for key in keys:
            self.page.keyboard.press(key)
        self.keys += len(keys)

    def write(self, text):
        """Write a text in place of that of the focused field, and commit it."""
        self.press("Control+a")
        self.page.keyboard.type(text)
        self.keys += len(text)
        self.press("Enter")

    def choose(self, option):
        """Choose an option of the focused list by typing its name, as users of the keyboard do."""
        self.page.keyboard.type(option)
        self.keys += len(option)
        self.press("Enter")

    def tab_to(self, locator, limit=120):
        """Press Tab until an element has the focus.

        Raises:
            AssertionError: The element was not reached.
        """
        for _ in range(limit):
            if locator.count() and locator.evaluate("node => node === document.activeElement"):
                return
            self.press("Tab")
        raise AssertionError(f"not reached by {limit} Tab keys: {locator}")

    def command(self, name):
        """Run a command of the palette."""
        self.press("Control+k")
        search = self.page.get_by_role("combobox", name="Search commands")
        search.wait_for()
        self.page.keyboard.type(name)
        self.keys += len(name)
        self.page.get_by_role("option", name=name).first.wait_for()
        self.press("Enter")
        search.wait_for(state="detached")
