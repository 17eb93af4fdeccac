"""What a live loop knows of its device: the trained model, and what the build says of its poses,
its surface and its cords."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.device.device_file import load_device
from ...core.errors import LiveError
from ...core.mesh import Surface
from ...core.device.build_folder import build_folder
from ...decoding.trained_model import TrainedModel
from ...store.layout import LAYOUT, layout_hash, load_layout
from ...training.models.model_file import load_model
from ...twin.devices.simulated_device import SimulatedDevice, load_simulated_device
from ..controls.pose_amplitudes import PoseBasis, PoseRamp
from .model_fit import Misfit, misfit


@dataclass(frozen=True)
class LiveCord:
    """A cord's `path` (p, 3) mm at rest, and its displacements (s, p, 3) mm in the states."""

    name: str
    path: Float
    moved: Float


@dataclass(frozen=True)
class LiveDevice:
    """The `model`; of its `device`, where its build is known: the surface at `rest`, displacements
    `states` (s, v, 3) mm of its vertices in all simulated states, `poses` at the model's markers,
    and the `cords`. `wired` are the channels' names in the order in which the read-out board has
    them; `reference` (c,) ohm of the dividers, `trained_rest` (c,) ohm and signals `lying` (c,) in
    the training's first rest, in the model's order, where the training tells them."""

    model: TrainedModel
    device: Device | None
    rest: Surface | None
    states: Float | None
    poses: PoseBasis | None
    cords: tuple[LiveCord, ...]
    wired: tuple[str, ...]
    reference: Float | None
    trained_rest: Float | None
    lying: Float | None = None


def live_device(path: Path, folder: Path | None = None) -> LiveDevice:
    """Of a model's file or folder, and the device's `folder`; that in which the model lies, where
    it is a device's. Raises LiveError for a model of another device or of other cords,
    TrainingError for what is no model, CaptureError for a device that is not built."""
    model = load_model(path)
    own = folder or _beside(path)
    if own is None:
        return without_build(model)
    device = load_device(own)
    built = build_folder(device)
    layout = load_layout(built, LiveError) if (built / LAYOUT).exists() else None
    if misfit(model, device, None) is not None:
        raise LiveError(
            f"{path}: is a model of {model.device}, and {own} is {device.name}; give --device the"
            " folder of the device that it was trained on"
        )
    if layout is None:
        if folder is None:
            return without_build(model, device)
        raise LiveError(f"{own}: is not built; run 'defsense build {own}'")
    why = misfit(model, device, layout)
    if why is Misfit.CORDS:
        raise LiveError(
            f"{path}: was trained with other cords ({model.layout}) than {built} has"
            f" ({layout_hash(layout)}); give --device the build that it was recorded with, or"
            " record and train anew"
        )
    if why is Misfit.CHANNELS:
        wired = ", ".join(cord.name for cord in layout.by_channel())
        raise LiveError(
            f"{path}: knows the channels {', '.join(model.channels)}, and {own} has {wired}; train"
            " with all of this device's cords"
        )
    return with_build(model, device)


def without_build(model: TrainedModel, device: Device | None = None) -> LiveDevice:
    """What the model alone tells."""
    reference, rest = _told(model)
    return LiveDevice(
        model, device, None, None, None, (), model.channels, reference, rest, _lying(model)
    )


def with_build(model: TrainedModel, device: Device) -> LiveDevice:
    """Of a built device that the model fits. Raises CaptureError where it is not built."""
    found = load_simulated_device(device, model.rest_points)
    cords = tuple(
        LiveCord(name, cord.path, moved)
        for name, cord, moved in zip(found.names, found.cords, found.moved, strict=True)
    )
    reference, rest = _told(model)
    return LiveDevice(
        model, device, found.rest, found.skin, _poses(found), cords, found.names, reference, rest,
        _lying(model),
    )  # fmt: skip


def _beside(path: Path) -> Path | None:
    folder = path if path.is_dir() else path.parent
    return folder if (folder / "device.toml").exists() else None


def _poses(found: SimulatedDevice) -> PoseBasis:
    ramps = tuple(PoseRamp(r.levels, found.shown[r.states]) for r in found.ramps)
    return PoseBasis(tuple(r.name for r in found.ramps), ramps)


def _told(model: TrainedModel) -> tuple[Float | None, Float | None]:
    """Resistors and R0 of the last session that it was trained on."""
    c = len(model.channels)
    resistors: Float | None = None
    for session in model.told.get("provenance", {}).get("sessions", ()):
        by = session.get("reference") or {}
        if set(model.channels) <= set(by):
            resistors = np.array([float(by[name]) for name in model.channels])
    rests = [np.array(r, float) for r in model.told.get("R0", {}).values() if len(r) == c]
    return resistors, rests[-1] if rests else None


def _lying(model: TrainedModel) -> Float | None:
    by = model.told.get("first_rest") or {}
    known = all(isinstance(by.get(name), float) for name in model.channels)
    return np.array([by[name] for name in model.channels]) if known else None
