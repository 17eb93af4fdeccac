"""After a failed send no note hangs, and lost messages are sent again."""

import pytest

from defsense_fab.runtime.outputs.midi_output import MidiOutput
from defsense_fab.runtime.outputs.settings import MidiMapping, MidiSettings
from tests.runtime.live_frames import frame
from tests.runtime.outputs.midi_cable import Cable

ON, OFF = (0x90, 60), (0x80, 60, 0)
MAPPING = (MidiMapping("bend", note=60, threshold=0.5), MidiMapping("bend", cc=20))


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
