"""Map controls to MIDI messages, and learn mappings from the knobs and keys of a MIDI input."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ..frames.live_frame import LiveFrame
from .midi_ports import SystemPorts, find_port
from .output import mappable_values
from .settings import MidiMapping

NOTE_OFF, NOTE_ON, CONTROL_CHANGE = 0x80, 0x90, 0xB0
_FIRST_MODE_MESSAGE = 120  # control changes from here on are mode messages

#: Control changes that MIDI leaves undefined, so that no other receiver reacts to them.
FREE = (*range(20, 32), *range(85, 91), *range(102, 119))
#: Control change of the quality.
QUALITY = 119

_SPEED_WINDOW_S = 0.1  # over which the speed of a note is measured
_MIN_VELOCITY = 40  # 20 dB below the loudest on most synthesizers: slow notes can be heard, too
_MAX_SPEED = 4.0  # of the range per second, for the loudest note: that of a hand in a hurry

_LEARN_WINDOW_S = 4.0  # of movement that counts
_MIN_LEARN_RANGE = 0.2  # of a control's range that must be moved
_MAX_NEGATIVE = -0.1  # controls that go below it are mapped in both directions


def default_mapping(frame: LiveFrame, channel: int = 1) -> list[MidiMapping]:
    """Map the controls, in their order, to undefined control changes; the quality comes last.

    Args:
        frame: A frame with all controls.
        channel: MIDI channel, 1 to 16.
    """
    names = [name for name in frame.controls if name != "quality"]
    mapping = [
        MidiMapping(name, cc, channel=channel) for name, cc in zip(names, FREE, strict=False)
    ]
    return [*mapping, MidiMapping("quality", QUALITY, channel=channel)]


@dataclass
class _State:
    """State of one mapping.

    Attributes:
        last_value: Value that was sent last, or None.
        may_sound: Whether its note sounds or may sound.
        recent: Recent times, s, and values, 0..1.
    """

    last_value: int | None = None
    may_sound: bool = False
    recent: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=200))


class MidiMapper:
    """Convert frames to messages, each only when its value changes.

    A message counts as sent when the next one is requested. If sending it raises, `silence` still
    ends the notes that may sound.

    Args:
        mapping: What each control becomes.
    """

    def __init__(self, mapping: Sequence[MidiMapping]) -> None:
        self._states = [(entry, _State()) for entry in mapping]

    def messages(self, frame: LiveFrame) -> Iterator[bytes]:
        """Yield the messages of a frame; controls that it does not have are left out."""
        values = mappable_values(frame)
        for entry, state in self._states:
            if entry.control not in values:
                continue
            value = values[entry.control]
            scaled = (value - entry.low) / (entry.high - entry.low)
            if entry.cc is not None:
                number = round(127 * min(max(scaled, 0.0), 1.0))
                if number != state.last_value:
                    yield bytes([CONTROL_CHANGE | (entry.channel - 1), entry.cc, number])
                    state.last_value = number
            else:
                yield from _note_messages(entry, state, value, scaled, frame.time)

    def silence(self) -> Iterator[bytes]:
        """Yield messages that end the notes that sound or may sound."""
        for entry, state in self._states:
            if state.may_sound and entry.note is not None:
                yield bytes([NOTE_OFF | (entry.channel - 1), entry.note, 0])
                state.may_sound = False


def _note_messages(
    entry: MidiMapping, state: _State, value: float, scaled: float, time: float
) -> Iterator[bytes]:
    recent = state.recent
    if recent and time < recent[-1][0]:  # the board was reset
        recent.clear()
    while len(recent) > 1 and recent[0][0] < time - _SPEED_WINDOW_S:
        recent.popleft()
    recent.append((time, scaled))
    assert entry.note is not None
    if not state.may_sound and value > entry.threshold:
        state.may_sound = True  # even if sending it fails half-way
        yield bytes([NOTE_ON | (entry.channel - 1), entry.note, _velocity(recent)])
    elif state.may_sound and value < entry.threshold - entry.hysteresis:
        yield bytes([NOTE_OFF | (entry.channel - 1), entry.note, 0])
        state.may_sound = False


def _velocity(recent: deque[tuple[float, float]]) -> int:
    """Return the velocity of a note, by the root of the speed: hands move slower than piano keys.

    It is a medium one if the speed is unknown.
    """
    (start, first), (end, last) = recent[0], recent[-1]
    if end <= start:
        return 64
    speed = abs(last - first) / (end - start)
    share = math.sqrt(min(1.0, speed / _MAX_SPEED))
    return round(_MIN_VELOCITY + (127 - _MIN_VELOCITY) * share)


def most_moved_control(
    history: Sequence[Mapping[str, float]],
) -> tuple[str, float, float] | None:
    """Return the control that moved most, with its smallest and largest value.

    Args:
        history: Values of the controls over time.

    Returns:
        None if no control moved by a fifth of its range.
    """
    best: tuple[str, float, float] | None = None
    for name in history[-1] if history else ():
        values = [h[name] for h in history if name in h]
        low, high = min(values), max(values)
        if high - low > max(_MIN_LEARN_RANGE, best[2] - best[1] if best else 0.0):
            best = (name, low, high)
    return best


def learn_mapping(history: Sequence[Mapping[str, float]], message: bytes) -> MidiMapping | None:
    """Map the control that moved most to the knob or key that a message comes from.

    Args:
        history: Values of the controls over time.
        message: A message from the input: the control change of a knob, or the note of a key.

    Returns:
        None for other messages, and if no control moved.
    """
    moved = most_moved_control(history)
    # Whole messages have three bytes, of which only the first has its high bit set.
    if moved is None or len(message) != 3 or message[0] < 0x80 or max(message[1:]) > 0x7F:
        return None
    name, smallest, _ = moved
    kind, channel = message[0] & 0xF0, (message[0] & 0x0F) + 1
    low = -1.0 if smallest < _MAX_NEGATIVE else 0.0
    if kind == CONTROL_CHANGE and message[1] < _FIRST_MODE_MESSAGE:
        return MidiMapping(name, cc=message[1], channel=channel, low=low)
    if kind == NOTE_ON and message[2] > 0:
        return MidiMapping(name, note=message[1], channel=channel, low=low)
    return None


def mapping_toml(mapping: Sequence[MidiMapping]) -> str:
    """Return a mapping as a table for `live.toml`."""
    rows = []
    for entry in mapping:
        defaults = MidiMapping(entry.control, entry.cc, entry.note)
        number = f"cc = {entry.cc}" if entry.cc is not None else f"note = {entry.note}"
        other = "".join(
            f", {key} = {getattr(entry, key)!r}"
            for key in ("low", "high", "threshold", "hysteresis")
            if getattr(entry, key) != getattr(defaults, key)
        )
        rows.append(
            f'  {{ control = "{entry.control}", {number}, channel = {entry.channel}{other} }},\n'
        )
    return f"[outputs.midi]\nmapping = [\n{''.join(rows)}]\n"


def merge_mapping(mapping: Sequence[MidiMapping], new: MidiMapping) -> list[MidiMapping]:
    """Add an entry in place of the former one of the same knob or key."""
    place = (new.channel, new.cc, new.note)
    others = (entry for entry in mapping if (entry.channel, entry.cc, entry.note) != place)
    return [*others, new]


class MidiLearn:
    """Learn mappings: move the device, then touch the knob or key that it shall play.

    Args:
        device: Part of the name of the input; empty for the first input.
        ports: The MIDI ports of the machine.

    Raises:
        OutputError: There is no such input.
    """

    def __init__(self, device: str, ports: SystemPorts) -> None:
        self.port_name = find_port(ports, device, inputs=True)
        self._port = ports.open(self.port_name, inputs=True)
        self._frames: deque[tuple[float, Mapping[str, float]]] = deque(maxlen=10_000)

    def watch(self, frame: LiveFrame) -> MidiMapping | None:
        """Return the mapping that was learned since the last frame, if any."""
        if self._frames and frame.time < self._frames[-1][0]:
            self._frames.clear()
        self._frames.append((frame.time, frame.controls))
        while self._frames[0][0] < frame.time - _LEARN_WINDOW_S:
            self._frames.popleft()
        history = [controls for _, controls in self._frames]
        learned = (learn_mapping(history, message) for message in self._port.pending())
        return next((entry for entry in learned if entry is not None), None)

    def close(self) -> None:
        """Close the input."""
        self._port.close()
