"""OSC messages are read back by python-osc and by an independent parser."""

import socket
import struct
import time
from dataclasses import replace

import numpy as np
import pytest
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage
from pythonosc.osc_packet import OscPacket

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.outputs.osc_output import OscOutput
from defsense_fab.runtime.outputs.settings import OscSettings
from tests.runtime.live_frames import frame
from tests.support.errors import raises


def parse(data):
    """Parse a datagram into messages (address, values), as OSC 1.0 specifies."""

    def text(at):
        end = data.index(b"\0", at)
        return data[at:end].decode(), end + 4 - end % 4

    if data.startswith(b"#bundle\0"):
        out, at = [], 16
        while at < len(data):
            size = struct.unpack_from(">i", data, at)[0]
            out += parse(data[at + 4 : at + 4 + size])
            at += 4 + size
        return out
    address, at = text(0)
    tags, at = text(at)
    values = []
    for tag in tags[1:]:
        if tag == "s":
            value, at = text(at)
        else:
            value = struct.unpack_from(f">{tag}", data, at)[0]
            at += struct.calcsize(f">{tag}")
        values.append(value)
    assert at == len(data)
    return [(address, values)]


def parse_all(datagrams):
    return [one for data in datagrams for one in parse(data)]


@pytest.fixture
def receiver():
    """Open two sockets: the receiver's and Wekinator's."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        for s in (one, two):
            s.bind(("127.0.0.1", 0))
            s.settimeout(20)
        yield one, two


@pytest.fixture
def opened(receiver):
    outputs = []

    def make(**settings):
        port, wekinator = (s.getsockname()[1] for s in receiver)
        outputs.append(OscOutput(OscSettings(port=port, wekinator_port=wekinator, **settings)))
        return outputs[-1]

    yield make
    for output in outputs:
        output.close()


def drain(one, until):
    """Return datagrams up to the one with the address `until`."""
    out = []
    while not out or until not in [a for a, _ in parse(out[-1])]:
        out.append(one.recv(65536))
    return out


def test_frame_arrives(receiver, opened):
    started_at = time.time()
    opened().send(frame(7, quality=Quality.FALLBACK))
    data = drain(receiver[0], "/defsense/bar/time")
    got = dict(parse_all(data))
    assert got.pop("/defsense/bar/control/bend") == [0.25]
    assert got.pop("/defsense/bar/control/twist") == [-0.5]
    assert got.pop("/defsense/bar/quality") == [1, "fallback"]
    assert got.pop("/defsense/bar/time") == [0.07, 7]
    assert got.pop("/defsense/bar/marker/2") == pytest.approx([6 / 7, 1, 8 / 7, 0.4])
    assert set(got) == {"/defsense/bar/marker/0", "/defsense/bar/marker/1"}
    bundle = OscBundle(data[0])  # read by python-osc, too
    assert abs(bundle.timestamp - started_at) < 20
    theirs = [(m.address, m.params) for m in bundle]
    assert theirs == parse(data[0])


def test_immediate_bundles_do_not_wait_for_a_clock_that_is_behind(receiver, opened, monkeypatch):
    """The receiver's clock is five seconds behind; python-osc waits for the time of a bundle."""
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now)
    delays = []
    for immediate in (False, True):
        opened(immediate=immediate).send(replace(frame(7), arrived=time.monotonic()))
        data = drain(receiver[0], "/defsense/bar/time")
        monkeypatch.setattr(time, "time", lambda: now - 5)
        packets = [OscPacket(each) for each in data]
        monkeypatch.setattr(time, "time", lambda: now)
        delays.append(max(m.time - (now - 5) for p in packets for m in p.messages))
    assert delays == [pytest.approx(5, abs=0.1), pytest.approx(0, abs=1e-6)]


def test_wekinator(receiver, opened):
    opened(send=("wekinator",)).send(frame(1))
    message = OscMessage(receiver[1].recv(65536))
    assert message.address == "/wek/inputs"
    assert message.params == [0.25, -0.5]


def test_touchosc_and_confidence(receiver, opened):
    opened(send=("touchosc", "confidence")).send(frame(1))
    got = dict(parse_all(drain(receiver[0], "/defsense/bar/time")))
    assert got["/1/fader1"] == [0.25]
    assert got["/1/fader2"] == [-0.5]
    assert got["/defsense/bar/confidence/twist"] == pytest.approx([0.8])
    second = opened(send=("touchosc",), page=2)
    assert "/2/fader1" in second.about
    second.send(frame(1))
    assert set(dict(parse_all(drain(receiver[0], "/defsense/bar/time")))) == {
        "/2/fader1", "/2/fader2", "/defsense/bar/time"
    }  # fmt: skip


def test_many_markers_need_several_datagrams(receiver, opened):
    opened(send=("markers",)).send(frame(1, count=200))
    data = drain(receiver[0], "/defsense/bar/time")
    assert len(data) > 3
    assert max(map(len, data)) <= 1400
    assert len({d[8:16] for d in data}) == 1  # one time
    assert len(parse_all(data)) == 201


def test_values_that_are_not_finite(receiver, opened):
    """Markers without a position are left out, other values become 0, and names become valid."""
    bad = frame(
        1,
        device="my/bär #1",
        radius=np.array([np.nan, 1, 2]),
        markers=np.array([[0, 0, 0], [0, np.nan, 0], [1, 1, 1.0]]),
        controls={"a b": np.nan, "c": np.float64(1), "d": 1},
        confidence={},
    )
    opened().send(bad)
    got = dict(parse_all(drain(receiver[0], "/defsense/my_b_r__1/time")))
    base = "/defsense/my_b_r__1"
    assert got[f"{base}/marker/0"] == [0, 0, 0, 0]
    assert f"{base}/marker/1" not in got
    assert got[f"{base}/control/a_b"] == [0.0]
    assert OscMessage(receiver[1].recv(65536)).params == [0.0, 1.0, 1.0]


def test_missing_receivers_and_garbage_do_no_harm(receiver, opened):
    """Neither stops the frames, and nothing is read."""
    output = opened()
    source = output._socket
    source.bind(("127.0.0.1", 0))
    for n in range(200):
        receiver[1].sendto(np.random.default_rng(n).bytes(n), source.getsockname())
    output.send(frame(1))
    assert drain(receiver[0], "/defsense/bar/time")
    receiver[0].close()
    for n in range(20):
        output.send(frame(n))
    assert output.trouble is None


def test_unknown_host_is_refused():
    with raises(OutputError, "unknown-host", host="no.such.host.invalid"):
        OscOutput(OscSettings(host="no.such.host.invalid"))
