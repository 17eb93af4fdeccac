"""List what can be run: the models of a device, whether they fit it, and sources of its signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.readout.paired_boards import read_boards
from ...capture.readout.ports import serial_ports
from ...core.device.build_folder import build_folder
from ...core.device.device import Device, Sensor
from ...core.errors import CaptureError, DefsenseError, TrainingError
from ...runtime.live.run_files import BOARD
from ...store.build import Build
from ...store.layout import LAYOUT, LayoutRecord
from ...training.fitting.model_file import MODEL, is_model, load_model
from ..sessions.known_sessions import known_sessions
from .live_device import Misfit, misfit
from .sources import TWIN as TWIN

_MAX_RECORDED_RUNS = 5  # that are listed
_PATH_TOLERANCE_MM = 0.01  # between a cord as it is drawn and as it was built


@dataclass(frozen=True)
class KnownPort:
    """A source of signals.

    Attributes:
        port: The port, as of `prepare_run`.
        label: Its name for users.
    """

    port: str
    label: str


def known_ports(device: Device) -> list[KnownPort]:
    """Return the twin, which always exists, then boards, sessions and recorded runs."""
    known = [KnownPort(TWIN, "twin (simulated)"), *known_boards()]
    for session in known_sessions(device):
        if session.is_usable:
            name = session.folder.relative_to(device.source)
            known.append(KnownPort(f"replay:{session.folder}", f"session {name}"))
    runs = sorted(device.source.glob(f"live/*/{BOARD}"), reverse=True)[:_MAX_RECORDED_RUNS]
    return known + [KnownPort(f"replay:{p}", f"run of {p.parent.name}") for p in runs]


def known_boards() -> list[KnownPort]:
    """Return the serial ports that are plugged in, then the paired boards with Wi-Fi."""
    known = [KnownPort(p.device, f"{p.device} {p.description}".strip()) for p in serial_ports()]
    try:
        paired = read_boards()
    except CaptureError:  # a damaged file is reported where a board is opened by its name
        paired = []
    return known + [KnownPort(f"udp://{b.name}", f"{b.name} (Wi-Fi)") for b in paired]


def changed_since(device: Device) -> list[str]:
    """Return sentences on the cords that differ from those of the device's build.

    Names are compared, and cords that a build may not move. Cords that a build moves or proposes
    are not compared.

    Raises:
        StorageError: The build cannot be read.
    """
    if not device.sensors:  # all are proposed by the build
        return []
    layout = Build(build_folder(device)).layout
    built = {cord.name: cord for cord in layout.by_channel()}
    drawn = {cord.name for cord in device.sensors}
    changes = []
    removed = sorted(set(built) - drawn)
    if removed and not device.propose:
        changes.append(f"{', '.join(removed)}: built, but no longer in device.toml")
    if added := sorted(drawn - set(built)):
        changes.append(f"{', '.join(added)}: in device.toml, but not built")
    moved = [
        s.name
        for s in device.sensors
        if s.name in built and not s.free and _differs(s, built[s.name].sensor())
    ]
    if moved:
        changes.append(f"{', '.join(sorted(moved))}: moved since the build")
    return changes


def is_built(device: Device) -> bool:
    """Return whether the cords of a device's build can be run."""
    return (build_folder(device) / LAYOUT).exists()


def _differs(one: Sensor, other: Sensor) -> bool:
    a, b = (s.plane.to_world(s.curve.points) for s in (one, other))
    return len(a) != len(b) or not np.allclose(a, b, atol=_PATH_TOLERANCE_MM)


_REMEDIES = {
    Misfit.DEVICE: "is a model of another device, {model.device}; train a model of this device",
    Misfit.CORDS: "was trained with other cords than those of the build: restore the former cords"
    " and build them, or record this device and train again",
    Misfit.CHANNELS: "has the channels {channels}, which are not the built cords: restore the"
    " former names, or record and train again",
}


@dataclass(frozen=True)
class KnownModel:
    """A model in a device's folder.

    Attributes:
        path: Its file.
        about: One line on it.
        metadata: Metadata of its training.
        problem: Why it cannot be used, or None.
    """

    path: Path
    about: str
    metadata: Mapping[str, Any] = field(default_factory=dict)
    problem: str | None = None


def known_models(device: Device) -> list[KnownModel]:
    """Return the models in the device's folder, the newest first."""
    files = [p for p in device.source.glob("*.json") if p.name == MODEL or is_model(p)]
    layout = _built_layout(device)
    files.sort(key=lambda p: p.stat().st_mtime, reverse=True)
    return [_inspect(path, device, layout) for path in files]


def _built_layout(device: Device) -> LayoutRecord | None:
    try:
        return Build(build_folder(device)).layout if is_built(device) else None
    except DefsenseError:  # a damaged build is reported where it is used
        return None


def _inspect(path: Path, device: Device, layout: LayoutRecord | None) -> KnownModel:
    try:
        model = load_model(path)
    except TrainingError as error:
        return KnownModel(path, "not a complete model", problem=str(error))
    problem = None
    if (reason := misfit(model, device, layout)) is not None:
        channels = ", ".join(model.channels)
        problem = f"{path.name} " + _REMEDIES[reason].format(model=model, channels=channels)
    return KnownModel(path, _describe(model.kind, model.metadata, path), model.metadata, problem)


def _describe(kind: str, metadata: Mapping[str, Any], path: Path) -> str:
    """Return the decoder of a model, when it was trained and on which data."""
    try:
        trained_at = datetime.fromisoformat(str(metadata.get("written"))).astimezone()
    except ValueError:
        trained_at = datetime.fromtimestamp(path.stat().st_mtime).astimezone()
    parts = [kind, f"{trained_at:%Y-%m-%d %H:%M}"]
    match metadata.get("pictures"), metadata.get("sessions"), metadata.get("trained_on"):
        case {"trained": int(count)}, list(sessions), _:
            names = ", ".join(Path(str(s)).name for s in sessions)
            parts.append(f"{count} pictures of {names}")
        case _, _, str(trained_on):
            parts.append(trained_on)
    return ", ".join(parts)
