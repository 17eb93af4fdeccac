"""A page is served to authorized browsers only, and invalid messages do no harm."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
import time
from typing import ClassVar

import msgspec
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from defsense_fab.core.errors import DeviceError, OutputError
from defsense_fab.core.machine.local_access import Access
from defsense_fab.runtime.view.messages import Arrays, Event, Problem, Request, Result, Upload
from defsense_fab.runtime.view.web_server import SOCKET_PATH, Download, WebServer
from tests.support.errors import raises

LONG = 240.0
TOKEN = "t0ken-of-the-test"
MAX_UPLOAD = 1024 * 1024


class Sum(Result, frozen=True, kw_only=True):
    value: int


class Add(Request, frozen=True, kw_only=True):
    result: ClassVar[type | None] = Sum
    a: int
    b: int


class Fail(Request, frozen=True, kw_only=True):
    how: str


class Cloud(Request, frozen=True, kw_only=True):
    count: int


class Wait(Request, frozen=True, kw_only=True):
    lane: ClassVar[str] = "slow"


class Count(Event, frozen=True, kw_only=True):
    value: int


class Blink(Event, frozen=True, kw_only=True):
    is_kept: ClassVar[bool] = False
    text: str


class Calculator:
    """An application that adds numbers, fails on request, and receives files."""

    decoder = msgspec.json.Decoder(Add | Fail | Cloud | Wait | Upload)

    def __init__(self):
        self.clients, self.received = [], []
        self.go_on = threading.Event()

    def connect(self, client):
        self.clients.append(client)

    def disconnect(self, client):
        self.clients.remove(client)

    def handle(self, client, request):
        match request:
            case Add(a=a, b=b):
                return Sum(value=a + b)
            case Cloud(count=count):
                points = np.arange(3.0 * count).reshape(count, 3)
                return Arrays(name="cloud", arrays={"points": points}, facts={"count": count})
            case Wait():
                assert self.go_on.wait(LONG)
                return None
            case Fail(how="device"):
                raise DeviceError(
                    "must be greater than 0; you typed -5", code="out-of-range",
                    where="device.toml:19", action="Increase it", key="mesh.edge_length",
                )  # fmt: skip
        raise ZeroDivisionError("one")

    def receive(self, client, name, content):
        if name == "bad.stl":
            raise DeviceError("is not a body", code="not-a-body", where=name)
        self.received.append((name, content))

    def download(self, path):
        return Download("parts \u00e9.zip", b"zip") if path == "parts" else None


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def serve(access=None, host="127.0.0.1"):
    server = WebServer(free_port(), access or Access(host), host, max_upload_bytes=MAX_UPLOAD)
    server.app = Calculator()
    server.start(server.app)
    return server


@pytest.fixture(scope="module")
def page():
    server = serve()
    yield server
    server.close()


@pytest.fixture(scope="module")
def open_page():
    """Serve a page to other machines."""
    server = serve(Access("0.0.0.0", TOKEN), "0.0.0.0")
    yield server
    server.close()


def get(server, path="/", **headers):
    """Return status, headers and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=LONG)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


def browser(server, **headers):
    return connect(
        f"ws://127.0.0.1:{server.port}{SOCKET_PATH}", additional_headers=headers,
        open_timeout=LONG, close_timeout=LONG, max_size=None,
    )  # fmt: skip


def receive(client, wanted):
    """Return the next message for which `wanted` is true."""
    while True:
        message = client.recv(timeout=LONG)
        content = json.loads(message) if isinstance(message, str) else message
        if wanted(content):
            return content


def reply(client, number):
    return receive(client, lambda m: isinstance(m, dict) and m.get("id") == number)


def ask(client, kind, number=1, **content):
    client.send(json.dumps({"kind": kind, "id": number, **content}))
    return reply(client, number)


def until(condition):
    """Wait for another thread."""
    end = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_page_is_served_with_strict_headers(page):
    status, headers, body = get(page)
    assert status == 200
    assert headers["Content-Type"] == "text/html"
    assert b"<title>" in body
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Set-Cookie"] is None
    assert get(page, "/index.js")[0] == 200


@pytest.mark.parametrize(
    "path",
    ["/../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/..\\..\\x", "//etc/passwd",
     "/files/../x", "/index.html/../../x"],
)  # fmt: skip
def test_files_outside_of_the_page_are_not_served(page, path):
    assert get(page, path)[0] in (400, 404)


def test_download_is_saved_and_not_shown(page):
    status, headers, body = get(page, "/files/parts")
    assert (status, body) == (200, b"zip")
    assert headers["Content-Disposition"].startswith("attachment")
    assert get(page, "/files/other")[0] == 404


def test_pages_of_other_origins_are_refused(page):
    assert get(page, Origin="http://elsewhere.example")[0] == 403
    assert get(page, Host="elsewhere.example")[0] == 403
    assert get(page, Origin=f"http://localhost:{page.port}")[0] == 200
    assert get(page, Origin=f"http://localhost:{page.port + 1}")[0] == 403
    with (
        pytest.raises(InvalidStatus, match="403"),
        browser(page, Origin="http://elsewhere.example"),
    ):
        pass
    with browser(page, Origin=f"http://127.0.0.1:{page.port}") as client:
        assert ask(client, "add", a=1, b=2)["result"] == {"value": 3}


def test_other_machines_need_the_token_on_page_and_socket(open_page):
    assert get(open_page)[0] == 403
    assert get(open_page, "/?token=wrong")[0] == 403
    assert get(open_page, "/files/parts")[0] == 403
    status, headers, _ = get(open_page, "/?token=" + TOKEN)
    assert status == 200
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    pair = cookie.split(";")[0]
    assert get(open_page, Cookie=f"other=1; {pair}")[0] == 200
    assert get(open_page, Cookie=pair.replace(TOKEN, "wrong"))[0] == 403
    with pytest.raises(InvalidStatus, match="403"), browser(open_page):
        pass
    with browser(open_page, Cookie=pair) as client:
        assert ask(client, "add", a=1, b=2)["result"] == {"value": 3}


def test_busy_port_and_foreign_address_are_refused(page):
    with raises(OutputError, "port-busy", port=page.port):
        WebServer(page.port, Access("127.0.0.1"))
    with raises(OutputError, "address-unavailable", host="192.0.2.1"):
        WebServer(free_port(), Access("192.0.2.1"), "192.0.2.1")


def test_page_is_served_and_sockets_wait_before_the_start():
    server = WebServer(free_port(), Access("127.0.0.1"))
    server.listen()
    assert get(server)[0] == 200
    assert get(server, "/files/parts")[0] == 404
    with browser(server) as client:
        client.send(json.dumps({"kind": "add", "id": 1, "a": 1, "b": 2}))
        with pytest.raises(TimeoutError):
            client.recv(timeout=0.2)
        server.start(Calculator())
        assert reply(client, 1)["result"] == {"value": 3}
    server.close()


def test_server_closes_while_sockets_wait():
    server = WebServer(free_port(), Access("127.0.0.1"))
    server.listen()
    with browser(server) as client:
        server.close()
        with pytest.raises(ConnectionClosed):
            client.recv(timeout=LONG)


def test_requests_are_answered_by_number(page):
    with browser(page) as client:
        for k in range(50):
            client.send(json.dumps({"kind": "add", "id": k, "a": k, "b": 1}))
        assert [reply(client, k)["result"]["value"] for k in range(50)] == list(range(1, 51))


def test_request_of_another_lane_does_not_wait(page):
    page.app.go_on.clear()
    with browser(page) as client:
        client.send(json.dumps({"kind": "wait", "id": 7}))
        assert ask(client, "add", 8, a=1, b=1)["result"] == {"value": 2}
        page.app.go_on.set()
        assert reply(client, 7)["problem"] is None


def test_refused_request_names_the_field(page):
    with browser(page) as client:
        problem = ask(client, "fail", how="device")["problem"]
        assert problem["code"] == "out-of-range"
        assert problem["field"] == "mesh.edge_length"
        assert "device.toml:19" in problem["text"]
        assert "device.toml" not in problem["message"]
        assert ask(client, "fail", 2, how="bug")["problem"]["code"] == "task-failed"
        assert ask(client, "add", 3, a=1, b=2)["result"] == {"value": 3}


def test_later_browser_gets_the_newest_event_of_each_kind(page):
    page.publish(Count(value=1))
    page.publish(Blink(text="gone"))
    page.publish(Count(value=2))
    page.publish_arrays(Arrays(name="body", arrays={"vertices": np.zeros((2, 3))}))
    with browser(page) as client:
        events = []
        while len(events) < 2:
            events.append(client.recv(timeout=LONG))
        assert json.loads(events[0]) == {"kind": "count", "value": 2}
        assert isinstance(events[1], bytes)
        page.publish(Blink(text="now"))
        assert receive(client, lambda m: isinstance(m, dict))["text"] == "now"
    page.forget()
    with browser(page) as client:
        assert ask(client, "add", a=1, b=2)["result"] == {"value": 3}


def read_arrays(message):
    (length,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + length])
    arrays = {}
    for entry in header["arrays"]:
        start = 4 + length + entry["at"]
        assert start % 8 == 0
        count = int(np.prod(entry["shape"]))
        flat = np.frombuffer(message, entry["type"], count, start)
        arrays[entry["name"]] = flat.reshape(entry["shape"])
    return header, arrays


def test_arrays_answer_a_request(page):
    with browser(page) as client:
        client.send(json.dumps({"kind": "cloud", "id": 9, "count": 5}))
        header, arrays = read_arrays(receive(client, lambda m: isinstance(m, bytes)))
    assert (header["id"], header["facts"]) == (9, {"count": 5})
    assert arrays["points"].dtype == np.float32
    np.testing.assert_array_equal(arrays["points"], np.arange(15.0).reshape(5, 3))


@pytest.mark.parametrize(
    "sent",
    ["", "x", "[]", "{}", '{"kind": "add"}', '{"kind": "add", "id": "x", "a": 1, "b": 2}',
     '{"kind": "add", "id": 1, "a": 1e999, "b": 2}', '{"kind": "none", "id": 1}', "[" * 100_000,
     b"", b"\xff" * 3, b"\xff" * 1000, "\ud800".encode("utf-8", "surrogatepass"),
     "x" * (2 * 2**20)],
    ids=range(14),
)  # fmt: skip
def test_garbage_ends_at_most_its_own_connection(page, sent):
    with browser(page) as other:
        with browser(page) as client:
            try:
                client.send(sent)
                client.recv(timeout=0.2)
            except (ConnectionClosed, TimeoutError):
                pass  # both are correct
        assert ask(other, "add", 2, a=1, b=2)["result"] == {"value": 3}


def test_browser_that_floods_is_refused_and_others_are_served(page):
    page.app.go_on.clear()
    with browser(page) as client, browser(page) as other:
        for k in range(300):
            client.send(json.dumps({"kind": "wait", "id": k}))
        refused = receive(client, lambda m: isinstance(m, dict) and m.get("problem"))
        assert refused["problem"]["code"] == "too-many-requests"
        assert ask(other, "add", a=1, b=2)["result"] == {"value": 3}
        page.app.go_on.set()
        for _ in range(299):  # a browser that does not read cannot close its connection
            receive(client, lambda m: isinstance(m, dict) and m["kind"] == "reply")


def test_browser_is_forgotten_when_it_leaves(page):
    with browser(page):
        until(lambda: len(page.app.clients) == len(page.clients) == 1)
    until(lambda: not page.app.clients and not page.clients)


def announce(client, number, size, name="x.stl"):
    client.send(json.dumps({"kind": "upload", "id": number, "name": name, "size": size}))


def part(number, content):
    return struct.pack("<I", number) + content


def test_uploaded_file_arrives_in_parts(page):
    page.app.received.clear()
    with browser(page) as client:
        announce(client, 4, 5)
        client.send(part(4, b"abc"))
        client.send(part(4, b"de"))
        assert reply(client, 4)["problem"] is None
        assert page.app.received == [("x.stl", b"abcde")]
        announce(client, 5, 1, "bad.stl")
        client.send(part(5, b"a"))
        assert reply(client, 5)["problem"]["code"] == "not-a-body"


@pytest.mark.parametrize(
    ("size", "code"),
    [(2 * 2**30, "upload-too-large"), (0, "upload-empty"), (-1, "upload-empty")],
)
def test_invalid_announcement_is_refused_before_any_byte(page, size, code):
    page.app.received.clear()
    with browser(page) as client:
        announce(client, 4, size)
        assert reply(client, 4)["problem"]["code"] == code
        client.send(part(4, b"x" * 1000))
        assert ask(client, "add", 6, a=1, b=2)["result"] == {"value": 3}
        announce(client, 7, 3)  # another file still arrives
        client.send(part(7, b"abc"))
        assert reply(client, 7)["problem"] is None
    assert page.app.received == [("x.stl", b"abc")]


def test_file_larger_than_announced_is_dropped(page):
    page.app.received.clear()
    with browser(page) as client:
        announce(client, 4, 3)
        client.send(part(4, b"abcdef"))
        assert reply(client, 4)["problem"]["code"] == "upload-longer-than-announced"
    assert not page.app.received


def test_problem_of_an_unknown_error_has_no_traceback():
    problem = Problem.of(ZeroDivisionError("x"))
    assert problem.code == "task-failed"
    assert "Traceback" not in problem.text


def test_browser_that_asks_and_does_not_read_is_disconnected(page):
    with socket.create_connection(("127.0.0.1", page.port)) as stuck, browser(page) as other:
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        upgrade = f"Upgrade: websocket\r\nConnection: Upgrade\r\n{key}\r\n"
        stuck.sendall(f"GET {SOCKET_PATH} HTTP/1.1\r\nHost: 127.0.0.1\r\n{upgrade}".encode())
        until(lambda: len(page.app.clients) == 2)
        content = json.dumps({"kind": "cloud", "id": 1, "count": 3_000_000}).encode()
        frame = bytes([0x81, 0x80 | len(content), 0, 0, 0, 0]) + content  # masked by zeros
        for _ in range(20):  # each answer has 36 MB
            stuck.sendall(frame)
        until(lambda: len(page.app.clients) == 1)
        assert ask(other, "add", a=1, b=2)["result"] == {"value": 3}


def test_empty_parts_of_a_file_take_no_memory(page):
    with browser(page) as client:
        announce(client, 4, 3)
        for _ in range(1000):
            client.send(part(4, b""))
        assert ask(client, "add", 5, a=1, b=2)["result"] == {"value": 3}
        (served,) = (c for c in page.clients if c.upload is not None)
        assert not served.upload[1].content
        client.send(part(4, b"abc"))
        assert reply(client, 4)["problem"] is None


def test_invalid_address_is_refused(page):
    with socket.create_connection(("127.0.0.1", page.port)) as connection:
        connection.sendall(b"GET //[ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert b" 400 " in connection.recv(1000).split(b"\r\n")[0]
    assert get(page, Host="elsewhere.example@127.0.0.1")[0] == 403
