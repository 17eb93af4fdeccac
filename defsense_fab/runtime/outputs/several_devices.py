"""Devices that run at once: receivers tell them apart, and none takes a port that another has.

What several devices share, by a flag or by one live.toml, would be the same for each of them. Where
a device comes upon what one before it has, its output counts on: the next port, page, channel or
number. Settings that are distinct already, such as those of live.tomls of their own, stay.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msgspec.structs import replace

from ...core.errors import OutputError
from .midi_mapping import FREE, QUALITY
from .settings import (
    KINDS,
    GamepadSettings,
    LslSettings,
    MidiSettings,
    OscSettings,
    Settings,
    WebSocketSettings,
)

_CHANNELS = 16
_MOST = 64  # places that are tried

#: What only one device may have: a kind, and what tells its places apart.
Place = tuple[str | int, ...]


class SeveralDevices:
    """Asked for one device after the other."""

    def __init__(self) -> None:
        self._names, self._taken = set[str](), set[Place]()

    def name(self, device: str) -> str:
        """That of the device, with a number where there is one of that name: bar, bar-2, ..."""
        number, name = 1, device
        while name in self._names:
            number += 1
            name = f"{device}-{number}"
        self._names.add(name)
        return name

    def outputs(self, settings: Iterable[Settings]) -> tuple[Settings, ...]:
        """Those of the next device. Outputs of one device may share what they like. Raises
        OutputError where no place is left."""
        apart = tuple(self._apart(one) for one in settings)
        self._taken |= {place for one in apart for place in _places(one)}
        return apart

    def _apart(self, settings: Settings) -> Settings:
        kind = next(name for name, of in KINDS.items() if of is type(settings))
        problem = "no free port, channel or name is left for another device"
        action = "Give the device a live.toml of its own"
        for steps in range(_MOST):
            try:
                further = _further(settings, steps)
            except OutputError as error:
                raise OutputError(
                    f"{problem} ({error})", code="outputs-exhausted", where=kind, action=action
                ) from None
            if self._taken.isdisjoint(_places(further)):
                return further
        raise OutputError(problem, code="outputs-exhausted", where=kind, action=action)


def _further(settings: Settings, steps: int) -> Settings:
    """Settings that are `steps` further in all that a receiver could mistake."""
    if steps == 0:
        return settings
    match settings:
        case OscSettings():
            return replace(
                settings,
                wekinator_port=settings.wekinator_port + steps,
                page=settings.page + steps,
            )
        case WebSocketSettings():
            return replace(settings, port=settings.port + steps)
        case MidiSettings():
            mapping = tuple(
                replace(one, channel=_channel(one.channel, steps)) for one in settings.mapping
            )
            file, virtual = settings.file, settings.virtual
            return replace(
                settings,
                channel=_channel(settings.channel, steps),
                mapping=mapping,
                file=file and _numbered(Path(file), steps + 1),
                virtual=virtual and f"{virtual} {steps + 1}",
            )
        case LslSettings():
            return replace(settings, stream=f"{settings.stream}-{steps + 1}")
        case GamepadSettings():
            return replace(settings, name=f"{settings.name} {steps + 1}")


def _places(settings: Settings) -> set[Place]:
    match settings:
        case OscSettings(host=host, send=send):
            # Other addresses have the device's name in them.
            found = set[Place]()
            if "wekinator" in send:
                found.add(("wekinator", host, settings.wekinator_port))
            if "touchosc" in send:
                found.add(("touchosc", host, settings.port, settings.page))
            return found
        case WebSocketSettings(port=port):
            return {("websocket", port)} if port else set()
        case MidiSettings():
            return _midi_places(settings)
        case LslSettings(stream=stream):
            return {("lsl", stream)} if stream else set()
        case GamepadSettings(name=name):
            return {("gamepad", name)}


def _midi_places(settings: MidiSettings) -> set[Place]:
    if settings.file:
        return {("midi file", str(Path(settings.file).absolute()))}
    if settings.virtual:
        return {("midi virtual", settings.virtual)}
    played = {(one.channel, one.cc, one.note) for one in settings.mapping}
    if not settings.mapping and not settings.learn:
        played = {(settings.channel, cc, None) for cc in (*FREE, QUALITY)}
    port, found = settings.device.lower(), set[Place]()
    for channel, cc, note in played:
        if cc is not None:
            found.add(("midi cc", port, channel, cc))
        elif note is not None:
            found.add(("midi note", port, channel, note))
    return found


def _numbered(path: Path, number: int) -> str:
    return str(path.parent / f"{path.stem}-{number}{path.suffix}")


def _channel(first: int, steps: int) -> int:
    """After the last one comes the first."""
    return (first - 1 + steps) % _CHANNELS + 1
