"""A user of the studio whose clicks and keys are counted."""

from __future__ import annotations

import time


class Person:
    """Use a page of the browser by mouse and keyboard only."""

    def __init__(self, page):
        self.page, self.clicks, self.keys, self._started_at = page, 0, 0, time.monotonic()

    @property
    def minutes(self):
        return (time.monotonic() - self._started_at) / 60

    def press(self, name, index=0):
        """Click the visible button with a label and an index."""
        buttons = self.page.get_by_role("button", name=name, exact=True).locator("visible=true")
        buttons.nth(index).click()
        self.clicks += 1

    def choose(self, label, option):
        """Choose an option of the list with a label."""
        self._field(label).click()
        self.page.get_by_role("option", name=option, exact=True).first.click()
        self.clicks += 2

    def write(self, label, text):
        """Write into the field with a label."""
        field = self._field(label)
        field.click(click_count=3)
        self.page.keyboard.type(text)
        self.page.keyboard.press("Enter")
        self.clicks, self.keys = self.clicks + 1, self.keys + len(text) + 1

    def drag(self, points):
        """Drag with the left button through points on the screen."""
        self.page.mouse.move(*points[0])
        self.page.mouse.down()
        for x, y in points[1:]:
            self.page.mouse.move(x, y)
            self.page.wait_for_timeout(60)
        self.page.mouse.up()
        self.clicks += 1

    def _field(self, label):
        """Return the control next to a visible label."""
        text = self.page.get_by_text(label, exact=True).locator("visible=true").first
        return text.locator("xpath=following::input[1]")
