"""The live loop's sends while strangers send malformed messages to every socket of its outputs.

    python -m benchmarks.live_fuzz                     # 10,000 messages each
    python -m benchmarks.live_fuzz --messages 1000 --quiet 5 --switch 0.5

Frames of 40 markers and 7 controls at 100 Hz, controls found from the markers, go to OSC, to the
WebSocket, LSL and a MIDI file at once. One receiver in a process of its own reads OSC and the
WebSocket; the malformed messages come from another. `send` is what the loop spends to hand a frame
to all outputs (us), `late` by how much its step began late (ms), `osc` and `ws` the time from the
loop to the receiver (ms): 50th and 99th percentile, the greatest, and the share of frames that
arrived. A row for each socket and kind:

    quiet       nothing but the frames
    busy        nothing but a process that computes: what a load of this machine does by itself
    beside      requests as in `http` to a WebSocket of another process: the machine's part of it
    tcp         bytes at random to the WebSocket's port
    http        requests with headers that are broken, long, foreign or none
    frames      a good handshake, then frames of the WebSocket that break its protocol
    messages    a good handshake, then messages at random, some too long
    clients     200 clients at once, half of which never read
    osc         datagrams to the port that OSC is sent from
    lsl         bytes at random to the ports that liblsl opened, TCP and UDP
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import contextlib
import gc
import json
import multiprocessing
import os
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from defsense_fab.runtime.controls.control_bank import ControlBank
from defsense_fab.runtime.controls.control_spec import ControlSpec, Shaping, default_specs
from defsense_fab.runtime.frames.live_frame import LiveFrame, Quality
from defsense_fab.runtime.outputs.live_file import open_outputs, parse_output
from defsense_fab.runtime.outputs.output import LatestFrameSender
from defsense_fab.runtime.outputs.settings import WebSocketSettings
from defsense_fab.runtime.outputs.websocket_output import WebSocketOutput
from tests.runtime.bars import POSES, bent, markers, poses, twisted

RATE = 100.0


class Loop:
    """Makes frames of a bar that is bent and twisted, and sends them."""

    def __init__(self, outputs: list[LatestFrameSender]) -> None:
        self._outputs, self._rng = outputs, np.random.default_rng(0)
        self._rest = markers(40, self._rng)
        both = ControlSpec("bend", "bend_up - bend_down", Shaping(minimum=-1))
        specs = [both, *default_specs(POSES)]
        self._bank = ControlBank(poses(self._rest), self._rest, specs, independent=3)
        self._number, self._begin = 0, time.perf_counter()

    def run(self, until: Callable[[], bool]) -> dict[str, Any]:
        """Of each frame: number, when it was sent, us to send it, ms late."""
        numbers, sent, cost, late = [], [], [], []
        due = time.perf_counter()
        while not until():
            due += 1 / RATE
            time.sleep(max(0.0, due - time.perf_counter()))
            begun = time.perf_counter()
            frame = self._frame(begun)
            handed = time.perf_counter()
            for output in self._outputs:
                output.send(frame)
            cost.append(1e6 * (time.perf_counter() - handed))
            late.append(1e3 * (begun - due))
            numbers.append(frame.number)
            sent.append(begun)
        return {"number": numbers, "sent": sent, "cost": cost, "late": late}

    def _frame(self, now: float) -> LiveFrame:
        self._number += 1
        t = now - self._begin
        moved = bent(self._rest, 0.5 + 0.4 * np.sin(t)) + twisted(self._rest, 0.3 * np.sin(3 * t))
        places = self._rest + moved + self._rng.normal(0, 0.3, moved.shape)
        found = self._bank.update(places, np.full(len(places), 0.3), t)
        signals = np.zeros(3)
        return LiveFrame(
            "bar", self._number, t, time.monotonic(), ("a", "b", "c"), 1500 + signals, signals,
            tuple(range(len(places))), places, np.full(len(places), 0.75), 0.3, Quality.TRUSTED,
            None, found.values, found.confidence,
        )  # fmt: skip


def receive(osc: Any, url: str, box: Any) -> None:
    """Arrivals by frame number, of OSC and the WebSocket, until the parent says so."""
    arrived: dict[str, dict[int, float]] = {"osc": {}, "ws": {}}

    async def read_osc() -> None:
        loop = asyncio.get_running_loop()
        while True:
            data = await loop.sock_recv(osc, 65536)
            at = data.find(b"/time\0")
            if at >= 0:  # the number stands at the end of its bundle
                arrived["osc"][int.from_bytes(data[-4:], "big")] = time.perf_counter()

    async def read_websocket() -> None:
        while True:
            with contextlib.suppress(OSError, WebSocketException):
                async with connect(url) as client:
                    async for text in client:
                        arrived["ws"][json.loads(text)["number"]] = time.perf_counter()
            await asyncio.sleep(0.1)

    async def answer() -> None:
        tasks = [asyncio.create_task(read_osc()), asyncio.create_task(read_websocket())]
        while not box.poll():
            await asyncio.sleep(0.05)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    osc.setblocking(False)
    asyncio.run(answer())
    box.send(arrived)


def connected(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=2)


def shaken(port: int) -> socket.socket:
    """A WebSocket client after its handshake."""
    one = connected(port)
    key = base64.b64encode(os.urandom(16)).decode()
    one.sendall(
        f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    one.recv(4096)
    return one


def ended(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.close()


def fuzz_tcp(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    for _ in range(count):
        with contextlib.suppress(OSError):
            one = connected(ports["ws"])
            one.sendall(rng.bytes(int(rng.integers(1, 3000))))
            ended(one)


def fuzz_http(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    port = ports["ws"]
    good = f"Host: localhost:{port}\r\n".encode()
    kinds = [
        lambda: b"GET / HTTP/1.1\r\n\r\n",
        lambda: b"GET / HTTP/1.1\r\n" + good + b"Origin: http://evil.example\r\n\r\n",
        lambda: b"GET /" + b"a" * 9000 + b" HTTP/1.1\r\n" + good + b"\r\n",
        lambda: b"GET / HTTP/1.1\r\n" + good + b"X: y\r\n" * 500 + b"\r\n",
        lambda: b"POST / HTTP/1.1\r\n" + good + b"Content-Length: 10\r\n\r\n0123456789",
        lambda: b"GET / HTTP/9.9\r\n" + good + b"\r\n",
        lambda: b"GET / HTTP/1.1\r\n" + good + b"Upgrade: websocket\r\n\r\n",
        lambda: b"GET / HTTP/1.1\r\n" + rng.bytes(200) + b"\r\n\r\n",
        lambda: b"GET /../../etc/passwd HTTP/1.1\r\n" + good + b"\r\n",
    ]
    for n in range(count):
        with contextlib.suppress(OSError):
            one = connected(port)
            one.sendall(kinds[n % len(kinds)]())
            ended(one)


def fuzz_frames(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    for _ in range(count):
        with contextlib.suppress(OSError):
            one = shaken(ports["ws"])
            one.sendall(rng.bytes(int(rng.integers(2, 200))))
            ended(one)


def fuzz_messages(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    """Most are ignored; every hundredth is no text, or too long, which ends the connection."""
    one = shaken(ports["ws"])
    for n in range(count):
        kind, data = 0x82, rng.bytes(int(rng.integers(0, 125)))
        if n % 2:
            kind, data = 0x81, b'{"token": [' + b"[" * int(rng.integers(0, 100))
        if n % 200 == 99:
            data = b"\xff\xfe"
        elif n % 200 == 198:
            data = bytes(3000)
        size = bytes([0x80 | min(len(data), 126)])
        if len(data) > 125:
            size += len(data).to_bytes(2, "big")
        try:
            one.sendall(bytes([kind]) + size + bytes(4) + data)
            one.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while one.recv(65536):  # frames, which would fill this client's buffer
                    pass
            one.settimeout(2)
        except OSError:
            data = bytes(3000)
        if n % 100 in (98, 99) or len(data) > 2048:
            ended(one)
            one = shaken(ports["ws"])
    ended(one)


def fuzz_clients(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    held = []
    for _ in range(min(200, count)):
        with contextlib.suppress(OSError):
            held.append(shaken(ports["ws"]))
    end = time.monotonic() + 8
    while time.monotonic() < end:
        for one in held[::2]:
            one.settimeout(0.01)
            with contextlib.suppress(OSError):
                one.recv(65536)
    for one in held:
        ended(one)


def fuzz_osc(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        for n in range(count):
            text = (
                b"/defsense/rest\0\0,f\0\0" if n % 3 == 0 else b"#bundle\0" if n % 3 == 1 else b""
            )
            with contextlib.suppress(OSError):
                one.sendto(
                    text + rng.bytes(int(rng.integers(0, 1400))), ("127.0.0.1", ports["osc"])
                )


def fuzz_lsl(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    tcp, udp = ports["lsl tcp"], ports["lsl udp"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams:
        for n in range(count):
            text = (b"LSL:shortinfo\r\n", b"LSL:streamfeed/110 x\r\n", b"LSL:timedata\r\n", b"")[
                n % 4
            ]
            data = text + rng.bytes(int(rng.integers(0, 500)))
            with contextlib.suppress(OSError):
                if n % 2 and tcp:
                    one = connected(tcp[n // 2 % len(tcp)])
                    one.sendall(data)
                    ended(one)
                elif udp:
                    datagrams.sendto(data, ("127.0.0.1", udp[n // 2 % len(udp)]))


def busy(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    end = time.monotonic() + 10
    while time.monotonic() < end:
        rng.normal(size=1000).sum()


def beside(ports: dict[str, Any], count: int, rng: np.random.Generator) -> None:
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    other = spawn.Process(target=serve_alone, args=(there,), daemon=True)
    other.start()
    fuzz_http({"ws": here.recv()}, count, rng)
    other.kill()


def serve_alone(box: Any) -> None:
    output = WebSocketOutput(WebSocketSettings(port=0))
    box.send(output._server.port)
    time.sleep(1000)


FUZZERS = {
    "busy": busy,
    "beside": beside,
    "tcp": fuzz_tcp,
    "http": fuzz_http,
    "frames": fuzz_frames,
    "messages": fuzz_messages,
    "clients": fuzz_clients,
    "osc": fuzz_osc,
    "lsl": fuzz_lsl,
}


def row(name: str, seconds: float, run: dict[str, Any], arrived: dict[str, Any]) -> str:
    def three(values: list[float]) -> str:
        if not values:
            return "       -       -       -"
        return "".join(f"{x:8.2f}" for x in (*np.percentile(values, [50, 99]), max(values)))

    sent = dict(zip(run["number"], run["sent"], strict=True))
    cells = [three(run["cost"]), three(run["late"])]
    for kind in ("osc", "ws"):
        taken = [1e3 * (at - sent[n]) for n, at in arrived[kind].items() if n in sent]
        share = len(taken) / max(1, len(sent))
        cells.append(f"{three(taken)} {100 * share:4.0f} %")
    return f"{name:9s}{len(sent):7d}{seconds:7.1f}" + " |".join(["", *cells])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--messages", type=int, default=10_000)
    parser.add_argument("--quiet", type=float, default=10.0, help="seconds without strangers")
    parser.add_argument("--only", nargs="*", choices=list(FUZZERS), default=list(FUZZERS))
    parser.add_argument("--switch", type=float, help="ms until threads of Python take turns (5)")
    parser.add_argument("--collect", action="store_true", help="without gc.freeze at the start")
    asked = parser.parse_args()
    if asked.switch:
        sys.setswitchinterval(asked.switch / 1e3)
    spawn = multiprocessing.get_context("spawn")
    osc = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    osc.bind(("127.0.0.1", 0))
    folder = Path(tempfile.mkdtemp())
    outputs = open_outputs(
        parse_output(text)
        for text in (
            f"osc,port={osc.getsockname()[1]},wekinator_port={osc.getsockname()[1]}",
            "websocket,port=0,rate=0",
            "lsl",
            f"midi,file={folder / 'x.mid'}",
        )
    )
    for output in outputs:
        output.wait_until_tried(10)
        print(output.about)
    url = outputs[1].about.split("page at ")[1].replace("http", "ws")
    loop = Loop(outputs)
    begun = time.monotonic()
    loop.run(lambda: time.monotonic() > begun + 1)  # all is open and compiled
    if not asked.collect:
        gc.collect()
        gc.freeze()
    own = psutil.Process().net_connections()
    websocket = int(url.rsplit(":", 1)[1].strip("/"))
    source = outputs[0]._output._socket.getsockname()[1]  # type: ignore[union-attr]
    ports: dict[str, Any] = {
        "ws": websocket,
        "osc": source,
        "lsl tcp": [
            c.laddr.port for c in own if c.status == "LISTEN" and c.laddr.port != websocket
        ],
        "lsl udp": [
            c.laddr.port
            for c in own
            if c.type == socket.SOCK_DGRAM and c.laddr and c.laddr.port not in
            (source, osc.getsockname()[1])
        ],
    }  # fmt: skip
    print(f"ports: {ports}")
    print("row      frames      s |           send us      |           late ms      |"
          "            osc ms            |             ws ms")  # fmt: skip
    for name in ("quiet", *asked.only):
        here, there = spawn.Pipe()
        receiver = spawn.Process(target=receive, args=(osc, url, there))
        receiver.start()
        settled = time.monotonic() + 3
        loop.run(lambda end=settled: time.monotonic() > end)  # type: ignore[misc]
        begun = time.monotonic()
        if name == "quiet":
            run = loop.run(lambda end=begun + asked.quiet: time.monotonic() > end)  # type: ignore[misc]
        else:
            stranger = spawn.Process(
                target=FUZZERS[name], args=(ports, asked.messages, np.random.default_rng(1))
            )
            stranger.start()
            run = loop.run(lambda who=stranger: not who.is_alive())  # type: ignore[misc]
        seconds = time.monotonic() - begun
        here.send("enough")
        arrived = here.recv()
        receiver.join()
        print(row(name, seconds, run, arrived), flush=True)
        for output in outputs:
            if output.trouble:
                print(f"         {output.trouble}")
    for output in outputs:
        print(f"{output.name}: {output.statistics}")
    print(outputs[1]._output.counts)  # type: ignore[union-attr]
    for output in outputs:
        output.close()


if __name__ == "__main__":
    main()
