"""A person at the studio: clicks and keys, counted."""

from __future__ import annotations

import time


class Person:
    """Uses a page of the browser by mouse and keyboard only."""

    def __init__(self, page):
        self.page, self.clicks, self.keys, self._begun = page, 0, 0, time.monotonic()

    @property
    def minutes(self):
        return (time.monotonic() - self._begun) / 60

    def press(self, name, at=0):
        """A button by its label, the `at`-th of those that are shown."""
        shown = self.page.get_by_role("button", name=name, exact=True).locator("visible=true")
        shown.nth(at).click()
        self.clicks += 1

    def choose(self, label, option):
        """In a list by its label."""
        self._field(label).click()
        self.page.get_by_role("option", name=option, exact=True).first.click()
        self.clicks += 2

    def write(self, label, text):
        """In a field by its label."""
        field = self._field(label)
        field.click(click_count=3)
        self.page.keyboard.type(text)
        self.page.keyboard.press("Enter")
        self.clicks, self.keys = self.clicks + 1, self.keys + len(text) + 1

    def drag(self, points):
        """With the left button through points on the screen."""
        self.page.mouse.move(*points[0])
        self.page.mouse.down()
        for x, y in points[1:]:
            self.page.mouse.move(x, y)
            self.page.wait_for_timeout(60)
        self.page.mouse.up()
        self.clicks += 1

    def _field(self, label):
        """The control beside a label that is shown."""
        words = self.page.get_by_text(label, exact=True).locator("visible=true").first
        return words.locator("xpath=following::input[1]")
