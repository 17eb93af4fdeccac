"""The WebSocket is used by clients of a library, and by raw sockets that misbehave."""

import base64
import contextlib
import errno
import json
import os
import socket
import struct
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.frames.live_frame import Note, Quality
from defsense_fab.runtime.outputs import websocket_output
from defsense_fab.runtime.outputs.settings import WebSocketSettings
from defsense_fab.runtime.outputs.websocket_output import WebSocketOutput, frame_json
from tests.runtime.live_frames import frame, wait_for
from tests.support.errors import raises


@pytest.fixture
def opened():
    outputs = []

    def make(**settings):
        outputs.append(WebSocketOutput(WebSocketSettings(port=0, **settings)))
        return outputs[-1]

    yield make
    for output in outputs:
        output.close()


def address(output):
    return output.url.replace("http", "ws")


class Bare:
    """A minimal WebSocket client of RFC 6455 that reads only on request."""

    def __init__(self, port, path="/", *headers):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=120)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [
            f"GET {path} HTTP/1.1",
            f"Host: localhost:{port}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            f"Sec-WebSocket-Key: {key}",
            "Sec-WebSocket-Version: 13",
            *headers,
        ]
        self.socket.sendall("\r\n".join([*lines, "", ""]).encode())
        self._data = b""
        head = self._until(b"\r\n\r\n").decode()
        self.status = int(head.split()[1])
        self.head = head

    def _until(self, mark):
        while mark not in self._data:
            data = self.socket.recv(65536)
            if not data:
                raise EOFError
            self._data += data
        out, self._data = self._data.split(mark, 1)
        return out

    def _take(self, count):
        while len(self._data) < count:
            data = self.socket.recv(65536)
            if not data:
                raise EOFError
            self._data += data
        out, self._data = self._data[:count], self._data[count:]
        return out

    def read(self):
        """Read one frame; return its opcode and content."""
        first, size = self._take(2)
        if size == 126:
            size = struct.unpack(">H", self._take(2))[0]
        elif size == 127:
            size = struct.unpack(">Q", self._take(8))[0]
        return first & 15, self._take(size)

    def close(self):
        self.socket.close()


def test_frame_arrives(opened):
    output = opened()
    bare = Bare(output.port)
    assert bare.status == 101
    with connect(address(output)) as client:
        assert wait_for(lambda: output.clients == 2)
        output.send(
            frame(
                3,
                quality=Quality.LOST,
                lost_channel="b",
                notes=(Note("torn", "cord b is open"),),
                distance=np.nan,
            )
        )
        got = json.loads(client.recv(timeout=120))
        kind, content = bare.read()
    bare.close()
    assert kind == 1
    assert json.loads(content) == got
    assert got["schema"] == 1
    assert got["device"] == "bar"
    assert got["number"] == 3
    assert got["time"] == pytest.approx(0.03)
    assert (got["quality"], got["level"], got["lost"]) == ("lost", 0, "b")
    assert got["distance"] is None  # not finite
    assert got["controls"] == {"bend": 0.25, "twist": -0.5}
    assert got["confidence"] == {"bend": 0.9, "twist": 0.8}
    assert got["markers"][1] == [1, 0.429, 0.571, 0.714, 0.4]
    assert got["signals"] == {"a": 0.01, "b": -0.02}
    assert got["notes"] == ["cord b is open"]


def test_without_markers(opened):
    output = opened(markers=False)
    with connect(address(output)) as client:
        assert wait_for(lambda: output.clients == 1)
        output.send(frame(1))
        assert "markers" not in json.loads(client.recv(timeout=120))


def test_page(opened):
    output = opened()
    with urllib.request.urlopen(output.url, timeout=120) as answer:
        page = answer.read().decode()
        assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    assert "new WebSocket" in page
    assert "http://" not in page
    assert "https://" not in page
    with pytest.raises(urllib.error.HTTPError, match="404") as error:
        urllib.request.urlopen(output.url + "/other", timeout=120)
    error.value.close()


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ([], 101),
        (["Origin: http://localhost:3000"], 101),
        (["Origin: http://127.0.0.1"], 101),
        (["Origin: http://[::1]:80"], 101),
        (["Origin: https://example.org"], 403),
        (["Origin: null"], 403),
        (["Origin: http://localhost.example.org"], 403),
        (["Origin: http://[bad"], 403),
        (["Origin: http://localhost", "Origin: http://example.org"], 403),
        (["Host: example.org"], 403),
    ],
)
def test_foreign_origins_are_refused(opened, headers, status):
    output = opened()
    client = Bare(output.port, "/", *headers)
    assert client.status == status
    client.close()
    assert output.counts.refused == (status == 403)


def test_foreign_host_name_is_refused(opened):
    """A page of example.org whose name was made to resolve to this machine."""
    output = opened()
    request = urllib.request.Request(output.url, headers={"Host": "example.org"})
    with pytest.raises(urllib.error.HTTPError, match="403") as error:
        urllib.request.urlopen(request, timeout=120)
    error.value.close()


def test_other_machines_need_the_token(opened):
    """The token is in the address or in the first message."""
    output = opened(host="0.0.0.0")
    token = output.url.split("token=")[1]
    assert len(token) >= 20
    assert output.url in output.about
    here = f"ws://127.0.0.1:{output.port}/"
    with connect(f"{here}?token={token}") as one, connect(here) as two:
        two.send(json.dumps({"token": token}))
        assert wait_for(lambda: output.clients == 2)
        output.send(frame(9))
        assert [json.loads(c.recv(timeout=120))["number"] for c in (one, two)] == [9, 9]
    with connect(f"{here}?token={token[:-1]}x") as client:
        client.send("[" * 1000)
        with pytest.raises(ConnectionClosed, match="the token is missing or wrong"):
            client.recv(timeout=120)
    for first in ('{"token": "\\ud800"}', '{"token": 3}', "[]", b"\xff", token):
        with connect(here) as client:
            client.send(first)
            with pytest.raises(ConnectionClosed, match="1008"):
                client.recv(timeout=120)
    assert output.counts.refused == 6
    own = f"Origin: http://localhost:{output.port}"
    client = Bare(output.port, "/", own)
    assert client.status == 101
    client.close()
    client = Bare(output.port, "/", "Origin: http://example.org")
    assert client.status == 403
    client.close()


def test_custom_token(opened):
    output = opened(token="a-token-of-my-own")
    assert output.url.endswith("?token=a-token-of-my-own")
    with connect(address(output)):
        assert wait_for(lambda: output.clients == 1)


def test_number_of_clients_is_limited(opened):
    output = opened(max_clients=3)
    clients = [connect(address(output)) for _ in range(3)]
    assert wait_for(lambda: output.clients == 3)
    assert (output.trouble.code, output.trouble.data["clients"]) == ("clients-at-limit", 3)
    with pytest.raises(InvalidStatus, match="503"):
        connect(address(output))
    clients.pop().close()
    assert wait_for(lambda: output.clients == 2)
    with connect(address(output)):
        assert wait_for(lambda: output.clients == 3)
    for client in clients:
        client.close()


def test_two_hundred_clients(opened):
    """Clients beyond the limit are refused; all others receive frames."""
    output = opened()
    clients = [Bare(output.port) for _ in range(200)]
    served = [c for c in clients if c.status == 101]
    assert len(served) == 32
    assert {c.status for c in clients if c not in served} == {503}
    assert wait_for(lambda: output.clients == 32)
    output.send(frame(1))
    assert {json.loads(c.read()[1])["number"] for c in served} == {1}
    for client in clients:
        client.close()


def test_silent_connections_are_limited(opened, monkeypatch):
    """They must not use all file descriptors, nor disturb the clients that are served."""
    monkeypatch.setattr(websocket_output, "_SPARE_CONNECTIONS", 20)
    output = opened(max_clients=2)
    with connect(address(output)) as client, contextlib.ExitStack() as stack:
        assert wait_for(lambda: output.clients == 1)
        silent = [
            stack.enter_context(socket.create_connection(("127.0.0.1", output.port), timeout=120))
            for _ in range(60)
        ]
        for one in silent[22:]:  # beyond two clients and 20 spare connections
            with contextlib.suppress(ConnectionResetError):
                assert one.recv(1) == b""
        output.send(frame(1))
        assert json.loads(client.recv(timeout=120))["number"] == 1


@pytest.mark.slow
def test_client_that_never_reads_is_closed(opened, monkeypatch):
    """It receives what its buffers hold, delays no other client, and is closed after a while."""
    monkeypatch.setattr(websocket_output, "_SLOW_CLIENT_S", 2.0)
    output = opened()
    never = Bare(output.port)
    with connect(address(output)) as client:
        assert wait_for(lambda: output.clients == 2)
        last = threading.Event()

        def read():
            while json.loads(client.recv(timeout=120))["number"] != 9999:
                pass
            last.set()

        reader = threading.Thread(target=read)
        reader.start()
        # Enough to fill all buffers on the way; encoded once, since that may take long.
        big = frame_json(frame(1, count=2000), markers=True)
        end = time.monotonic() + 240
        while output.counts.slow == 0 and time.monotonic() < end:
            output.publish(big)
            time.sleep(0.002)
        assert output.counts.slow == 1
        assert wait_for(lambda: output.clients == 1)
        assert output.counts.dropped > 0
        output.send(frame(9999))
        assert last.wait(120)
        reader.join()
    never.close()


def test_messages_of_clients_are_ignored(opened):
    """They are counted; long messages and garbage end the connection."""
    output = opened()
    with connect(address(output)) as client, connect(address(output)) as long:
        assert wait_for(lambda: output.clients == 2)
        for n in range(50):
            client.send(os.urandom(n) if n % 2 else "{" * n)
        assert wait_for(lambda: output.counts.ignored == 50)
        long.send("x" * 5000)
        with pytest.raises(ConnectionClosed, match="1009"):
            long.recv(timeout=120)
        output.send(frame(4))
        assert json.loads(client.recv(timeout=120))["number"] == 4
    broken = Bare(output.port)
    assert wait_for(lambda: output.clients == 1)
    broken.socket.sendall(b"\xff" * 100)
    assert broken.read()[0] == 8  # closed
    broken.close()
    with socket.create_connection(("127.0.0.1", output.port), timeout=120) as raw:
        raw.sendall(np.random.default_rng(0).bytes(3000) + b"\r\n\r\n")
        answer = b"."
        while answer:
            try:
                answer = raw.recv(65536)
            except ConnectionResetError:
                break
    assert wait_for(lambda: output.clients == 0)


def test_busy_port_is_refused(opened):
    taken = opened().port
    with raises(OutputError, "port-busy", port=taken):
        WebSocketOutput(WebSocketSettings(port=taken))
    with raises(OutputError, "address-unavailable", host="192.0.2.1"):
        WebSocketOutput(WebSocketSettings(host="192.0.2.1"))


def test_port_that_is_taken_at_the_last_moment_is_released(monkeypatch):
    tried = []

    def listen(self, *_):
        tried.append(self)
        raise OSError(errno.EADDRINUSE, "another program listens there")

    monkeypatch.setattr(socket.socket, "listen", listen)
    with raises(OutputError, "port-busy"):
        WebSocketOutput(WebSocketSettings(port=0))
    assert tried
    assert all(s.fileno() == -1 for s in tried)


def test_closing_ends_clients(opened):
    output = opened()
    with connect(address(output)) as client:
        assert wait_for(lambda: output.clients == 1)
        output.close()
        with pytest.raises(ConnectionClosed):
            client.recv(timeout=120)
    output.send(frame(1))
    output.close()
