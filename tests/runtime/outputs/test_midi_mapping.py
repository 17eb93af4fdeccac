"""Controls are mapped to MIDI messages; mappings are learned from knobs and keys."""

import numpy as np
import pytest

from defsense_fab.runtime.outputs.live_file import read_live_file
from defsense_fab.runtime.outputs.midi_mapping import (
    MidiLearn,
    MidiMapper,
    learn_mapping,
    mapping_toml,
    most_moved_control,
)
from defsense_fab.runtime.outputs.settings import MidiMapping, MidiSettings
from tests.runtime.live_frames import frame
from tests.runtime.outputs.midi_cable import Cable, moved


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


def test_garbage_is_not_learned():
    history, rng = [{"bend": 0.0}, {"bend": 0.9}], np.random.default_rng(0)
    for _ in range(3000):
        message = rng.bytes(rng.integers(0, 5))
        one = learn_mapping(history, message)
        if one is not None:
            assert message[0] & 0xF0 in (0x90, 0xB0)
            assert len(message) == 3
