"""The models in a device's folder: how each was trained, and whether it fits the device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from ...core.device.device import Device
from ...core.errors import DefsenseError, TrainingError
from ...core.device.build_folder import build_folder
from ...store.layout import LAYOUT, LayoutRecord, load_layout
from ...training.models.model_file import MODEL, is_model, load_model
from .model_fit import Misfit, misfit

_REMEDIES = {
    Misfit.DEVICE: "is a model of another device, {model.device}; train one of this device",
    Misfit.CORDS: "was trained with other cords than are built now: take the cords of then back"
    " and build them, or record this device and train anew",
    Misfit.CHANNELS: "knows the channels {channels}, which are not the cords that are built now:"
    " were they renamed? Take the names of then back, or record and train anew",
}


@dataclass(frozen=True)
class KnownModel:
    """A model's file; `about` it in a line, what its training `told`, and why it is of no use
    (`problem`), None where nothing speaks against it."""

    path: Path
    about: str
    told: Mapping[str, Any] = field(default_factory=dict)
    problem: str | None = None


def known_models(device: Device) -> list[KnownModel]:
    """Of the device's folder, the newest first."""
    files = [p for p in device.source.glob("*.json") if p.name == MODEL or is_model(p)]
    layout = _layout(device)
    files.sort(key=lambda p: p.stat().st_mtime, reverse=True)
    return [_known(path, device, layout) for path in files]


def _layout(device: Device) -> LayoutRecord | None:
    built = build_folder(device)
    try:
        return load_layout(built) if (built / LAYOUT).exists() else None
    except DefsenseError:  # a damaged build is told where it is used
        return None


def _known(path: Path, device: Device, layout: LayoutRecord | None) -> KnownModel:
    try:
        model = load_model(path)
    except TrainingError as error:
        return KnownModel(path, "is no whole model", problem=str(error))
    problem = None
    if (why := misfit(model, device, layout)) is not None:
        channels = ", ".join(model.channels)
        problem = f"{path.name} " + _REMEDIES[why].format(model=model, channels=channels)
    return KnownModel(path, _about(model.kind, model.told, path), model.told, problem)


def _about(kind: str, told: Mapping[str, Any], path: Path) -> str:
    """Which decoder, when it was trained and on what."""
    try:
        when = datetime.fromisoformat(str(told.get("written"))).astimezone()
    except ValueError:
        when = datetime.fromtimestamp(path.stat().st_mtime).astimezone()
    parts = [kind, f"{when:%Y-%m-%d %H:%M}"]
    match told.get("pictures"), told.get("sessions"), told.get("trained_on"):
        case {"trained": int(count)}, list(sessions), _:
            names = ", ".join(Path(str(s)).name for s in sessions)
            parts.append(f"{count} pictures of {names}")
        case _, _, str(trained_on):
            parts.append(trained_on)
    return ", ".join(parts)
