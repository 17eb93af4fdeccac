"""While the resistances at rest are not known there are no controls: nothing is chosen by that."""

from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.outputs.midi_output import MidiOutput
from defsense_fab.runtime.outputs.settings import MidiMapping, MidiSettings
from tests.runtime.live_frames import frame, frame_before_rest
from tests.runtime.outputs.midi_cable import Cable


def test_a_mapping_is_chosen_once_there_are_controls():
    cable = Cable("Synth")
    output = MidiOutput(MidiSettings(program=19), cable)
    for n in range(3):
        output.send(frame_before_rest(n))
    assert cable.sent == []
    output.send(frame(4, quality=Quality.LOST))
    assert cable.sent == [(0xC0, 19), (0xB0, 20, 32), (0xB0, 21, 0), (0xB0, 119, 0)]


def test_a_device_without_poses_sends_its_quality():
    cable = Cable("Synth")
    output = MidiOutput(MidiSettings(), cable)
    output.send(frame_before_rest(1))
    assert cable.sent == []
    output.send(frame_before_rest(2, quality=Quality.FALLBACK))
    output.send(frame_before_rest(3))
    assert cable.sent == [(0xB0, 119, 42), (0xB0, 119, 0)]


def test_controls_that_are_not_there_yet_are_not_missed():
    output = MidiOutput(MidiSettings(mapping=(MidiMapping("bend", cc=1),)), Cable("Synth"))
    output.send(frame_before_rest(1))
    assert output.trouble is None
    output.send(frame(2))
    assert output.trouble is None


def test_controls_that_will_never_be_there_are():
    """Of a device without poses; that it is lost for a while changes nothing."""
    output = MidiOutput(MidiSettings(mapping=(MidiMapping("bend", cc=1),)), Cable("Synth"))
    for one in (frame_before_rest(1, quality=Quality.TRUSTED), frame_before_rest(2)):
        output.send(one)
        assert output.trouble == "midi: there is no control 'bend'; mappings can name: quality"


def test_a_quality_that_is_mapped_is_sent_from_the_first_frame():
    cable = Cable("Synth")
    mapping = (MidiMapping("quality", cc=119), MidiMapping("bend", cc=1))
    MidiOutput(MidiSettings(mapping=mapping), cable).send(frame_before_rest(1))
    assert cable.sent == [(0xB0, 119, 0)]
