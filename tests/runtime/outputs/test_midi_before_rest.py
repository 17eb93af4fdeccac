"""Before the resistances at rest are known, no mapping is chosen and no control is missed."""

from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.outputs.midi_output import MidiOutput
from defsense_fab.runtime.outputs.settings import MidiMapping, MidiSettings
from tests.runtime.live_frames import frame, frame_before_rest
from tests.runtime.outputs.midi_cable import Cable


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
