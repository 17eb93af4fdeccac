"""The results of a device's last build, for programs that show them."""

from __future__ import annotations

from pathlib import Path

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...core.storage.files import digest
from ...decoding.error_scale import describe_error as describe_error
from ...decoding.error_scale import grade_error as grade_error
from ...decoding.expected_errors import MEANING as MEANING
from ...decoding.expected_errors import NONE as NONE
from ...report.surface_errors import SurfaceErrors as SurfaceErrors
from ...report.surface_errors import surface_errors as surface_errors
from ...store.build import Build as Build
from ...store.fields import INDEX, field_path
from ...store.layout import LAYOUT
from ...store.layout import LayoutRecord as LayoutRecord
from ...store.manifest import MANIFEST
from ...store.manifest import Manifest as Manifest
from ...store.mesh import MeshRecord as MeshRecord
from ...training.fitting.model_file import MODEL, is_of_other_cords, load_model


def last_build(device: Device) -> Build:
    """Return the results of a device's last build; each is read when it is first used."""
    return Build(build_folder(device))


def has_poses(build: Build) -> bool:
    """Return whether a build has simulated poses."""
    return (build.folder / INDEX).exists()


def has_layout(build: Build) -> bool:
    """Return whether a build has optimized cords."""
    return (build.folder / LAYOUT).exists()


def model_of_other_cords(device: Device, build: Build) -> Path | None:
    """Return the device's `model.json` if it was trained on other cords than those of a build."""
    path = device.source / MODEL
    if not (path.exists() and has_layout(build)):
        return None
    try:
        model = load_model(path)
    except DefsenseError:  # its use states what is wrong with it
        return None
    return path if is_of_other_cords(model, build.layout) else None


def poses_digest(build: Build) -> str:
    """Return a hash of a build's simulated poses and of the mesh that they deform.

    Raises:
        OSError: The build has no poses.
        StorageError: It has no mesh.
    """
    return build.mesh_record.hash + digest(build.folder / INDEX)


def simulation_digest(build: Build) -> str:
    """Return a hash of the body and the fields of a build, which the names of poses do not change.

    Raises:
        OSError: A file is missing.
        StorageError: The build has no simulated poses.
    """
    files = [field_path(build.folder, s.state) for s in build.field_index.states]
    return digest(build.mesh_record.hash, *files)


def layout_digest(build: Build) -> str:
    """Return a hash of a build's layout, which differs if the cords were optimized again.

    Raises:
        OSError: The build has no layout.
    """
    return digest(build.folder / LAYOUT)


def parts_digest(build: Build) -> str:
    """Return a hash of a build's parts, which differs if other parts were made.

    Raises:
        OSError: The build has no parts.
    """
    return digest(build.folder / MANIFEST)
