"""Pages are served to authorized clients only, and survive invalid data."""

from __future__ import annotations

import http.client
import re
import socket
import time

import msgspec.msgpack
import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.core.machine.local_access import Access
from defsense_fab.runtime.view.page_server import close_page, escape_markdown, serve_page
from defsense_fab.workflow.upload_limit import MAX_UPLOAD_BYTES, UploadLimit
from tests.support.errors import raises

viser = pytest.importorskip("viser")
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

LONG = 240.0
TOKEN = "t0ken-of-the-test"


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="module")
def page():
    server = serve_page(free_port(), "test")
    yield server
    close_page(server)


@pytest.fixture(scope="module")
def open_page():
    """Serve a page to other machines."""
    access = Access("0.0.0.0", TOKEN)
    server = serve_page(free_port(), "test", access, "0.0.0.0")
    yield server
    close_page(server)


def request(server, path="/", **headers):
    """Return status, headers and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=LONG)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


def socket_of(server, **headers):
    return connect(
        f"ws://127.0.0.1:{server.get_port()}", subprotocols=[f"viser-v{viser.__version__}"],
        additional_headers=headers, open_timeout=LONG, close_timeout=LONG, max_size=None,
    )  # fmt: skip


def browser(server):
    """Open a socket that viser takes for a browser, because it sends its camera."""
    client = socket_of(server)
    client.send(CAMERA)
    until(lambda: server.get_clients())
    return client


def message(kind, **values):
    return msgspec.msgpack.encode({"type": kind, **values})


CAMERA = message(
    "ViewerCameraMessage", wxyz=[1, 0, 0, 0], position=[0, 0, 1], fov=1.0, near=0.1, far=10.0,
    image_height=100, image_width=100, look_at=[0, 0, 0], up_direction=[0, 0, 1],
)  # fmt: skip


def until(condition):
    """Wait for another thread."""
    end = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_other_machines_need_the_token_on_page_and_socket(open_page):
    port = open_page.get_port()
    assert request(open_page)[0] == 403
    assert request(open_page, "/?token=wrong")[0] == 403
    assert request(open_page, "/?token=" + TOKEN, Origin="http://elsewhere.example")[0] == 403
    status, headers, body = request(open_page, "/?token=" + TOKEN)
    assert status == 200
    assert b"<html" in body
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert headers["Referrer-Policy"] == "no-referrer"
    cookie_pair = cookie.split(";")[0]
    assert request(open_page, Cookie=f"other=1; {cookie_pair}")[0] == 200
    assert request(open_page, Cookie=f"defsense-{port}=wrong")[0] == 403
    assert request(open_page, Cookie=cookie_pair.replace(str(port), str(port + 1)))[0] == 403
    with pytest.raises(InvalidStatus, match="403"), socket_of(open_page):
        pass
    with (
        pytest.raises(InvalidStatus, match="403"),
        socket_of(open_page, Cookie=cookie_pair, Origin="http://elsewhere.example"),
    ):
        pass
    with socket_of(open_page, Cookie=cookie_pair) as client:
        assert client.recv(timeout=LONG)


def test_this_machine_needs_no_token_and_gets_no_cookie(page):
    status, headers, _ = request(page)
    assert status == 200
    assert headers["Set-Cookie"] is None
    assert request(page, Host="elsewhere.example")[0] == 403


def test_link_has_address_and_token():
    link = Access("0.0.0.0", TOKEN).link(8090)
    assert re.fullmatch(rf"http://[^/]+:8090/\?token={TOKEN}", link)
    assert "0.0.0.0" not in link
    assert Access("127.0.0.1").link(8090) == "http://127.0.0.1:8090/"
    assert Access("::1").link(8090) == "http://[::1]:8090/"
    assert len(Access("0.0.0.0").token) > 20


def test_address_of_another_machine_is_refused():
    with raises(OutputError, "address-unavailable", host="192.0.2.1"):
        serve_page(free_port(), "test", host="192.0.2.1")
    with raises(OutputError, "address-unavailable", host="no such name"):
        serve_page(free_port(), "test", host="no such name")


@pytest.mark.parametrize("path", ["/../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/..\\..\\x",
                                  "//etc/passwd", "/assets/../../../_viser.py"])  # fmt: skip
def test_files_outside_of_the_page_are_not_served(page, path):
    assert request(page, path)[0] in (400, 404)


@pytest.mark.parametrize(
    "sent",
    [
        b"\xc1 garbage", "a text", b"", message("NoSuchMessage"), message("GuiUpdateMessage"),
        message("GuiUpdateMessage", uuid=7, updates="no"), message("FileTransferPart"),
        message("FileTransferStartUpload", source_component_uuid=[], transfer_uuid={}),
        message("ShareUrlRequest"), b"\x81" * 100_000,
        message("FileTransferPart", source_component_uuid="x", transfer_uuid="y", part_index=-1,
                content=b"x"), b"x" * (51 * 2**20),
    ],
    ids=range(12),
)  # fmt: skip
def test_garbage_on_the_socket_ends_at_most_its_own_connection(page, sent):
    with socket_of(page) as other:
        assert other.recv(timeout=LONG)
        with socket_of(page) as client:
            try:
                client.send(sent)
                client.recv(timeout=0.2)
            except (ConnectionClosed, TimeoutError):
                pass  # both are correct
        other.ping().wait(LONG)
    assert page._share_tunnel is None  # no tunnel can be opened
    with socket_of(page) as client:
        assert client.recv(timeout=LONG)


def test_html_is_escaped():
    for text in ("<script>alert(1)</script>", "<img src=x onerror=y>", "</p>", "<!-- x -->",
                 "![x](/dev/zero)"):  # fmt: skip
        plain = escape_markdown(f"## {text}")
        assert not re.search(r"<[a-zA-Z/!?]|!\[", plain)
        assert plain.replace("\u2060", "") == f"## {text}"
    assert escape_markdown("2 < 3, **bold**, `a<b`!") == "2 < 3, **bold**, `a<\u2060b`!"


def test_all_markdown_of_a_page_is_escaped(page):
    handle = page.gui.add_markdown("<b>one</b>")
    assert "<b" not in handle._markdown
    handle.content = "<b>two</b>![x](/dev/zero)"
    assert "<b" not in handle._markdown
    assert handle.content == "<b>two</b>![x](/dev/zero)"
    handle.remove()


@pytest.fixture(scope="module")
def limited(page):
    refused = []
    server = UploadLimit(page, lambda client, name, reason: refused.append((name, reason.code)))
    server.refused = refused
    return server


@pytest.fixture
def upload(page, limited):
    """Add a button; return it with the files that it receives."""
    limited.refused.clear()
    button, received = page.gui.add_upload_button("x"), []
    button.on_upload(lambda event: received.append(event.target.value))
    yield button, received
    button.remove()


def announced(button, size, name="x.stl", uuid="one", parts=None):
    count = -(-size // (512 * 1024)) if parts is None else parts
    return message(
        "FileTransferStartUpload", source_component_uuid=button._impl.uuid, transfer_uuid=uuid,
        filename=name, mime_type="", part_count=count, size_bytes=size,
    )  # fmt: skip


def part(button, index, content, uuid="one"):
    return message(
        "FileTransferPart", source_component_uuid=button._impl.uuid, transfer_uuid=uuid,
        part_index=index, content=content,
    )  # fmt: skip


def test_large_file_is_refused_before_any_byte_is_kept(page, limited, upload):
    button, received = upload
    with browser(page) as client:
        client.send(announced(button, 2 * 2**30, "huge.stl"))
        client.send(part(button, 0, b"x" * 512 * 1024))
        until(lambda: limited.refused)
        client.ping().wait(LONG)
        assert limited.refused == [("huge.stl", "upload-too-large")]
        assert limited.received_bytes == 0
        # A small file still arrives on the same connection.
        client.send(announced(button, 3, "small.stl", "two"))
        client.send(part(button, 0, b"abc", "two"))
        until(lambda: received)
    assert (received[0].name, received[0].content) == ("small.stl", b"abc")


@pytest.mark.parametrize(("size", "parts"), [(10, 10**9), (-1, 0), (MAX_UPLOAD_BYTES, 1)])
def test_invalid_announcements_are_refused(page, limited, upload, size, parts):
    button, _ = upload
    with socket_of(page) as client:
        client.send(announced(button, size, parts=parts))
        until(lambda: limited.refused)
    assert limited.refused[0][1] == "upload-invalid"


def test_file_larger_than_announced_is_dropped(page, limited, upload):
    button, received = upload
    with socket_of(page) as client:
        client.send(announced(button, 600 * 1024))
        client.send(part(button, 0, b"x" * 512 * 1024))
        client.send(part(button, 1, b"x" * 512 * 1024))
        until(lambda: limited.refused)
        assert limited.refused == [("x.stl", "upload-longer-than-announced")]
        assert limited.received_bytes == 0
    assert not received


def test_parts_from_another_browser_are_ignored(page, limited, upload):
    button, received = upload
    with browser(page) as one, browser(page) as other:
        one.send(announced(button, 3))
        until(lambda: limited.uploads)
        other.send(part(button, 0, b"abc"))
        other.ping().wait(LONG)
        assert limited.received_bytes == 0
        one.send(part(button, 0, b"def"))
        until(lambda: received)
    assert received[0].content == b"def"


def test_only_upload_buttons_receive_files(page, limited, upload):
    slider = page.gui.add_slider("x", 0, 10, 1, 5)
    with browser(page) as client:
        client.send(announced(slider, 3))
        client.send(part(slider, 0, b"abc"))
        client.ping().wait(LONG)
    assert slider.value == 5
    slider.remove()


def test_browser_that_sends_a_refused_file_is_disconnected(page, limited, upload):
    button, received = upload

    def send_all(client):
        client.send(announced(button, 2 * 2**30))
        for k in range(1000):
            client.send(part(button, k, b"x" * 512 * 1024))

    with browser(page) as client, pytest.raises(ConnectionClosed):
        send_all(client)
    with browser(page) as client:
        client.send(announced(button, 3))
        client.send(part(button, 0, b"abc"))
        until(lambda: received)


def test_number_of_uploads_is_limited(page, limited, upload):
    button, _ = upload
    with socket_of(page) as client:
        for k in range(6):
            client.send(announced(button, 600 * 1024, uuid=f"u{k}"))
        until(lambda: len(limited.refused) == 2)
        assert limited.refused[0][1] == "uploads-at-limit"
    until(lambda: not limited.uploads)  # gone with the browser
