"""What each output can be told; nothing here needs another library."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.errors import OutputError

_FEWEST = 16  # characters of a token
_LONGEST_NAME = 79  # bytes, of a gamepad in Linux


@dataclass(frozen=True)
class OscSettings:
    """UDP to `host`: what `send` names, in bundles to `port`; "wekinator" alone goes to
    `wekinator_port`, as that program expects it. "touchosc" is of the faders on that `page`. `rate`
    (Hz) is the most, 0 no limit."""

    host: str = "127.0.0.1"
    port: int = 9000
    wekinator_port: int = 6448
    page: int = 1
    send: tuple[str, ...] = ("controls", "markers", "quality", "wekinator")
    rate: float = 0.0

    SENDS = ("controls", "confidence", "markers", "quality", "wekinator", "touchosc")

    def __post_init__(self) -> None:
        _port("port", self.port)
        _port("wekinator_port", self.wekinator_port)
        if not 1 <= self.page <= 999:
            raise OutputError(f"page must lie between 1 and 999, not {self.page}")
        _words("send", self.send, self.SENDS)
        _rate(self.rate)


@dataclass(frozen=True)
class WebSocketSettings:
    """Listens on `host` and `port` (0: any that is free) for at most `max_clients`. A host other
    than this machine needs a `token`, which is made where none is given."""

    host: str = "127.0.0.1"
    port: int = 8765
    token: str = ""
    max_clients: int = 32
    markers: bool = True
    rate: float = 60.0

    def __post_init__(self) -> None:
        if self.port:
            _port("port", self.port)
        if self.token and (len(self.token) < _FEWEST or not self.token.isascii()):
            raise OutputError(f"token needs at least {_FEWEST} plain characters")
        if not 1 <= self.max_clients <= 1000:
            raise OutputError(f"max_clients must lie between 1 and 1000, not {self.max_clients}")
        _rate(self.rate)


@dataclass(frozen=True)
class MidiMapping:
    """`control` becomes the control change `cc`, or plays `note` when it rises above `threshold`
    until it falls below by `hysteresis`, on a `channel` 1..16. `low` and `high` are the control's
    values for 0 and 127; a note is the louder the quicker they were crossed."""

    control: str
    cc: int | None = None
    note: int | None = None
    channel: int = 1
    low: float = 0.0
    high: float = 1.0
    threshold: float = 0.5
    hysteresis: float = 0.1

    def __post_init__(self) -> None:
        number = self.cc if self.cc is not None else self.note
        if (self.cc is None) == (self.note is None) or number is None:
            raise OutputError(f"control {self.control!r} needs either cc or note")
        if not 0 <= number <= (119 if self.cc is not None else 127):
            # 120 to 127 are mode messages: all sound off, reset and the like.
            raise OutputError("cc must lie between 0 and 119, note between 0 and 127")
        _channel(self.channel)
        if self.low == self.high:
            raise OutputError("low and high must differ")
        if self.hysteresis < 0:
            raise OutputError("hysteresis must not be negative")

    @property
    def place(self) -> str:
        """In words."""
        what = f"control change {self.cc}" if self.cc is not None else f"note {self.note}"
        return f"{what} of channel {self.channel}"


@dataclass(frozen=True)
class MidiSettings:
    """To the first port whose name contains `device` ("": the first), to a `virtual` port of this
    name that others connect to, or into a Standard MIDI `file`. Without `mapping` the controls
    become the control changes from 20 on, of the `channel`. `learn` is part of an input's name,
    from whose knobs and keys mappings are learned; they are written to the file `learned`.
    `program` is the instrument of the channels in use, as General MIDI counts from 0 (19: church
    organ)."""

    device: str = ""
    virtual: str = ""
    file: str = ""
    learn: str = ""
    learned: str = "midi-learned.toml"
    mapping: tuple[MidiMapping, ...] = ()
    channel: int = 1
    program: int | None = None
    rate: float = 200.0

    def __post_init__(self) -> None:
        if self.program is not None and not 0 <= self.program <= 127:
            raise OutputError(f"program must lie between 0 and 127, not {self.program}")
        if sum(map(bool, (self.device, self.virtual, self.file))) > 1:
            raise OutputError("give one of device, virtual and file")
        _channel(self.channel)
        _rate(self.rate)


@dataclass(frozen=True)
class LslSettings:
    """A stream by this `stream` name ("": the device's), with what `send` names as channels."""

    stream: str = ""
    send: tuple[str, ...] = ("controls", "quality")
    rate: float = 0.0

    SENDS = ("controls", "confidence", "markers", "signals", "quality")

    def __post_init__(self) -> None:
        _words("send", self.send, self.SENDS)
        _rate(self.rate)


@dataclass(frozen=True)
class GamepadMapping:
    """`control` moves `axis`, or holds `button` while it is above `threshold`."""

    control: str
    axis: str = ""
    button: str = ""
    threshold: float = 0.5

    AXES = ("x", "y", "z", "rx", "ry", "rz")
    BUTTONS = ("south", "east", "north", "west", "tl", "tr", "select", "start")

    def __post_init__(self) -> None:
        if bool(self.axis) == bool(self.button):
            raise OutputError(f"control {self.control!r} needs either axis or button")
        if self.axis:
            _words("axis", (self.axis,), self.AXES)
        else:
            _words("button", (self.button,), self.BUTTONS)


@dataclass(frozen=True)
class GamepadSettings:
    """Without `mapping` the controls become the axes x, y, rx, ry, z, rz in their order. Games see
    it by its `name`."""

    mapping: tuple[GamepadMapping, ...] = ()
    name: str = "DefSense gamepad"
    rate: float = 0.0

    def __post_init__(self) -> None:
        if not 1 <= len(self.name.encode()) <= _LONGEST_NAME:
            raise OutputError(f"name must have from 1 to {_LONGEST_NAME} bytes")
        _rate(self.rate)


#: By the name of the table in [outputs].
Settings = OscSettings | WebSocketSettings | MidiSettings | LslSettings | GamepadSettings
KINDS: dict[str, type[Settings]] = {
    "osc": OscSettings,
    "websocket": WebSocketSettings,
    "midi": MidiSettings,
    "lsl": LslSettings,
    "gamepad": GamepadSettings,
}


def _port(key: str, port: int) -> None:
    if not 1 <= port <= 65535:
        raise OutputError(f"{key} must lie between 1 and 65535, not {port}")


def _channel(channel: int) -> None:
    if not 1 <= channel <= 16:
        raise OutputError(f"channel must lie between 1 and 16, not {channel}")


def _rate(rate: float) -> None:
    if not 0 <= rate <= 10_000:
        raise OutputError(f"rate must lie between 0 (no limit) and 10000 Hz, not {rate:g}")


def _words(key: str, given: tuple[str, ...], allowed: tuple[str, ...]) -> None:
    for word in given:
        if word not in allowed:
            raise OutputError(f"{key} has {word!r}; there is: {', '.join(allowed)}")
    if not given or len(set(given)) != len(given):
        raise OutputError(f"{key} must name at least one of {', '.join(allowed)}, each once")
