"""Choose the outputs of each device: of live.toml and of texts, distinct for several devices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace as with_changes
from pathlib import Path

from msgspec.structs import replace

from ...core.errors import OutputError
from ...runtime.outputs.live_file import LiveSettings, parse_output, read_live_file
from ...runtime.outputs.midi_mapping import FREE, QUALITY
from ...runtime.outputs.settings import (
    KINDS,
    GamepadSettings,
    LslSettings,
    MidiSettings,
    OscSettings,
    Settings,
    WebSocketSettings,
)

#: File in a device's folder with its outputs and controls.
LIVE_FILE = "live.toml"
_MIDI_CHANNELS = 16
_MAX_STEPS = 64  # that are tried

#: A resource that only one device may use: its kind, and what distinguishes it from others.
Resource = tuple[str | int, ...]


def read_settings(
    folder: Path | None,
    file: Path | None = None,
    outputs: Sequence[str] = (),
    *,
    sends_to_file_outputs: bool = True,
) -> LiveSettings:
    """Return the outputs and controls of a run.

    Args:
        folder: Folder of the device, whose `live.toml` is read if it exists; or None.
        file: Another file to read instead.
        outputs: Further outputs, such as `osc,port=9000`.
        sends_to_file_outputs: Whether the outputs of the file are used, or only its controls.

    Raises:
        OutputError: The file or a text is not valid.
    """
    if file is None and folder is not None and (folder / LIVE_FILE).exists():
        file = folder / LIVE_FILE
    settings = LiveSettings() if file is None else read_live_file(file)
    of_file = settings.outputs if sends_to_file_outputs else ()
    return with_changes(settings, outputs=(*of_file, *map(parse_output, outputs)))


class OutputAllocator:
    """Allocate names and outputs, one device after another.

    Settings that several devices share, by an option or one live.toml, would be the same for each
    of them. An output that an earlier device uses is moved on: to the next port, page, channel or
    number. Settings that are distinct already, such as those of separate files, are kept.
    """

    def __init__(self) -> None:
        self._names, self._taken = set[str](), set[Resource]()

    def unique_name(self, device: str) -> str:
        """Return the device's name, with a number if it is taken: bar, bar-2, ..."""
        number, name = 1, device
        while name in self._names:
            number += 1
            name = f"{device}-{number}"
        self._names.add(name)
        return name

    def allocate(self, settings: Iterable[Settings]) -> tuple[Settings, ...]:
        """Return the settings of the next device, distinct from those of all earlier devices.

        Args:
            settings: Outputs of the device; these may share resources among themselves.

        Raises:
            OutputError: No distinct setting is left.
        """
        distinct = tuple(self._make_distinct(entry) for entry in settings)
        self._taken |= {resource for entry in distinct for resource in _resources(entry)}
        return distinct

    def _make_distinct(self, settings: Settings) -> Settings:
        kind = next(name for name, of in KINDS.items() if of is type(settings))
        problem = "no free port, channel or name is left for another device"
        action = "Give the device a live.toml of its own"
        for steps in range(_MAX_STEPS):
            try:
                moved = _move_on(settings, steps)
            except OutputError as error:
                raise OutputError(
                    f"{problem} ({error})", code="outputs-exhausted", where=kind, action=action
                ) from None
            if self._taken.isdisjoint(_resources(moved)):
                return moved
        raise OutputError(problem, code="outputs-exhausted", where=kind, action=action)


def _move_on(settings: Settings, steps: int) -> Settings:
    """Return settings that are `steps` further in everything that a receiver could confuse."""
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
                replace(entry, channel=_next_channel(entry.channel, steps))
                for entry in settings.mapping
            )
            file, virtual = settings.file, settings.virtual
            return replace(
                settings,
                channel=_next_channel(
                    settings.channel, steps if settings.has_default_mapping else 0
                ),
                mapping=mapping,
                file=file and _numbered(Path(file), steps + 1),
                virtual=virtual and f"{virtual} {steps + 1}",
            )
        case LslSettings():
            return replace(settings, stream=f"{settings.stream}-{steps + 1}")
        case GamepadSettings():
            return replace(settings, name=f"{settings.name} {steps + 1}")


def _resources(settings: Settings) -> set[Resource]:
    match settings:
        case OscSettings(host=host, send=send):
            # Other addresses contain the device's name.
            resources = set[Resource]()
            if "wekinator" in send:
                resources.add(("wekinator", host, settings.wekinator_port))
            if "touchosc" in send:
                resources.add(("touchosc", host, settings.port, settings.page))
            return resources
        case WebSocketSettings(port=port):
            return {("websocket", port)} if port else set()
        case MidiSettings():
            return _midi_resources(settings)
        case LslSettings(stream=stream):
            return {("lsl", stream)} if stream else set()
        case GamepadSettings(name=name):
            return {("gamepad", name)}


def _midi_resources(settings: MidiSettings) -> set[Resource]:
    if settings.file:
        return {("midi file", str(Path(settings.file).absolute()))}
    if settings.virtual:
        return {("midi virtual", settings.virtual)}
    played = {(entry.channel, entry.cc, entry.note) for entry in settings.mapping}
    if settings.has_default_mapping:
        played = {(settings.channel, cc, None) for cc in (*FREE, QUALITY)}
    port, resources = settings.device.lower(), set[Resource]()
    for channel, cc, note in played:
        if cc is not None:
            resources.add(("midi cc", port, channel, cc))
        elif note is not None:
            resources.add(("midi note", port, channel, note))
    return resources


def _numbered(path: Path, number: int) -> str:
    return str(path.parent / f"{path.stem}-{number}{path.suffix}")


def _next_channel(first: int, steps: int) -> int:
    """Return a later MIDI channel; the last is followed by the first."""
    return (first - 1 + steps) % _MIDI_CHANNELS + 1
