"""The page of a device: modes, introduction, keys, other programs, and access."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.view.page_server import serve_page
from defsense_fab.studio.edits.body import rename_device
from defsense_fab.studio.page.studio_page import MODES, STEPS
from tests.support.errors import raises

pytestmark = pytest.mark.slow

TIMEOUT_S = 600.0


def test_one_mode_is_shown_at_a_time(studio_page):
    assert studio_page.visible_modes == [MODES[0].label]
    for label in studio_page.modes:
        studio_page.enter(label)
        assert studio_page.visible_modes == [label] == [studio_page.bench.mode]


def test_the_introduction_visits_all_modes(studio_page):
    introduction = studio_page.introduction
    introduction.start()
    visited = []
    while introduction.step is not None:
        assert introduction.step == len(visited)
        visited.append(studio_page.bench.mode)
        introduction.go(introduction.step + 1)
    assert visited == [step for step, _ in STEPS if step in studio_page.modes]
    assert set(visited) == set(studio_page.modes)


def test_each_key_has_one_command(studio_page):
    keys = [key for key, _ in studio_page.bench.keys]
    assert len(set(keys)) == len(keys)
    assert {"1", "2", "Ctrl+Z", "K"} <= set(keys)


def test_changes_by_other_programs_become_steps(studio_page):
    bench = studio_page.bench
    path = bench.project.folder / "device.toml"
    path.write_text(bench.project.text + "\n# changed elsewhere\n", encoding="utf-8")
    studio_page.poll()
    assert bench.project.undo_name == "edit outside of the studio"
    path.write_text("name =", encoding="utf-8")
    studio_page.poll()
    assert bench.status.code == "toml-invalid"
    bench.project.restore()
    studio_page.poll()


def test_requests_from_other_origins_and_hosts_are_refused(studio_server):
    url = f"http://127.0.0.1:{studio_server.get_port()}/"

    def status(headers):
        try:
            request = urllib.request.Request(url, headers=headers)
            with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            return error.code

    assert status({}) == 200
    assert status({"Origin": f"http://127.0.0.1:{studio_server.get_port()}"}) == 200
    assert status({"Origin": "http://elsewhere.example"}) == 403
    assert status({"Host": "elsewhere.example"}) == 403
    websocket_headers = {
        "Origin": "http://elsewhere.example",
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version": "13",
    }
    assert status(websocket_headers) == 403
    with raises(OutputError, "port-busy"):
        serve_page(studio_server.get_port(), "other")


@pytest.mark.parametrize("name", ["body/surface.npz", "fields/index.json", "mesh.vtu"])
@pytest.mark.parametrize("content", [b"", b"garbage", b"PK\x03\x04 cut off"])
def test_the_page_stays_usable_with_a_damaged_build(studio_page, name, content):
    bench = studio_page.bench
    path = bench.project.folder / "build" / name
    path.unlink()
    path.write_bytes(content)
    bench.load()
    assert (not bench.is_built) if name.startswith("body") else bench.judge is None
    assert bench.status.error is not None
    for label in studio_page.modes:
        studio_page.enter(label)
    assert bench.apply(rename_device("still here"))


def test_an_exception_in_a_poll_does_not_end_the_studio(studio_page, monkeypatch):
    def fail():
        raise ZeroDivisionError

    monkeypatch.setattr(studio_page.modes["Make"], "poll", fail)
    studio_page.poll()
    assert isinstance(studio_page.bench.status.error, ZeroDivisionError)
