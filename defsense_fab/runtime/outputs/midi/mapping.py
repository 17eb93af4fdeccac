"""Controls to MIDI messages: control changes, and notes where a threshold is crossed."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from ...frames.live_frame import LiveFrame
from ..output import signals_of
from ..settings import MidiMapping

NOTE_OFF, NOTE_ON, CONTROL_CHANGE = 0x80, 0x90, 0xB0

#: Control changes that MIDI leaves undefined, in which nothing else listens.
FREE = (*range(20, 32), *range(85, 91), *range(102, 119))
QUALITY = 119

_WINDOW = 0.1  # s over which a note's speed is taken
_SOFTEST = 40  # of 127, 20 dB below the loudest on most synthesisers: the slowest is heard, too
_FULL_SPEED = 4.0  # of the range per second: the loudest, as of a hand that is in a hurry


def default_mapping(frame: LiveFrame, channel: int = 1) -> list[MidiMapping]:
    """The controls in their order become undefined control changes of a `channel` (1..16); the
    quality is the last. The frame has all controls (`controls_known`)."""
    names = [name for name in frame.controls if name != "quality"]
    out = [MidiMapping(name, cc, channel=channel) for name, cc in zip(names, FREE, strict=False)]
    return [*out, MidiMapping("quality", QUALITY, channel=channel)]


@dataclass
class _State:
    """Of one mapping: what was sent last, whether its note sounds or may sound, and values
    (s, 0..1) of late."""

    sent: int | None = None
    sounds: bool = False
    late: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=200))


class MidiMapper:
    """Turns frames into messages, each only when it changes. A message counts as sent when the next
    one is asked for: where sending it raises, `silence` still ends the notes that may sound."""

    def __init__(self, mapping: Sequence[MidiMapping]) -> None:
        self._states = [(one, _State()) for one in mapping]

    def messages(self, frame: LiveFrame) -> Iterator[bytes]:
        """Three bytes each. Controls that the frame does not have are left out."""
        values = signals_of(frame)
        for one, state in self._states:
            if one.control not in values:
                continue
            value = values[one.control]
            scaled = (value - one.low) / (one.high - one.low)
            if one.cc is not None:
                number = round(127 * min(max(scaled, 0.0), 1.0))
                if number != state.sent:
                    yield bytes([CONTROL_CHANGE | (one.channel - 1), one.cc, number])
                    state.sent = number
            else:
                yield from _note(one, state, value, scaled, frame.time)

    def silence(self) -> Iterator[bytes]:
        """Ends the notes that sound or may sound."""
        for one, state in self._states:
            if state.sounds and one.note is not None:
                yield bytes([NOTE_OFF | (one.channel - 1), one.note, 0])
                state.sounds = False


def _note(
    one: MidiMapping, state: _State, value: float, scaled: float, time: float
) -> Iterator[bytes]:
    late = state.late
    if late and time < late[-1][0]:  # the board was reset
        late.clear()
    while len(late) > 1 and late[0][0] < time - _WINDOW:
        late.popleft()
    late.append((time, scaled))
    assert one.note is not None
    if not state.sounds and value > one.threshold:
        state.sounds = True  # even where sending it fails half-way
        yield bytes([NOTE_ON | (one.channel - 1), one.note, _velocity(late)])
    elif state.sounds and value < one.threshold - one.hysteresis:
        yield bytes([NOTE_OFF | (one.channel - 1), one.note, 0])
        state.sounds = False


def _velocity(late: deque[tuple[float, float]]) -> int:
    """Of a note, up to 127 by the root of the speed, as hands are slow beside keys; in between
    where nothing is known of it."""
    (begin, first), (end, last) = late[0], late[-1]
    if end <= begin:
        return 64
    speed = abs(last - first) / (end - begin)
    return round(_SOFTEST + (127 - _SOFTEST) * math.sqrt(min(1.0, speed / _FULL_SPEED)))
