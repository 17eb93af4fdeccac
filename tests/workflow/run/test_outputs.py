"""Outputs of devices that run at the same time, from one live.toml or several."""

import contextlib
import socket

import pytest
from msgspec.structs import replace

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.outputs.live_file import open_outputs
from defsense_fab.runtime.outputs.midi_output import MidiOutput
from defsense_fab.runtime.outputs.settings import (
    GamepadSettings,
    LslSettings,
    MidiMapping,
    MidiSettings,
    OscSettings,
    WebSocketSettings,
)
from defsense_fab.workflow.run.outputs import OutputAllocator
from tests.runtime.live_frames import frame, wait_for
from tests.runtime.outputs.midi_cable import Cable
from tests.support.errors import raises


def shared(settings, devices=3):
    """Return the settings of several devices that share one output."""
    allocator = OutputAllocator()
    return [allocator.allocate([settings])[0] for _ in range(devices)]


def test_names_are_numbered():
    allocator = OutputAllocator()
    names = ["bar", "cube", "bar", "bar-2", "bar"]
    assert [allocator.unique_name(n) for n in names] == ["bar", "cube", "bar-2", "bar-2-2", "bar-3"]


def test_addresses_without_the_device_name():
    """Wekinator listens at one port for one message; TouchOSC has pages."""
    settings = OscSettings(send=("controls", "wekinator", "touchosc"))
    settings = shared(settings)
    assert [o.port for o in settings] == [9000] * 3  # these addresses contain the device's name
    assert [o.wekinator_port for o in settings] == [6448, 6449, 6450]
    assert [o.page for o in settings] == [1, 2, 3]
    plain = OscSettings(send=("controls", "markers"))
    assert shared(plain) == [plain] * 3


def test_listening_ports():
    assert [o.port for o in shared(WebSocketSettings())] == [8765, 8766, 8767]
    free = WebSocketSettings(port=0)
    assert shared(free) == [free] * 3


def two_free_ports():
    """Return the first of two consecutive free ports."""
    for port in range(20000, 30000, 7):
        with socket.socket() as one, socket.socket() as two, contextlib.suppress(OSError):
            one.bind(("127.0.0.1", port))
            two.bind(("127.0.0.1", port + 1))
            return port
    raise AssertionError


def test_pages_of_two_devices_are_both_served():
    opened = open_outputs(shared(WebSocketSettings(port=two_free_ports()), 2))
    assert all(o.wait_until_tried(20) for o in opened)
    assert wait_for(lambda: [o.trouble for o in opened] == [None, None])
    for output in opened:
        output.close()


def test_channels_of_one_midi_port():
    settings = shared(MidiSettings(device="Synth"))
    assert [o.channel for o in settings] == [1, 2, 3]
    mapping = (MidiMapping("bend", cc=20, channel=16), MidiMapping("bend", note=60, channel=10))
    _, second, _ = shared(MidiSettings(mapping=mapping))
    assert [one.channel for one in second.mapping] == [1, 11]
    assert [o.channel for o in shared(MidiSettings(learn="Knobs"))] == [1, 1, 1]
    cable = Cable("Synth")
    for settings in shared(MidiSettings(device="Synth", program=19), 2):
        MidiOutput(settings, cable).send(frame(1, controls={"bend": 1.0}))
    assert cable.sent == [
        (0xC0, 19), (0xB0, 20, 127), (0xB0, 119, 127), (0xC1, 19), (0xB1, 20, 127), (0xB1, 119, 127)
    ]  # fmt: skip


def test_midi_files_and_virtual_ports():
    assert [o.file for o in shared(MidiSettings(file="a/x.mid"))] == [
        "a/x.mid", "a/x-2.mid", "a/x-3.mid"
    ]  # fmt: skip
    settings = shared(MidiSettings(virtual="DefSense"))
    assert [o.virtual for o in settings] == ["DefSense", "DefSense 2", "DefSense 3"]
    assert [o.channel for o in settings] == [1, 2, 3]


def test_public_names():
    assert [o.stream for o in shared(LslSettings(stream="x"))] == ["x", "x-2", "x-3"]
    assert shared(LslSettings()) == [LslSettings()] * 3  # each has the name of its device
    assert [o.name for o in shared(GamepadSettings(), 2)] == [
        "DefSense gamepad", "DefSense gamepad 2"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (WebSocketSettings(), WebSocketSettings(port=9100)),
        (OscSettings(), OscSettings(wekinator_port=7000)),
        (OscSettings(), OscSettings(host="10.0.0.2")),
        (MidiSettings(device="A"), MidiSettings(device="B")),
        (
            MidiSettings(mapping=(MidiMapping("bend", cc=20),)),
            MidiSettings(mapping=(MidiMapping("bend", note=20), MidiMapping("twist", cc=21))),
        ),
        (MidiSettings(learn="Knobs"), MidiSettings(learn="Knobs")),
        (LslSettings(stream="a"), LslSettings(stream="b")),
    ],
)  # fmt: skip
def test_distinct_settings_are_kept(first, second):
    """They may come from separate live.toml files."""
    allocator = OutputAllocator()
    assert allocator.allocate([first]) == (first,)
    assert allocator.allocate([second]) == (second,)


def test_one_device_may_send_to_a_port_twice():
    both = [OscSettings(port=9000), OscSettings(port=9001)]
    allocator = OutputAllocator()
    assert allocator.allocate(both) == tuple(both)
    assert allocator.allocate(both) == tuple(replace(o, wekinator_port=6449, page=2) for o in both)


def test_exhausted_settings_are_refused():
    allocator = OutputAllocator()
    allocator.allocate([WebSocketSettings(port=65535)])
    with raises(OutputError, "outputs-exhausted"):
        allocator.allocate([WebSocketSettings(port=65535)])
    with raises(OutputError, "outputs-exhausted"):
        shared(MidiSettings(), 17)
