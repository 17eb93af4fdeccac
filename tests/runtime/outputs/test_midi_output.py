"""MIDI: files read by mido, a device that is pulled out, learning, garbage."""

import sys

import mido
import numpy as np
import pytest

from defsense_fab.core.errors import OutputError, StorageError
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.outputs import midi_output, midi_ports
from defsense_fab.runtime.outputs.live_file import read_live_file
from defsense_fab.runtime.outputs.midi_mapping import (
    MidiLearn,
    MidiMapper,
    as_toml,
    learned,
    most_moved,
)
from defsense_fab.runtime.outputs.midi_output import MidiFile, MidiOutput
from defsense_fab.runtime.outputs.midi_ports import SystemPorts, find_port
from defsense_fab.runtime.outputs.settings import MidiMapping, MidiSettings
from tests.errors import raises
from tests.runtime.live_frames import frame
from tests.runtime.outputs.midi_cable import Cable


def moved(values, **kwargs):
    """Frames in which `bend` has these values, 10 ms apart."""
    return [frame(n, controls={"bend": v}, confidence={}, **kwargs) for n, v in enumerate(values)]


def sent_by(mapping, frames):
    mapper = MidiMapper([mapping])
    return [tuple(m) for f in frames for m in mapper.messages(f)]


def test_control_changes():
    """Scaled, limited, on their channel, only when they change."""
    got = sent_by(MidiMapping("bend", cc=74, channel=3), moved([0, 0.5, 0.501, 2, 1, -1]))
    assert got == [(0xB2, 74, 0), (0xB2, 74, 64), (0xB2, 74, 127), (0xB2, 74, 0)]
    both = sent_by(MidiMapping("bend", cc=1, low=-1), moved([-1, 0, 1]))
    assert [m[2] for m in both] == [0, 64, 127]
    turned = sent_by(MidiMapping("bend", cc=1, low=1, high=0), moved([0, 1]))
    assert [m[2] for m in turned] == [127, 0]


def test_notes():
    """On above the threshold, off only below the hysteresis; the quicker the louder."""
    one = MidiMapping("bend", note=60, channel=10, threshold=0.5, hysteresis=0.2)
    got = sent_by(one, moved([0, 0.4, 0.55, 0.45, 0.35, 0.6, 0.29, 0.2, 0.6]))
    assert [m[:2] for m in got] == [(0x99, 60), (0x89, 60), (0x99, 60)]
    slow, quick = (sent_by(one, moved(np.linspace(0, 1, n)))[0][2] for n in (200, 20))
    assert 40 < slow < quick <= 127
    assert slow == pytest.approx(40 + 87 * (0.5 / 4) ** 0.5, abs=4)  # 0.5 of the range per second
    slowest = sent_by(one, moved(np.linspace(0.49, 0.51, 200)))[0][2]
    assert slowest == pytest.approx(40 + 87 * (0.01 / 4) ** 0.5, abs=2)  # and can be heard
    assert sent_by(one, moved([0.9])) == [(0x99, 60, 64)]  # nothing is known of its speed


def test_the_board_is_reset():
    """Times that go back do not make a note of an odd loudness."""
    frames = [*moved([0.1] * 500), *moved([0.2, 0.6])]
    ((_, _, loud),) = sent_by(MidiMapping("bend", note=60), frames)
    assert loud == 127  # 0.4 in 10 ms


@pytest.mark.parametrize(
    ("last", "told"),
    [
        ((3, 99), 'pip install "defsense-fab[midi]"'),
        ((3, 0), "pip install python-rtmidi"),
    ],
)
def test_a_package_that_is_not_installed(monkeypatch, tmp_path, last, told):
    """The extra, where there is a wheel for this Python; else what compiles it."""
    monkeypatch.setattr(midi_ports, "_ALSA", tmp_path)
    monkeypatch.setattr(midi_ports, "_LAST_WITH_WHEEL", last)
    monkeypatch.setitem(sys.modules, "rtmidi", None)
    with raises(OutputError, "package-missing") as caught:
        SystemPorts().names(inputs=False)
    assert told in str(caught.value)


def test_a_file_is_read_by_others(tmp_path):
    settings = MidiSettings(
        file=str(tmp_path / "x.mid"),
        mapping=(MidiMapping("bend", cc=20), MidiMapping("bend", note=64, channel=2)),
    )
    output = MidiOutput(settings)
    for one in moved([0, 0.4, 0.8, 0.8]):
        output.send(one)
    assert output.about.endswith("x.mid")
    output.close()
    found = mido.MidiFile(tmp_path / "x.mid", clip=False)
    assert (found.type, len(found.tracks)) == (0, 1)
    assert found.tracks[0].name == "defsense"
    notes = [(m.type, round(m.time, 3)) for m in found if not m.is_meta]
    assert [kind for kind, _ in notes] == ["control_change"] * 3 + ["note_on", "note_off"]
    assert found.length == pytest.approx(0.03, abs=0.002)
    assert [m.value for m in found if m.type == "control_change"] == [0, 51, 102]


def test_a_file_is_whole_at_any_time(tmp_path):
    """After every flush, and byte by byte as the format wants it."""
    made = MidiFile(tmp_path / "x.mid", "t")
    empty = (tmp_path / "x.mid").read_bytes()
    assert empty.hex(" ") == (
        "4d 54 68 64 00 00 00 06 00 00 00 01 01 e0 "
        "4d 54 72 6b 00 00 00 09 00 ff 03 01 74 00 ff 2f 00"
    )
    made.add(bytes([0xB0, 20, 5]), 10.0)
    made.add(bytes([0xB0, 20, 6]), 10.5)  # 480 ticks: 0x83 0x60
    made.add(bytes([0xB0, 20, 7]), 3.0)  # the clock went back
    assert (tmp_path / "x.mid").read_bytes() == empty
    made.flush()
    now = (tmp_path / "x.mid").read_bytes()
    assert now[31 - 4 :].hex(" ") == "00 b0 14 05 83 60 b0 14 06 00 b0 14 07 00 ff 2f 00"
    assert int.from_bytes(now[18:22], "big") == len(now) - 22
    made.close()
    assert (tmp_path / "x.mid").read_bytes() == now
    other = MidiFile(tmp_path / "x.mid", "t")
    other.close()
    assert other.path.name == "x-2.mid"
    assert (tmp_path / "x.mid").read_bytes() == now
    with pytest.raises(StorageError):
        MidiFile(tmp_path / "none" / "x.mid", "t")


def test_controls_without_a_mapping():
    cable = Cable("Synth")
    output = MidiOutput(MidiSettings(), cable)
    output.send(frame(1, quality=Quality.UNTRAINED))
    assert cable.sent == [(0xB0, 20, 32), (0xB0, 21, 0), (0xB0, 119, 85)]
    assert output.trouble is None
    many = frame(2, controls={f"c{n}": 1.0 for n in range(60)})
    other = MidiOutput(MidiSettings(), Cable("Synth"))
    other.send(many)  # there are 36 control changes that nothing else uses


def test_a_control_that_is_not_there():
    output = MidiOutput(MidiSettings(mapping=(MidiMapping("bnd", cc=1),)), Cable("Synth"))
    output.send(frame(1))
    assert output.trouble == (
        "midi: there is no control 'bnd'; mappings can name: quality, bend, twist"
    )


def test_a_device_is_pulled_out_and_comes_back(monkeypatch):
    """It is told, and gets all values when it is back; its notes do not hang."""
    monkeypatch.setattr(midi_output, "_LOOK", 0.0)
    cable = Cable("Thru", "USB Synth 1")
    settings = MidiSettings(device="synth", mapping=(MidiMapping("bend", note=60, threshold=0.2),))
    output = MidiOutput(settings, cable)
    assert output.about == "midi: sends to 'USB Synth 1'"
    output.send(frame(1))
    assert cable.sent == [(0x90, 60, 64)]
    cable.there.remove("USB Synth 1")
    with raises(OutputError, "port-disconnected", port="USB Synth 1"):
        output.send(frame(2))
    with raises(OutputError, "port-not-found", device="synth", inputs=False):
        output.send(frame(3))
    cable.there.append("USB Synth 1")
    output.send(frame(4))
    # What hangs on a cable may have kept its power, and sound still.
    assert cable.sent == [(0x90, 60, 64), (0x80, 60, 0), (0x90, 60, 64)]
    output.close()
    assert cable.sent[-1] == (0x80, 60, 0)
    assert cable.opened == [
        ("USB Synth 1", False, False), "closed", ("USB Synth 1", False, False), "closed"
    ]  # fmt: skip


def test_the_instrument_is_told_once_for_each_channel():
    cable = Cable("Synth")
    mapping = (MidiMapping("bend", cc=7), MidiMapping("twist", cc=8, channel=3))
    output = MidiOutput(MidiSettings(program=19, mapping=mapping), cable)
    output.send(frame(1))
    output.send(frame(2))
    assert cable.sent[:2] == [(0xC0, 19), (0xC2, 19)]
    assert sum(message[0] >> 4 == 0xC for message in cable.sent) == 2
    with pytest.raises(OutputError):
        MidiSettings(program=128)


def test_a_virtual_port():
    cable = Cable()
    output = MidiOutput(MidiSettings(virtual="DefSense"), cable)
    output.send(frame(1))
    assert cable.opened == [("DefSense", False, True)]
    assert cable.sent


def test_no_port_at_all():
    with raises(OutputError, "port-not-found", inputs=True, ports=[]):
        find_port(Cable(), "", inputs=True)


def test_a_machine_without_midi(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(midi_ports, "_ALSA", tmp_path / "seq")
    with raises(OutputError, "midi-unavailable"):
        SystemPorts().names(inputs=False)
    with raises(OutputError, "midi-unavailable"):
        MidiOutput(MidiSettings())


def test_what_moved_most():
    history = [{"a": 0.0, "b": 0.5}, {"a": 0.3, "b": 0.0}, {"a": 0.1, "b": 0.2}]
    assert most_moved(history) == ("b", 0.0, 0.5)
    assert most_moved([{"a": 0.1}, {"a": 0.2}]) is None
    assert most_moved([]) is None


def test_learning():
    """Move the device, touch the knob."""
    cable = Cable("Knobs")
    learn = MidiLearn("knobs", cable)
    assert learn.port_name == "Knobs"
    found = [learn.watch(one) for one in moved(np.linspace(0, -0.8, 50))]
    assert not any(found)
    cable.waiting = [b"\xf8", bytes([0xB4, 21, 77]), bytes([0xB4, 22, 1])]
    one = learn.watch(frame(51, controls={"bend": -0.8, "twist": 0.1}))
    assert one == MidiMapping("bend", cc=21, channel=5, low=-1)
    # Seconds later nothing has moved.
    cable.waiting = [bytes([0xB4, 21, 77])]
    assert learn.watch(frame(2000, controls={"bend": -0.8, "twist": 0.1})) is None
    learn.close()
    assert cable.opened[-1] == "closed"


def test_learning_a_key():
    history = [{"bend": 0.0}, {"bend": 0.9}]
    assert learned(history, bytes([0x90, 60, 100])) == MidiMapping("bend", note=60, channel=1)
    assert learned(history, bytes([0x90, 60, 0])) is None  # its end
    text = as_toml([MidiMapping("bend", note=60), MidiMapping("x", cc=3, low=-1, channel=2)])
    assert text == (
        '[outputs.midi]\nmapping = [\n  { control = "bend", note = 60, channel = 1 },\n'
        '  { control = "x", cc = 3, channel = 2, low = -1 },\n]\n'
    )


def test_what_was_mapped_before_is_kept_as_it_was(tmp_path):
    kept = MidiMapping("bend", note=60, high=0.7, threshold=0.1, hysteresis=0.05)
    (tmp_path / "x.toml").write_text(as_toml([kept]))
    assert read_live_file(tmp_path / "x.toml").outputs == (MidiSettings(mapping=(kept,)),)


def test_learning_while_it_plays(tmp_path, monkeypatch):
    """What is learned plays at once, and stands in a file that live.toml can take; another touch of
    a knob takes its place."""
    monkeypatch.setattr(midi_output, "_LOOK", 0.0)
    path = tmp_path / "learned.toml"
    cable = Cable("Synth", "Knobs")
    output = MidiOutput(MidiSettings(device="Synth", learn="Knobs", learned=str(path)), cable)
    assert "sends to 'Synth', learns from 'Knobs' into" in output.about
    for one in moved(np.linspace(0, 0.8, 30)):
        output.send(one)
    assert cable.sent == []
    cable.waiting = [bytes([0xB0, 7, 1])]
    output.send(frame(31, controls={"bend": 0.5, "twist": 0.0}))
    assert cable.sent == [(0xB0, 7, 64)]
    assert output.about.endswith("; bend plays control change 7 of channel 1 from now on")
    assert read_live_file(path).outputs == (MidiSettings(mapping=(MidiMapping("bend", cc=7),)),)
    for n in range(40):
        output.send(frame(1000 + n, controls={"bend": 0.5, "twist": n / 40}))
    cable.waiting = [bytes([0xB0, 7, 1])]
    output.send(frame(1040, controls={"bend": 0.5, "twist": 1.0}))
    assert cable.sent[-1] == (0xB0, 7, 127)
    assert read_live_file(path).outputs[0].mapping == (MidiMapping("twist", cc=7),)
    cable.there.remove("Knobs")
    with raises(OutputError, "port-disconnected", port="Knobs"):
        output.send(frame(1041))
    with raises(OutputError, "port-not-found", device="Knobs"):
        output.send(frame(1042))
    output.close()


def test_what_an_earlier_run_learned_stays(tmp_path):
    """As a MIDI file does; what this run wrote itself is written anew."""
    path = tmp_path / "learned.toml"
    path.write_text("mine")
    cable = Cable("Synth", "Knobs")
    output = MidiOutput(MidiSettings(device="Synth", learn="Knobs", learned=str(path)), cable)
    for begin, control, cc in ((0, "bend", 7), (1000, "twist", 8)):
        for n in range(40):
            output.send(frame(begin + n, controls={"bend": 0.0, "twist": 0.0, control: n / 40}))
        cable.waiting = [bytes([0xB0, cc, 1])]
        output.send(frame(begin + 40, controls={"bend": 0.0, "twist": 0.0, control: 1.0}))
    output.close()
    assert path.read_text("utf-8") == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["learned-2.toml", "learned.toml"]
    assert "into " + str(tmp_path / "learned-2.toml") in output.about
    (live,) = read_live_file(tmp_path / "learned-2.toml").outputs
    assert [one.control for one in live.mapping] == ["bend", "twist"]


def test_the_instrument_of_a_channel_that_is_learned(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cable = Cable("Synth", "Knobs")
    output = MidiOutput(MidiSettings(device="Synth", learn="Knobs", program=19), cable)
    output.send(frame(0, controls={"bend": 0.0}))
    assert cable.sent == []
    cable.waiting = [bytes([0xB4, 7, 1])]
    output.send(frame(1, controls={"bend": 1.0}))
    assert cable.sent == [(0xC4, 19), (0xB4, 7, 127)]


def test_looking_for_a_port_leaves_nothing_behind(tmp_path):
    """An input that is not plugged in is looked for again and again."""
    cable = Cable("Synth")
    for where in ({"file": str(tmp_path / "x.mid")}, {"virtual": "DefSense"}):
        with raises(OutputError, "port-not-found", device="Knobs", inputs=True):
            MidiOutput(MidiSettings(learn="Knobs", **where), cable)
    assert list(tmp_path.iterdir()) == []
    assert cable.opened == [("DefSense", False, True), "closed"]
    cable.there.append("Knobs")
    with pytest.raises(StorageError):
        MidiOutput(MidiSettings(learn="Knobs", file=str(tmp_path / "none" / "x.mid")), cable)
    assert cable.opened[2:] == [("Knobs", True, False), "closed"]


def test_learning_from_garbage():
    history, rng = [{"bend": 0.0}, {"bend": 0.9}], np.random.default_rng(0)
    for _ in range(3000):
        message = rng.bytes(rng.integers(0, 5))
        one = learned(history, message)
        if one is not None:
            assert message[0] & 0xF0 in (0x90, 0xB0)
            assert len(message) == 3
