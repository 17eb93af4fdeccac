"""Load a device for the live loop: its model, and the poses, surface and cords of its build."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.device.device_file import load_device
from ...core.errors import LiveError
from ...core.mesh import Surface
from ...decoding.trained_model import TrainedModel
from ...runtime.controls.pose_amplitudes import PoseBasis, PoseRamp
from ...runtime.live.live_loop import marker_sd
from ...runtime.surface.live_surface import FRAME_TIME_S, LiveSurface, Mode, make_surface
from ...runtime.surface.surface_mesh import SurfaceBasis
from ...store.build import Build
from ...store.layout import LAYOUT, LayoutRecord, layout_hash
from ...training.fitting.model_file import is_of_other_cords, load_model
from ...twin.devices.simulated_device import SimulatedDevice, load_simulated_device

_TYPICAL_DISTANCE = 0.7  # from the training, of the readings that a model mostly receives
_FIXED_TOLERANCE_MM = 1e-9  # displacement of fixed vertices


@dataclass(frozen=True)
class LiveCord:
    """A cord of a built device.

    Attributes:
        name: Name of the cord.
        path: Its path at rest (p, 3), mm.
        displacements: Displacements of the path in the simulated states (s, p, 3), mm.
    """

    name: str
    path: Float
    displacements: Float


@dataclass(frozen=True)
class LiveDevice:
    """A device with its model, and its build if that is known.

    Attributes:
        model: The trained model.
        device: The device, or None.
        rest: The surface at rest, or None.
        states: Displacements of its vertices in all simulated states (s, v, 3), mm, or None.
        poses: The poses at the model's markers, or None.
        cords: The cords.
        board_channels: Names of the channels in the order of the read-out board.
        reference: Resistors of the dividers in the training (c,), ohm, in the model's order; None
            if unknown.
        trained_rest: Resistances at rest in the training (c,), ohm, or None.
        first_rest_signals: Signals in the training's first rest (c,), or None.
    """

    model: TrainedModel
    device: Device | None
    rest: Surface | None
    states: Float | None
    poses: PoseBasis | None
    cords: tuple[LiveCord, ...]
    board_channels: tuple[str, ...]
    reference: Float | None
    trained_rest: Float | None
    first_rest_signals: Float | None = None


class Misfit(Enum):
    """Why a model cannot be used with a device."""

    DEVICE = "another device"
    CORDS = "other cords"
    CHANNELS = "other channels"


def misfit(model: TrainedModel, device: Device, layout: LayoutRecord | None) -> Misfit | None:
    """Return why a model does not fit a device, or None.

    Args:
        model: The model.
        device: The device.
        layout: Its built layout; None if it is not built, and only the device is compared.
    """
    if device.name != model.device:
        return Misfit.DEVICE
    if layout is None:
        return None
    if is_of_other_cords(model, layout):
        return Misfit.CORDS
    if {cord.name for cord in layout.by_channel()} != set(model.channels):
        return Misfit.CHANNELS
    return None


def live_device(path: Path, folder: Path | None = None) -> LiveDevice:
    """Load a device with its model.

    Args:
        path: The model's file or folder.
        folder: The device's folder; by default that of the model, if it is a device's.

    Raises:
        LiveError: The model belongs to another device or to other cords, or the device is not
            built.
        TrainingError: The file is not a model.
        StorageError: The build cannot be read.
    """
    model = load_model(path)
    device_folder = folder or _device_folder_of(path)
    if device_folder is None:
        return without_build(model)
    device = load_device(device_folder)
    build = Build(build_folder(device))
    is_built = (build.folder / LAYOUT).exists()
    problem = misfit(model, device, build.layout if is_built else None)
    if problem is not None:
        raise _misfit_error(problem, model, path, device, build)
    if is_built:
        return with_build(model, device, build)
    if folder is None:
        return without_build(model, device)
    raise LiveError(
        "is not built",
        code="not-built",
        where=device_folder,
        action=f"Build it (defsense build {device_folder})",
    )


def _misfit_error(
    problem: Misfit, model: TrainedModel, path: Path, device: Device, build: Build
) -> LiveError:
    """Return the error for the model of a file that does not fit a device."""
    if problem is Misfit.DEVICE:
        return LiveError(
            f"is a model of {model.device}, and {device.source} is {device.name}",
            code="device-differs",
            where=path,
            action="Give the folder of the device that the model was trained on",
            model=model.device,
            device=device.name,
        )
    if problem is Misfit.CORDS:
        return LiveError(
            f"was trained with other cords ({model.layout}) than {build.folder} has"
            f" ({layout_hash(build.layout)})",
            code="cords-differ",
            where=path,
            action="Give the build that the sessions were recorded with, or record and train again",
        )
    present = tuple(cord.name for cord in build.layout.by_channel())
    return LiveError(
        f"has the channels {', '.join(model.channels)}, and {device.source} {', '.join(present)}",
        code="channels-differ",
        where=path,
        action="Train with all cords of this device",
        channels=model.channels,
        present=present,
    )


def without_build(model: TrainedModel, device: Device | None = None) -> LiveDevice:
    """Return a device of which only the model is known."""
    reference, rest = _trained_resistances(model)
    return LiveDevice(
        model=model,
        device=device,
        rest=None,
        states=None,
        poses=None,
        cords=(),
        board_channels=model.channels,
        reference=reference,
        trained_rest=rest,
        first_rest_signals=_first_rest_signals(model),
    )


def with_build(model: TrainedModel, device: Device, build: Build | None = None) -> LiveDevice:
    """Return a built device that the model fits.

    Args:
        model: The model.
        device: The device.
        build: Its build; by default that in its folder.

    Raises:
        CaptureError: The device is not built, or has no simulated pose.
    """
    simulated = load_simulated_device(device, model.rest_points, build)
    cords = tuple(
        LiveCord(name, cord.path, displacements)
        for name, cord, displacements in zip(
            simulated.names, simulated.cords, simulated.moved, strict=True
        )
    )
    reference, rest = _trained_resistances(model)
    return LiveDevice(
        model=model,
        device=device,
        rest=simulated.rest,
        states=simulated.skin,
        poses=_poses(simulated),
        cords=cords,
        board_channels=simulated.names,
        reference=reference,
        trained_rest=rest,
        first_rest_signals=_first_rest_signals(model),
    )


def device_surface(
    live: LiveDevice, mode: Mode = "default", frame: float = FRAME_TIME_S
) -> LiveSurface:
    """Return the solver of the surface that carries the model's markers.

    Args:
        live: The device.
        mode: How the surface is solved; see `make_surface`.
        frame: Time for a frame, s; a mesh that takes longer on this machine is moved by a coarser
            cage.

    Raises:
        LiveError: The build of the device is unknown.
    """
    if live.rest is None or live.states is None:
        raise LiveError(
            "its build is unknown, and the surface with it",
            code="not-built",
            where=live.model.device,
            action="Give the folder of the built device",
        )
    fixed = np.abs(live.states).max(axis=(0, 2)) < _FIXED_TOLERANCE_MM
    faces = np.asarray(live.rest.faces, np.int64)
    basis = SurfaceBasis(live.rest.vertices, faces, live.states, fixed)
    return make_surface(basis, live.model.rest_points, typical_marker_sd(live.model), mode, frame)


def typical_marker_sd(model: TrainedModel) -> Float:
    """Return the standard deviations of the markers near the training (m,), mm."""
    intervals = model.main.intervals
    if intervals is None:
        return marker_sd(np.full(len(model.ids), np.nan))
    return marker_sd(intervals(np.array([_TYPICAL_DISTANCE]))[0])


def _device_folder_of(path: Path) -> Path | None:
    folder = path if path.is_dir() else path.parent
    return folder if (folder / "device.toml").exists() else None


def _poses(simulated: SimulatedDevice) -> PoseBasis:
    ramps = tuple(PoseRamp(r.levels, simulated.shown[r.states]) for r in simulated.ramps)
    return PoseBasis(tuple(r.name for r in simulated.ramps), ramps)


def _trained_resistances(model: TrainedModel) -> tuple[Float | None, Float | None]:
    """Return the dividers' resistors and R0 of the last session of the training."""
    c = len(model.channels)
    resistors: Float | None = None
    for session in model.metadata.get("provenance", {}).get("sessions", ()):
        by_name = session.get("reference") or {}
        if set(model.channels) <= set(by_name):
            resistors = np.array([float(by_name[name]) for name in model.channels])
    rests = [np.array(r, float) for r in model.metadata.get("R0", {}).values() if len(r) == c]
    return resistors, rests[-1] if rests else None


def _first_rest_signals(model: TrainedModel) -> Float | None:
    by_name = model.metadata.get("first_rest") or {}
    is_known = all(isinstance(by_name.get(name), float) for name in model.channels)
    return np.array([by_name[name] for name in model.channels]) if is_known else None
