"""The page, by its own buttons and handles; browsers are not part of this."""

from __future__ import annotations

import shutil
import socket
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest

from defsense_fab.core.device_file import load_device
from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.view.local_page import local_page
from defsense_fab.studio.page.build_work import BuildWork
from defsense_fab.studio.page.cord_scene import with_point
from defsense_fab.studio.page.latest import Latest
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.project.project import Project
from tests.pipeline.live.conftest import live_bar as live_bar_fixture
from tests.pipeline.twin.conftest import small_bar as small_bar_fixture

viser = pytest.importorskip("viser")
small_bar, live_bar = small_bar_fixture, live_bar_fixture
LONG = 60.0


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="module")
def server():
    made = local_page(free_port(), "test")
    yield made
    made.stop()


@pytest.fixture
def page(server, live_bar, tmp_path):
    folder = tmp_path / "bar"
    shutil.copytree(live_bar.folder, folder)
    server.gui.reset()
    server.scene.reset()
    made = StudioPage(server, Project(folder))
    assert made._quick.wait(LONG)
    yield made
    made.close()


def error_told(page):
    assert page._quick.wait(LONG)
    assert page._error.content.startswith(f"### {page._shown.error:.2f} mm")
    return page._shown.error


def test_an_error_follows_a_point_that_is_dragged_and_is_written_when_it_is_let_go(page):
    before, sensor = error_told(page), page._project.device.sensors[0]
    text = page._project.text
    page.choose(sensor.name)
    place = sensor.curve.points[2] + [0.0, 2.5]
    for share in np.linspace(0.2, 1.0, 5):
        moved = with_point(sensor, 2, sensor.curve.points[2] + share * np.array([0.0, 2.5]))
        page.drawn(moved, 2, False)
    during = error_told(page)
    assert during != before
    assert page._project.text == text
    page.drawn(moved, 2, True)
    device = load_device(page._project.folder)
    np.testing.assert_allclose(device.sensors[0].curve.points[2], place, atol=1e-3)
    assert page._undo.label == f"Undo: move control point 3 of `{sensor.name}`"
    page._project.undo()
    assert page._project.text == text
    assert error_told(page) == before
    assert page._redo.disabled is False


def test_cords_are_added_and_deleted(page):
    names = [s.name for s in page._project.device.sensors]
    page._add()
    (new,) = {s.name for s in page._project.device.sensors} - set(names)
    assert page._list.value == new
    page._slow.wait(LONG)
    assert f"| {new} |" in page._limits.content
    page._delete()
    assert [s.name for s in page._project.device.sensors] == names
    page._delete()
    assert page._message.content == "Choose a cord first."


def test_what_breaks_a_limit_is_told(page):
    sensor = page._project.device.sensors[0]
    page.drawn(with_point(sensor, 2, sensor.curve.points[2] + [0.0, 60.0]), 2, True)
    assert page._slow.wait(LONG)
    assert f"cord '{sensor.name}' leaves the body" in page._limits.content


def test_what_another_program_writes_is_taken_up(page):
    path = page._project.folder / "device.toml"
    path.write_text(page._project.text + "\n# by hand\n", encoding="utf-8")
    page.look()
    assert page._message.content == "edit outside of the studio"
    path.write_text("name =", encoding="utf-8")
    page.look()
    assert "not valid TOML" in page._message.content
    page._project.restore()
    page.look()


def test_requests_of_foreign_pages_and_by_foreign_names_are_refused(server):
    url = f"http://127.0.0.1:{server.get_port()}/"

    def status(headers):
        try:
            request = urllib.request.Request(url, headers=headers)
            with urllib.request.urlopen(request, timeout=LONG) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            return error.code

    assert status({}) == 200
    assert status({"Origin": f"http://127.0.0.1:{server.get_port()}"}) == 200
    assert status({"Origin": "http://elsewhere.example"}) == 403
    assert status({"Host": "elsewhere.example"}) == 403
    socket_asked = {
        "Origin": "http://elsewhere.example", "Upgrade": "websocket", "Connection": "Upgrade",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13",
    }  # fmt: skip
    assert status(socket_asked) == 403
    with pytest.raises(OutputError, match="is taken by another program"):
        local_page(server.get_port(), "other")


def test_the_newest_is_worked_on_and_failures_are_told():
    begun, go, seen, failed = threading.Event(), threading.Event(), [], []

    def work(x):
        begun.set()
        go.wait(LONG)
        if x < 0:
            raise ValueError(x)
        seen.append(x)

    latest = Latest(work, failed.append)
    latest.give(1)
    assert begun.wait(LONG)
    for x in (2, 3, 4):
        latest.give(x)
    go.set()
    assert latest.wait(LONG)
    assert seen == [1, 4]
    latest.give(-1)
    assert latest.wait(LONG)
    assert [str(e) for e in failed] == ["-1"]
    latest.close()


@pytest.mark.slow
def test_a_build_that_fails_and_one_that_is_cancelled_leave_the_page_alive(tmp_path):
    told, ended, over = [], [], threading.Event()

    def end(problem):
        ended.append(problem)
        over.set()

    work = BuildWork(lambda share, said: told.append(said), end)
    assert work.start(tmp_path / "nothing")
    assert not work.start(tmp_path / "nothing")
    assert over.wait(LONG)
    assert "no such file" in ended[0]
    over.clear()
    assert work.start(tmp_path / "nothing")
    work.cancel()
    assert over.wait(LONG)
    assert ended[1] == "cancelled"
    assert not work.running
