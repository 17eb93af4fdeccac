"""Controls to MIDI messages: control changes, and notes where a threshold is crossed."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ..frames.live_frame import LiveFrame
from .midi_ports import MidiPorts, find_port
from .output import signals_of
from .settings import MidiMapping

# Learn mode: move the device, touch the knob or key that it shall play.

_WINDOW_MIDI_LEARN = 4.0  # s of movement that count
_LEAST = 0.2  # of a control's range that has to be moved
_BELOW = -0.1  # of a control that reaches below: it goes to both sides


def most_moved(history: Sequence[Mapping[str, float]]) -> tuple[str, float, float] | None:
    """Of controls over time, the one that moved most, with its least and greatest value; None where
    none moved by a fifth of its range."""
    best: tuple[str, float, float] | None = None
    for name in history[-1] if history else ():
        values = [h[name] for h in history if name in h]
        low, high = min(values), max(values)
        if high - low > max(_LEAST, best[2] - best[1] if best else 0.0):
            best = (name, low, high)
    return best


def learned(history: Sequence[Mapping[str, float]], message: bytes) -> MidiMapping | None:
    """What moved most goes where `message` comes from: the control change of a knob, or the note of
    a key. None of other messages, and where nothing moved."""
    moved = most_moved(history)
    # Whole messages of three bytes, of which only the first has its high bit set.
    if moved is None or len(message) != 3 or message[0] < 0x80 or max(message[1:]) > 0x7F:
        return None
    name, low, _ = moved
    kind, channel = message[0] & 0xF0, (message[0] & 0x0F) + 1
    least = -1.0 if low < _BELOW else 0.0
    if kind == CONTROL_CHANGE and message[1] < 120:
        return MidiMapping(name, cc=message[1], channel=channel, low=least)
    if kind == NOTE_ON and message[2] > 0:
        return MidiMapping(name, note=message[1], channel=channel, low=least)
    return None


def as_toml(mapping: Sequence[MidiMapping]) -> str:
    """The table for `live.toml` that says this."""
    rows = []
    for one in mapping:
        defaults = MidiMapping(one.control, one.cc, one.note)
        what = f"cc = {one.cc}" if one.cc is not None else f"note = {one.note}"
        rest = "".join(
            f", {key} = {getattr(one, key)!r}"
            for key in ("low", "high", "threshold", "hysteresis")
            if getattr(one, key) != getattr(defaults, key)
        )
        rows.append(f'  {{ control = "{one.control}", {what}, channel = {one.channel}{rest} }},\n')
    return f"[outputs.midi]\nmapping = [\n{''.join(rows)}]\n"


def merged(mapping: Sequence[MidiMapping], new: MidiMapping) -> list[MidiMapping]:
    """What was learned takes the place of what its knob or key played before."""
    place = (new.channel, new.cc, new.note)
    return [*(one for one in mapping if (one.channel, one.cc, one.note) != place), new]


class MidiLearn:
    """Watches frames and a MIDI input."""

    def __init__(self, device: str, ports: MidiPorts) -> None:
        """Listens to the first input whose name contains `device`. Raises OutputError."""
        self.port_name = find_port(ports, device, inputs=True)
        self._port = ports.open(self.port_name, inputs=True)
        self._frames: deque[tuple[float, Mapping[str, float]]] = deque(maxlen=10_000)

    def watch(self, frame: LiveFrame) -> MidiMapping | None:
        """What was learned since the last frame, if anything."""
        if self._frames and frame.time < self._frames[-1][0]:
            self._frames.clear()
        self._frames.append((frame.time, frame.controls))
        while self._frames[0][0] < frame.time - _WINDOW_MIDI_LEARN:
            self._frames.popleft()
        history = [controls for _, controls in self._frames]
        found = (learned(history, message) for message in self._port.pending())
        return next((one for one in found if one is not None), None)

    def close(self) -> None:
        self._port.close()


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
