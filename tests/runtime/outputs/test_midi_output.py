"""MIDI: files are read by mido, devices are unplugged, mappings are learned."""

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
    learn_mapping,
    mapping_toml,
    most_moved_control,
)
from defsense_fab.runtime.outputs.midi_output import MidiFile, MidiOutput
from defsense_fab.runtime.outputs.midi_ports import SystemPorts, find_port
from defsense_fab.runtime.outputs.settings import MidiMapping, MidiSettings
from tests.runtime.live_frames import frame
from tests.runtime.outputs.midi_cable import Cable
from tests.support.errors import raises


def moved(values, **kwargs):
    """Return frames in which `bend` has these values, 10 ms apart."""
    return [frame(n, controls={"bend": v}, confidence={}, **kwargs) for n, v in enumerate(values)]


def sent_by(mapping, frames):
    mapper = MidiMapper([mapping])
    return [tuple(m) for f in frames for m in mapper.messages(f)]


def test_control_changes():
    """Values are scaled, limited, and sent on their channel when they change."""
    got = sent_by(MidiMapping("bend", cc=74, channel=3), moved([0, 0.5, 0.501, 2, 1, -1]))
    assert got == [(0xB2, 74, 0), (0xB2, 74, 64), (0xB2, 74, 127), (0xB2, 74, 0)]
    both = sent_by(MidiMapping("bend", cc=1, low=-1), moved([-1, 0, 1]))
    assert [m[2] for m in both] == [0, 64, 127]
    turned = sent_by(MidiMapping("bend", cc=1, low=1, high=0), moved([0, 1]))
    assert [m[2] for m in turned] == [127, 0]


def test_notes():
    """A note starts above the threshold and ends below the hysteresis; quick ones are louder."""
    one = MidiMapping("bend", note=60, channel=10, threshold=0.5, hysteresis=0.2)
    got = sent_by(one, moved([0, 0.4, 0.55, 0.45, 0.35, 0.6, 0.29, 0.2, 0.6]))
    assert [m[:2] for m in got] == [(0x99, 60), (0x89, 60), (0x99, 60)]
    slow, quick = (sent_by(one, moved(np.linspace(0, 1, n)))[0][2] for n in (200, 20))
    assert 40 < slow < quick <= 127
    assert slow == pytest.approx(40 + 87 * (0.5 / 4) ** 0.5, abs=4)  # 0.5 of the range per second
    slowest = sent_by(one, moved(np.linspace(0.49, 0.51, 200)))[0][2]
    assert slowest == pytest.approx(40 + 87 * (0.01 / 4) ** 0.5, abs=2)  # it can be heard
    assert sent_by(one, moved([0.9])) == [(0x99, 60, 64)]  # its speed is unknown


def test_reset_of_the_board():
    """Times that go back do not change the loudness of a note."""
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
def test_missing_package_is_reported(monkeypatch, tmp_path, last, told):
    """The extra is named if it has a wheel for this Python, else the package to compile."""
    monkeypatch.setattr(midi_ports, "_ALSA_SEQUENCER", tmp_path)
    monkeypatch.setattr(midi_ports, "_LAST_PYTHON_WITH_WHEEL", last)
    monkeypatch.setitem(sys.modules, "rtmidi", None)
    with raises(OutputError, "library-missing") as caught:
        SystemPorts().names(inputs=False)
    assert told in str(caught.value)


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


def test_most_moved_control():
    history = [{"a": 0.0, "b": 0.5}, {"a": 0.3, "b": 0.0}, {"a": 0.1, "b": 0.2}]
    assert most_moved_control(history) == ("b", 0.0, 0.5)
    assert most_moved_control([{"a": 0.1}, {"a": 0.2}]) is None
    assert most_moved_control([]) is None


def test_learning():
    """Move the device, then touch the knob."""
    cable = Cable("Knobs")
    learn = MidiLearn("knobs", cable)
    assert learn.port_name == "Knobs"
    found = [learn.watch(one) for one in moved(np.linspace(0, -0.8, 50))]
    assert not any(found)
    cable.waiting = [b"\xf8", bytes([0xB4, 21, 77]), bytes([0xB4, 22, 1])]
    one = learn.watch(frame(51, controls={"bend": -0.8, "twist": 0.1}))
    assert one == MidiMapping("bend", cc=21, channel=5, low=-1)
    # Seconds later no control has moved.
    cable.waiting = [bytes([0xB4, 21, 77])]
    assert learn.watch(frame(2000, controls={"bend": -0.8, "twist": 0.1})) is None
    learn.close()
    assert cable.opened[-1] == "closed"


def test_learning_a_key():
    history = [{"bend": 0.0}, {"bend": 0.9}]
    assert learn_mapping(history, bytes([0x90, 60, 100])) == MidiMapping("bend", note=60, channel=1)
    assert learn_mapping(history, bytes([0x90, 60, 0])) is None  # the end of a note
    text = mapping_toml([MidiMapping("bend", note=60), MidiMapping("x", cc=3, low=-1, channel=2)])
    assert text == (
        '[outputs.midi]\nmapping = [\n  { control = "bend", note = 60, channel = 1 },\n'
        '  { control = "x", cc = 3, channel = 2, low = -1 },\n]\n'
    )


def test_mapping_is_read_back(tmp_path):
    kept = MidiMapping("bend", note=60, high=0.7, threshold=0.1, hysteresis=0.05)
    (tmp_path / "x.toml").write_text(mapping_toml([kept]))
    assert read_live_file(tmp_path / "x.toml").outputs == (MidiSettings(mapping=(kept,)),)


def test_learning_while_playing(tmp_path, monkeypatch):
    """A learned mapping plays at once and is written to a file; a second touch replaces it."""
    monkeypatch.setattr(midi_output, "_CHECK_INTERVAL_S", 0.0)
    path = tmp_path / "learned.toml"
    cable = Cable("Synth", "Knobs")
    output = MidiOutput(MidiSettings(device="Synth", learn="Knobs", learned=str(path)), cable)
    assert output.learned_path == path
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
    assert output.learned_path == tmp_path / "learned-2.toml"
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


def test_garbage_is_not_learned():
    history, rng = [{"bend": 0.0}, {"bend": 0.9}], np.random.default_rng(0)
    for _ in range(3000):
        message = rng.bytes(rng.integers(0, 5))
        one = learn_mapping(history, message)
        if one is not None:
            assert message[0] & 0xF0 in (0x90, 0xB0)
            assert len(message) == 3
