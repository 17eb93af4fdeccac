"""What all modes share: steps, the file, who may look."""

from __future__ import annotations

import urllib.error
import urllib.request

import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.view.page_server import serve_page
from defsense_fab.studio.edits.body import rename_device
from defsense_fab.studio.page.studio_page import MODES, STEPS
from tests.support.errors import raises

LONG = 60.0


def test_one_mode_is_shown_at_a_time(studio_page):
    shown = studio_page.visible_modes
    assert shown == [MODES[0].label]
    for label in studio_page.modes:
        studio_page.enter(label)
        shown = studio_page.visible_modes
        assert shown == [label] == [studio_page.bench.mode]


def test_the_introduction_goes_through_the_modes_that_there_are(studio_page):
    introduction = studio_page.introduction
    introduction.start()
    seen = []
    while introduction.step is not None:
        assert introduction.step == len(seen)
        seen.append(studio_page.bench.mode)
        introduction.go(introduction.step + 1)
    assert seen == [step for step, _ in STEPS if step in studio_page.modes]
    assert set(seen) == set(studio_page.modes)


def test_each_key_does_one_thing(studio_page):
    keys = [key for key, _ in studio_page.bench.keys]
    assert len(set(keys)) == len(keys)
    assert {"1", "2", "Ctrl+Z", "K"} <= set(keys)


def test_what_another_program_writes_is_taken_up(studio_page):
    bench = studio_page.bench
    path = bench.project.folder / "device.toml"
    path.write_text(bench.project.text + "\n# by hand\n", encoding="utf-8")
    studio_page.poll()
    assert bench.project.undo_name == "edit outside of the studio"
    path.write_text("name =", encoding="utf-8")
    studio_page.poll()
    assert bench.message_code == "toml-invalid"
    bench.project.restore()
    studio_page.poll()


def test_requests_of_foreign_pages_and_by_foreign_names_are_refused(studio_server):
    url = f"http://127.0.0.1:{studio_server.get_port()}/"

    def status(headers):
        try:
            request = urllib.request.Request(url, headers=headers)
            with urllib.request.urlopen(request, timeout=LONG) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            return error.code

    assert status({}) == 200
    assert status({"Origin": f"http://127.0.0.1:{studio_server.get_port()}"}) == 200
    assert status({"Origin": "http://elsewhere.example"}) == 403
    assert status({"Host": "elsewhere.example"}) == 403
    socket_asked = {
        "Origin": "http://elsewhere.example", "Upgrade": "websocket", "Connection": "Upgrade",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13",
    }  # fmt: skip
    assert status(socket_asked) == 403
    with raises(OutputError, "port-busy"):
        serve_page(studio_server.get_port(), "other")


@pytest.mark.parametrize("name", ["body/surface.npz", "fields/index.json", "mesh.vtu"])
@pytest.mark.parametrize("content", [b"", b"garbage", b"PK\x03\x04 cut off"])
def test_a_damaged_build_is_told_and_the_page_lives(studio_page, name, content):
    bench = studio_page.bench
    path = bench.project.folder / "build" / name
    path.unlink()
    path.write_bytes(content)
    bench.load()
    assert (not bench.built) if name.startswith("body") else bench.judge is None
    assert bench.error is not None
    for label in studio_page.modes:
        studio_page.enter(label)
    assert bench.apply(rename_device("still here"))


def test_a_mode_that_fails_in_its_look_does_not_end_the_studio(studio_page, monkeypatch):
    def fail():
        raise ZeroDivisionError("by hand")

    monkeypatch.setattr(studio_page.modes["Make"], "poll", fail)
    studio_page.poll()
    assert isinstance(studio_page.bench.error, ZeroDivisionError)
