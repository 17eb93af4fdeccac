"""Settings of each output of the live loop: the keys of `[outputs]` in `live.toml`.

Nothing here needs the library of an output.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar

from msgspec import Meta

from ...core.errors import OutputError
from ...core.schema.declare import NonNegative, Problem, Table, key
from ...core.schema.reader import validate

_MIN_TOKEN_LENGTH = 16  # characters
_MAX_NAME_BYTES = 79  # of a gamepad in Linux

_Port = Annotated[int, Meta(ge=1, le=65535)]
_PortOrAny = Annotated[int, Meta(ge=0, le=65535)]
_Channel = Annotated[int, Meta(ge=1, le=16)]
_MidiNumber = Annotated[int, Meta(ge=0, le=127)]
_Rate = Annotated[float, Meta(ge=0, le=10_000)]
_RATE = key("Largest rate of messages; 0 is no limit.", unit="Hz")


class OutputSettings(Table, frozen=True):
    """Base class of the settings of outputs.

    Raises:
        OutputError: if a value is not accepted; `data["key"]` names it.
    """

    def __post_init__(self) -> None:
        validate(self, OutputError)


class OscSettings(OutputSettings, frozen=True):
    """OSC messages over UDP: bundles with what `send` names go to `port`."""

    SENDS: ClassVar = ("controls", "confidence", "markers", "quality", "wekinator", "touchosc")

    host: Annotated[str, key("Address to send to: of a machine, or a broadcast address.")] = (
        "127.0.0.1"
    )
    port: Annotated[_Port, key("Port to send to.")] = 9000
    wekinator_port: Annotated[
        _Port, key("Port for `wekinator`, whose messages are in no bundle, as it expects.")
    ] = 6448
    page: Annotated[
        Annotated[int, Meta(ge=1, le=999)], key("Page of TouchOSC with the faders of `touchosc`.")
    ] = 1
    send: Annotated[tuple[str, ...], key("What is sent, each at most once.", choices=SENDS)] = (
        "controls",
        "markers",
        "quality",
        "wekinator",
    )
    immediate: Annotated[
        bool,
        key(
            "Whether bundles have the time tag *immediately* instead of the sample's time, for"
            " receivers whose clock is behind and that would wait until that time."
        ),
    ] = False
    rate: Annotated[_Rate, _RATE] = 0.0

    def check(self) -> Iterator[Problem]:
        """Yield a problem of `send`."""
        yield from _check_send(self.send, self.SENDS)


class WebSocketSettings(OutputSettings, frozen=True):
    """A WebSocket server for browsers and programs."""

    host: Annotated[
        str, key("Address to listen on; other machines reach it only with a `token`.")
    ] = "127.0.0.1"
    port: Annotated[_PortOrAny, key("Port to listen on; 0 is any that is free.")] = 8765
    token: Annotated[
        str,
        key(
            "Secret of at least 16 plain characters that clients must give.",
            default="a new one, where other machines can connect",
        ),
    ] = ""
    max_clients: Annotated[
        Annotated[int, Meta(ge=1, le=1000)], key("Largest number of clients at a time.")
    ] = 32
    markers: Annotated[bool, key("Whether the positions of the markers are sent.")] = True
    rate: Annotated[_Rate, _RATE] = 60.0

    def check(self) -> Iterator[Problem]:
        """Yield a problem of a token that is too weak."""
        if self.token and (len(self.token) < _MIN_TOKEN_LENGTH or not self.token.isascii()):
            text = f"needs at least {_MIN_TOKEN_LENGTH} plain characters"
            yield Problem(("token",), text, "token-too-weak", "Use a longer one")


class MidiMapping(OutputSettings, frozen=True):
    """What a control becomes in MIDI: a control change, or a note."""

    control: Annotated[str, key("Name of the control.")]
    cc: Annotated[
        # 120 to 127 are mode messages: all sound off, reset and the like.
        Annotated[int, Meta(ge=0, le=119)] | None,
        key("Number of the control change.", default="this or `note`"),
    ] = None
    note: Annotated[
        _MidiNumber | None,
        key(
            "Number of the note, which sounds from the moment the control rises above `threshold`;"
            " the faster it rises, the louder.",
            default="this or `cc`",
        ),
    ] = None
    channel: Annotated[_Channel, key("Channel.")] = 1
    low: Annotated[float, key("Value of the control for 0.")] = 0.0
    high: Annotated[float, key("Value of the control for 127.")] = 1.0
    threshold: Annotated[float, key("Value of the control at which the note starts.")] = 0.5
    hysteresis: Annotated[
        NonNegative, key("How far the control must fall below `threshold` for the note to end.")
    ] = 0.1

    def check(self) -> Iterator[Problem]:
        """Yield problems of keys that exclude each other."""
        if (self.cc is None) == (self.note is None):
            text = f"control {self.control!r} needs either cc or note"
            yield Problem((), text, "keys-exclusive", "Give one of them")
        if self.low == self.high:
            yield Problem(("low",), "must differ from high", "out-of-range", "Change one of them")

    @property
    def place(self) -> str:
        """What is played, in words."""
        what = f"control change {self.cc}" if self.cc is not None else f"note {self.note}"
        return f"{what} of channel {self.channel}"


class MidiSettings(OutputSettings, frozen=True):
    """MIDI to a port or into a file."""

    device: Annotated[
        str,
        key(
            "Part of the name of the port to send to; not with `virtual` or `file`.",
            default="the first port",
        ),
    ] = ""
    virtual: Annotated[
        str, key("Name of a new port, to which other programs connect.", default="none")
    ] = ""
    file: Annotated[str, key("Standard MIDI file to write.", default="none")] = ""
    learn: Annotated[
        str,
        key("Part of the name of an input, whose knobs and keys are learned.", default="none"),
    ] = ""
    learned: Annotated[str, key("File for the mappings that were learned.")] = "midi-learned.toml"
    mapping: Annotated[
        tuple[MidiMapping, ...],
        key(
            "What each control becomes.",
            default="the controls in their order become the control changes from 20 on",
        ),
    ] = ()
    channel: Annotated[
        _Channel, key("Channel; not with `mapping` or `learn`, which have channels.")
    ] = 1
    program: Annotated[
        _MidiNumber | None,
        key(
            "Instrument of the channels in use, as General MIDI counts from 0 (19: church organ).",
            default="as the receiver has it",
        ),
    ] = None
    rate: Annotated[_Rate, _RATE] = 200.0

    def check(self) -> Iterator[Problem]:
        """Yield a problem of destinations that exclude each other."""
        given = [name for name in ("device", "virtual", "file") if getattr(self, name)]
        if len(given) > 1:
            text = f"{' and '.join(given)} exclude each other"
            yield Problem((), text, "keys-exclusive", "Give one of device, virtual and file")
        if self.channel != 1 and not self.has_default_mapping:
            other = "mapping" if self.mapping else "learn"
            text = f"is {self.channel}, but applies only without {other}"
            action = (
                f"Give each entry of mapping its channel = {self.channel}, and leave it out here"
            )
            if not self.mapping:
                action = "Leave it out: what is learned has the channel of its knob or key"
            yield Problem(("channel",), text, "keys-exclusive", action)

    @property
    def has_default_mapping(self) -> bool:
        """Whether all controls are sent, as control changes of `channel`."""
        return not (self.mapping or self.learn)


class LslSettings(OutputSettings, frozen=True):
    """A stream of the Lab Streaming Layer."""

    SENDS: ClassVar = ("controls", "confidence", "markers", "signals", "quality")

    stream: Annotated[str, key("Name of the stream.", default="the device's name")] = ""
    send: Annotated[
        tuple[str, ...], key("What becomes channels, each at most once.", choices=SENDS)
    ] = ("controls", "quality")
    rate: Annotated[_Rate, _RATE] = 0.0

    def check(self) -> Iterator[Problem]:
        """Yield a problem of `send`."""
        yield from _check_send(self.send, self.SENDS)


class GamepadMapping(OutputSettings, frozen=True):
    """What a control moves on a gamepad: an axis, or a button."""

    AXES: ClassVar = ("x", "y", "z", "rx", "ry", "rz")
    BUTTONS: ClassVar = ("south", "east", "north", "west", "tl", "tr", "select", "start")

    control: Annotated[str, key("Name of the control.")]
    axis: Annotated[str, key("Axis that it moves.", choices=AXES, default="this or `button`")] = ""
    button: Annotated[
        str,
        key(
            "Button that it holds while above `threshold`.",
            choices=BUTTONS,
            default="this or `axis`",
        ),
    ] = ""
    threshold: Annotated[float, key("Value of the control at which a button is pressed.")] = 0.5

    def check(self) -> Iterator[Problem]:
        """Yield a problem unless exactly one of axis and button is given."""
        if bool(self.axis) == bool(self.button):
            text = f"control {self.control!r} needs either axis or button"
            yield Problem((), text, "keys-exclusive", "Give one of them")


class GamepadSettings(OutputSettings, frozen=True):
    """A virtual gamepad (Linux)."""

    mapping: Annotated[
        tuple[GamepadMapping, ...],
        key(
            "What each control moves.",
            default="the controls in their order move x, y, rx, ry, z, rz",
        ),
    ] = ()
    name: Annotated[str, key("Name by which games see it, of at most 79 bytes.")] = (
        "DefSense gamepad"
    )
    rate: Annotated[_Rate, _RATE] = 0.0

    def check(self) -> Iterator[Problem]:
        """Yield a problem of a name that Linux does not take."""
        if not 1 <= len(self.name.encode()) <= _MAX_NAME_BYTES:
            text = f"must have from 1 to {_MAX_NAME_BYTES} bytes"
            yield Problem(("name",), text, "name-too-long", "Shorten it")


Settings = OscSettings | WebSocketSettings | MidiSettings | LslSettings | GamepadSettings
#: By the name of the table in [outputs].
KINDS: dict[str, type[Settings]] = {
    "osc": OscSettings,
    "websocket": WebSocketSettings,
    "midi": MidiSettings,
    "lsl": LslSettings,
    "gamepad": GamepadSettings,
}


def _check_send(send: Sequence[str], choices: Sequence[str]) -> Iterator[Problem]:
    if not send or len(set(send)) != len(send):
        text = f"must name at least one of {', '.join(choices)}, each once"
        yield Problem(("send",), text, "name-repeated")
