"""MIDI output: files are read by mido, devices are unplugged, failed sends are repeated."""

import sys

import mido
import numpy as np
import pytest

from defsense_fab.core.errors import OutputError, StorageError
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.outputs import midi_output, midi_ports
from defsense_fab.runtime.outputs.live_file import read_live_file
from defsense_fab.runtime.outputs.midi_output import MidiFile, MidiOutput
from defsense_fab.runtime.outputs.midi_ports import SystemPorts, find_port
from defsense_fab.runtime.outputs.settings import MidiMapping, MidiSettings
from tests.runtime.live_frames import frame, frame_before_rest
from tests.runtime.outputs.midi_cable import Cable, moved
from tests.support.errors import raises

ON, OFF = (0x90, 60), (0x80, 60, 0)
MAPPING = (MidiMapping("bend", note=60, threshold=0.5), MidiMapping("bend", cc=20))


@pytest.mark.parametrize(
    ("last", "command"),
    [
        ((3, 99), 'pip install "defsense-fab[midi]"'),
        ((3, 0), "pip install python-rtmidi"),
    ],
)
def test_missing_package_is_reported(monkeypatch, tmp_path, last, command):
    """The extra is named if it has a wheel for this Python, else the package to compile."""
    monkeypatch.setattr(midi_ports, "_ALSA_SEQUENCER", tmp_path)
    monkeypatch.setattr(midi_ports, "_LAST_PYTHON_WITH_WHEEL", last)
    monkeypatch.setitem(sys.modules, "rtmidi", None)
    with raises(OutputError, "library-missing") as caught:
        SystemPorts().names(inputs=False)
    assert command in str(caught.value)


def test_file_is_read_by_mido(tmp_path):
    settings = MidiSettings(
        file=str(tmp_path / "x.mid"),
        mapping=(MidiMapping("bend", cc=20), MidiMapping("bend", note=64, channel=2)),
    )
    output = MidiOutput(settings)
    for one in moved([0, 0.4, 0.8, 0.8]):
        output.send(one)
    assert str(tmp_path / "x.mid") in output.about
    output.close()
    read = mido.MidiFile(tmp_path / "x.mid", clip=False)
    assert (read.type, len(read.tracks)) == (0, 1)
    assert read.tracks[0].name == "defsense"
    notes = [(m.type, round(m.time, 3)) for m in read if not m.is_meta]
    assert [kind for kind, _ in notes] == ["control_change"] * 3 + ["note_on", "note_off"]
    assert read.length == pytest.approx(0.03, abs=0.002)
    assert [m.value for m in read if m.type == "control_change"] == [0, 51, 102]


def test_file_is_complete_after_each_flush(tmp_path):
    """Its bytes are those of the format."""
    file = MidiFile(tmp_path / "x.mid", "t")
    empty = (tmp_path / "x.mid").read_bytes()
    assert empty.hex(" ") == (
        "4d 54 68 64 00 00 00 06 00 00 00 01 01 e0 "
        "4d 54 72 6b 00 00 00 09 00 ff 03 01 74 00 ff 2f 00"
    )
    file.add(bytes([0xB0, 20, 5]), 10.0)
    file.add(bytes([0xB0, 20, 6]), 10.5)  # 480 ticks: 0x83 0x60
    file.add(bytes([0xB0, 20, 7]), 3.0)  # the clock went back
    assert (tmp_path / "x.mid").read_bytes() == empty
    file.flush()
    now = (tmp_path / "x.mid").read_bytes()
    assert now[31 - 4 :].hex(" ") == "00 b0 14 05 83 60 b0 14 06 00 b0 14 07 00 ff 2f 00"
    assert int.from_bytes(now[18:22], "big") == len(now) - 22
    file.close()
    assert (tmp_path / "x.mid").read_bytes() == now
    other = MidiFile(tmp_path / "x.mid", "t")
    other.close()
    assert other.path.name == "x-2.mid"
    assert (tmp_path / "x.mid").read_bytes() == now
    with raises(StorageError, "file-not-found"):
        MidiFile(tmp_path / "none" / "x.mid", "t")


def test_default_mapping():
    cable = Cable("Synth")
    output = MidiOutput(MidiSettings(), cable)
    output.send(frame(1, quality=Quality.UNTRAINED))
    assert cable.sent == [(0xB0, 20, 32), (0xB0, 21, 0), (0xB0, 119, 85)]
    assert output.trouble is None
    many = frame(2, controls={f"c{n}": 1.0 for n in range(60)})
    other = MidiOutput(MidiSettings(), Cable("Synth"))
    other.send(many)  # only 36 control changes are free


def test_unknown_control_is_reported():
    output = MidiOutput(MidiSettings(mapping=(MidiMapping("bnd", cc=1),)), Cable("Synth"))
    output.send(frame(1))
    assert output.trouble.code == "unknown-control"
    assert output.trouble.data == {"controls": ["bnd"], "known": ["quality", "bend", "twist"]}


def test_device_is_unplugged_and_comes_back(monkeypatch):
    """It is reported, and receives all values when it is back; its notes do not hang."""
    monkeypatch.setattr(midi_output, "_CHECK_INTERVAL_S", 0.0)
    cable = Cable("Thru", "USB Synth 1")
    settings = MidiSettings(device="synth", mapping=(MidiMapping("bend", note=60, threshold=0.2),))
    output = MidiOutput(settings, cable)
    assert "USB Synth 1" in output.about
    output.send(frame(1))
    assert cable.sent == [(0x90, 60, 64)]
    cable.plugged.remove("USB Synth 1")
    with raises(OutputError, "port-disconnected", port="USB Synth 1"):
        output.send(frame(2))
    with raises(OutputError, "port-not-found", device="synth", inputs=False):
        output.send(frame(3))
    cable.plugged.append("USB Synth 1")
    output.send(frame(4))
    # The device may have kept its power, and its note may still sound.
    assert cable.sent == [(0x90, 60, 64), (0x80, 60, 0), (0x90, 60, 64)]
    output.close()
    assert cable.sent[-1] == (0x80, 60, 0)
    assert cable.opened == [
        ("USB Synth 1", False, False), "closed", ("USB Synth 1", False, False), "closed"
    ]  # fmt: skip


def test_program_is_sent_once_for_each_channel():
    cable = Cable("Synth")
    mapping = (MidiMapping("bend", cc=7), MidiMapping("twist", cc=8, channel=3))
    output = MidiOutput(MidiSettings(program=19, mapping=mapping), cable)
    output.send(frame(1))
    output.send(frame(2))
    assert cable.sent[:2] == [(0xC0, 19), (0xC2, 19)]
    assert sum(message[0] >> 4 == 0xC for message in cable.sent) == 2
    with pytest.raises(OutputError):
        MidiSettings(program=128)


def test_virtual_port():
    cable = Cable()
    output = MidiOutput(MidiSettings(virtual="DefSense"), cable)
    output.send(frame(1))
    assert cable.opened == [("DefSense", False, True)]
    assert cable.sent


def test_machine_without_ports():
    with raises(OutputError, "port-not-found", inputs=True, ports=[]):
        find_port(Cable(), "", inputs=True)


def test_machine_without_midi(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(midi_ports, "_ALSA_SEQUENCER", tmp_path / "seq")
    with raises(OutputError, "midi-unavailable"):
        SystemPorts().names(inputs=False)
    with raises(OutputError, "midi-unavailable"):
        MidiOutput(MidiSettings())


def test_learning_while_playing(tmp_path, monkeypatch):
    """A learned mapping plays at once and is written to a file; a second touch replaces it."""
    monkeypatch.setattr(midi_output, "_CHECK_INTERVAL_S", 0.0)
    path = tmp_path / "learned.toml"
    cable = Cable("Synth", "Knobs")
    output = MidiOutput(MidiSettings(device="Synth", learn="Knobs", learned=str(path)), cable)
    for one in moved(np.linspace(0, 0.8, 30)):
        output.send(one)
    assert cable.sent == []
    cable.waiting = [bytes([0xB0, 7, 1])]
    output.send(frame(31, controls={"bend": 0.5, "twist": 0.0}))
    assert cable.sent == [(0xB0, 7, 64)]
    assert read_live_file(path).outputs == (MidiSettings(mapping=(MidiMapping("bend", cc=7),)),)
    for n in range(40):
        output.send(frame(1000 + n, controls={"bend": 0.5, "twist": n / 40}))
    cable.waiting = [bytes([0xB0, 7, 1])]
    output.send(frame(1040, controls={"bend": 0.5, "twist": 1.0}))
    assert cable.sent[-1] == (0xB0, 7, 127)
    assert read_live_file(path).outputs[0].mapping == (MidiMapping("twist", cc=7),)
    cable.plugged.remove("Knobs")
    with raises(OutputError, "port-disconnected", port="Knobs"):
        output.send(frame(1041))
    with raises(OutputError, "port-not-found", device="Knobs"):
        output.send(frame(1042))
    output.close()


def test_mapping_of_an_earlier_run_is_kept(tmp_path):
    """Only the file of this run is rewritten."""
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
    (live,) = read_live_file(tmp_path / "learned-2.toml").outputs
    assert [one.control for one in live.mapping] == ["bend", "twist"]


def test_program_of_a_learned_channel(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cable = Cable("Synth", "Knobs")
    output = MidiOutput(MidiSettings(device="Synth", learn="Knobs", program=19), cable)
    output.send(frame(0, controls={"bend": 0.0}))
    assert cable.sent == []
    cable.waiting = [bytes([0xB4, 7, 1])]
    output.send(frame(1, controls={"bend": 1.0}))
    assert cable.sent == [(0xC4, 19), (0xB4, 7, 127)]


def test_failed_opening_leaves_nothing_behind(tmp_path):
    """An input that is not plugged in is searched repeatedly."""
    cable = Cable("Synth")
    for where in ({"file": str(tmp_path / "x.mid")}, {"virtual": "DefSense"}):
        with raises(OutputError, "port-not-found", device="Knobs", inputs=True):
            MidiOutput(MidiSettings(learn="Knobs", **where), cable)
    assert list(tmp_path.iterdir()) == []
    assert cable.opened == [("DefSense", False, True), "closed"]
    cable.plugged.append("Knobs")
    with raises(StorageError, "file-not-found"):
        MidiOutput(MidiSettings(learn="Knobs", file=str(tmp_path / "none" / "x.mid")), cable)
    assert cable.opened[2:] == [("Knobs", True, False), "closed"]


# Failed sends: no note hangs, and lost messages are sent again.


@pytest.fixture
def cable():
    return Cable("Synth")


@pytest.fixture
def output(cable):
    return MidiOutput(MidiSettings(mapping=MAPPING), cable)


def bent(number, bend):
    return frame(number, controls={"bend": bend}, confidence={})


def sent(output, cable, number, bend):
    """Send a frame and return the messages that arrive."""
    cable.sent.clear()
    output.send(bent(number, bend))
    return cable.sent


def fail(output, cable, number, bend, messages=1):
    cable.fails = messages
    with pytest.raises(OSError, match="cable pulled"):
        output.send(bent(number, bend))


def test_end_of_a_note_is_sent_again(output, cable):
    assert sent(output, cable, 1, 0.8)[0][:2] == ON
    fail(output, cable, 2, 0.1)
    assert sent(output, cable, 3, 0.1) == [OFF, (0xB0, 20, 13)]
    assert sent(output, cable, 4, 0.1) == []


def test_end_of_a_note_is_sent_after_two_failures(output, cable):
    output.send(bent(1, 0.8))
    fail(output, cable, 2, 0.1)
    fail(output, cable, 3, 0.1)
    assert sent(output, cable, 4, 0.1)[0] == OFF


def test_note_that_may_sound_is_ended(output, cable):
    """Sending its start has failed, perhaps only at the last byte."""
    fail(output, cable, 1, 0.8)
    assert sent(output, cable, 2, 0.1)[0] == OFF
    fail(output, cable, 3, 0.8)
    again = sent(output, cable, 4, 0.8)
    assert again[0] == OFF
    assert again[1][:2] == ON


def test_note_ends_when_a_failed_output_is_closed(output, cable):
    output.send(bent(1, 0.8))
    fail(output, cable, 2, 0.1)
    cable.sent.clear()
    output.close()
    assert cable.sent == [OFF]


def test_control_changes_and_programs_are_sent_again(cable):
    settings = MidiSettings(program=19, mapping=(MidiMapping("bend", cc=20),))
    output = MidiOutput(settings, cable)
    fail(output, cable, 1, 0.5)
    assert sent(output, cable, 2, 0.5) == [(0xC0, 19), (0xB0, 20, 64)]
    fail(output, cable, 3, 1.0)
    assert sent(output, cable, 4, 1.0) == [(0xB0, 20, 127)]


# Before the resistances at rest are known, no mapping is chosen and no control is missed.


def test_default_mapping_waits_for_controls():
    cable = Cable("Synth")
    output = MidiOutput(MidiSettings(program=19), cable)
    for n in range(3):
        output.send(frame_before_rest(n))
    assert cable.sent == []
    output.send(frame(4, quality=Quality.LOST))
    assert cable.sent == [(0xC0, 19), (0xB0, 20, 32), (0xB0, 21, 0), (0xB0, 119, 0)]


def test_device_without_poses_sends_its_quality():
    cable = Cable("Synth")
    output = MidiOutput(MidiSettings(), cable)
    output.send(frame_before_rest(1))
    assert cable.sent == []
    output.send(frame_before_rest(2, quality=Quality.FALLBACK))
    output.send(frame_before_rest(3))
    assert cable.sent == [(0xB0, 119, 42), (0xB0, 119, 0)]


def test_future_controls_are_not_reported():
    output = MidiOutput(MidiSettings(mapping=(MidiMapping("bend", cc=1),)), Cable("Synth"))
    output.send(frame_before_rest(1))
    assert output.trouble is None
    output.send(frame(2))
    assert output.trouble is None


def test_controls_of_a_device_without_poses_are_reported():
    """They are reported even while the device is lost."""
    output = MidiOutput(MidiSettings(mapping=(MidiMapping("bend", cc=1),)), Cable("Synth"))
    for one in (frame_before_rest(1, quality=Quality.TRUSTED), frame_before_rest(2)):
        output.send(one)
        assert output.trouble.data == {"controls": ["bend"], "known": ["quality"]}


def test_mapped_quality_is_sent_from_the_first_frame():
    cable = Cable("Synth")
    mapping = (MidiMapping("quality", cc=119), MidiMapping("bend", cc=1))
    MidiOutput(MidiSettings(mapping=mapping), cable).send(frame_before_rest(1))
    assert cable.sent == [(0xB0, 119, 0)]
