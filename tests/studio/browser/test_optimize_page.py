"""The step Optimize in Chromium, with states of a search that the studio publishes."""

from __future__ import annotations

import json
import shutil

import pytest

from defsense_fab.studio.messages.optimize import LayoutRow, Layouts, OptimizeState, Search
from tests.studio.browser.screens import dismiss_introduction, enter, inspector

pytest.importorskip("playwright")
from playwright.sync_api import expect

pytestmark = pytest.mark.slow
OPTIMIZED = OptimizeState(standing="optimized", text="They are the optimized ones.", obstacle="")


@pytest.fixture
def studio(serve, made_bar, tmp_path):
    return serve(shutil.copytree(made_bar, tmp_path / "bar"))


def row(name, error, parts, *, is_drawn=False):
    """Return a layout with parts if it was made on trial."""
    return LayoutRow(
        name=name, role="built" if is_drawn else "candidate", is_drawn=is_drawn, error=error,
        drawn_error=error, trained=None, trained_low=None, trained_high=None, parts=parts,
        print_hours=None, length=None, planes=2, cords=[], notes=[], problem="",
    )  # fmt: skip


def show(studio, *others):
    drawn = row("drawn", 3.0, 3, is_drawn=True)
    studio.publish(Layouts(rows=[drawn, *others], compare_seconds=0, obstacle=""))
    studio.publish(OPTIMIZED)


def answer_nothing_to(kind):
    """Return a route of the socket on which requests of a kind get no answer."""

    def handle(socket):
        server = socket.connect_to_server()
        socket.on_message(
            lambda text: None if json.loads(text)["kind"] == kind else server.send(text)
        )

    return handle


def test_what_is_compared_was_made_and_what_takes_long_is_busy(open_page, studio):
    page = open_page(studio.url)
    dismiss_introduction(page)
    page.route_web_socket("**/socket", answer_nothing_to("use-best"))
    page.reload()
    enter(page, "Optimize")
    panel = inspector(page, "Optimize")
    show(studio, row("a", 2.0, 5), row("b", 1.0, None))
    expect(
        panel.get_by_text("Another layout has 2.00 mm in the parts, with 5 parts")
    ).to_be_visible()
    show(studio, row("b", 1.0, None))
    expect(panel.get_by_text("Another layout")).to_have_count(0)
    studio.publish(Search(state="running", drawn=3.0, best=2.0))
    use = panel.get_by_role("button", name="Use the best so far")
    use.click()
    expect(use).to_have_attribute("aria-busy", "true")
    expect(use).to_be_disabled()
