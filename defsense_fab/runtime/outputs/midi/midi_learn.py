"""Learn mode: move the device, touch the knob or key that it shall play."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from ...frames.live_frame import LiveFrame
from ..settings import MidiMapping
from .mapping import CONTROL_CHANGE, NOTE_ON
from .ports import MidiPorts, find_port

_WINDOW = 4.0  # s of movement that count
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
        what = f"cc = {one.cc}" if one.cc is not None else f"note = {one.note}"
        rest = "".join(
            f", {key} = {getattr(one, key)!r}"
            for key in ("low", "high", "threshold", "hysteresis")
            if getattr(one, key) != getattr(MidiMapping, key)
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
        while self._frames[0][0] < frame.time - _WINDOW:
            self._frames.popleft()
        history = [controls for _, controls in self._frames]
        found = (learned(history, message) for message in self._port.pending())
        return next((one for one in found if one is not None), None)

    def close(self) -> None:
        self._port.close()
