"""Read and write calibrated cameras as TOML, by the convention of aniposelib.

There is a table `[cam_0]` for each camera, with name, size, matrix, distortions, rotation (a
rotation vector, world to camera) and translation (here mm). A table `[metadata]` describes the
calibration.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from scipy.spatial.transform import Rotation

from ...core.camera import Camera, check_names
from ...core.errors import CaptureError
from ...core.storage.files import storage_errors, write_text

MAX_IMAGE_PX = 100_000


@dataclass(frozen=True)
class Rig:
    """Cameras with a common world.

    Attributes:
        cameras: The cameras.
        placed: Whether the file states the pose of each camera.
        metadata: Plain values that describe the calibration.
    """

    cameras: tuple[Camera, ...]
    placed: bool = True
    metadata: Mapping[str, Any] = field(default_factory=dict)


def read_rig(path: Path) -> Rig:
    """Read the cameras of a file, in the order of their numbers.

    Raises:
        CaptureError: If the file cannot be read or is invalid.
    """
    try:
        text = path.read_text(encoding="utf-8")
        data = tomllib.loads(text)
    except OSError as error:
        raise CaptureError(
            f"cannot be read: {error.strerror}",
            code="file-unreadable",
            where=path,
            action="Write it with 'defsense capture camera calibrate'",
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CaptureError(
            f"is not valid TOML: {error}",
            code="toml-invalid",
            where=path,
            action="Correct the line, or calibrate again",
        ) from None
    tables = {k: v for k, v in data.items() if re.fullmatch(r"cam_\d+", k)}
    if not tables:
        raise CaptureError(
            "describes no camera, because it has no table [cam_0]",
            code="camera-table-missing",
            where=path,
            action="Choose the file of a calibration",
        )
    ordered = sorted(tables.items(), key=lambda kv: int(kv[0][4:]))
    cameras = tuple(_parse_camera(path, key, table) for key, table in ordered)
    try:
        check_names([c.name for c in cameras])
    except CaptureError as error:
        raise CaptureError(
            error.problem, code=error.code, where=path, action=error.action, **error.data
        ) from None
    metadata = data.get("metadata", {})
    placed = len(cameras) == 1 or not all(np.allclose(c.center, 0) for c in cameras)
    return Rig(cameras, placed, metadata if isinstance(metadata, dict) else {})


def _parse_camera(path: Path, key: str, table: Any) -> Camera:
    """Return the camera of a table `[key]`."""
    where = f"{path}: [{key}]"

    def read_numbers(name: str, shape: tuple[int, ...]) -> Any:
        try:
            values = np.array(table[name], float)
        except KeyError:
            raise CaptureError(
                f"{name} is missing",
                code="key-missing",
                where=where,
                action="Calibrate again",
                table=key,
                key=name,
            ) from None
        except (TypeError, ValueError):
            raise CaptureError(
                f"{name} must be numbers",
                code="not-a-number",
                where=where,
                action="Calibrate again",
                table=key,
                key=name,
            ) from None
        if shape and values.shape != shape:
            raise CaptureError(
                f"{name} must have the shape {' x '.join(map(str, shape))}, but has"
                f" {' x '.join(map(str, values.shape)) or 'one number'}",
                code="shape-wrong",
                where=where,
                action="Calibrate again",
                table=key,
                key=name,
            )
        return values

    if not isinstance(table, dict):
        raise CaptureError(
            "must be a table",
            code="not-a-table",
            where=where,
            action="Calibrate again",
            key=key,
        )
    fisheye = table.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise CaptureError(
            "fisheye must be true or false",
            code="not-a-boolean",
            where=where,
            action="Write true or false",
            table=key,
            key="fisheye",
        )
    size = read_numbers("size", (2,))
    distortions = read_numbers("distortions", ()).ravel()
    rotation, translation = read_numbers("rotation", (3,)), read_numbers("translation", (3,))
    matrix = read_numbers("matrix", (3, 3))
    is_finite = np.isfinite(rotation).all() and np.isfinite(size).all()
    if not is_finite or (size != np.round(size)).any():
        raise CaptureError(
            "size must be whole numbers and rotation finite numbers",
            code="not-a-number",
            where=where,
            action="Calibrate again",
            table=key,
        )
    if not ((size >= 1) & (size <= MAX_IMAGE_PX)).all():
        raise CaptureError(
            f"size must be the width and height in pixels, 1 to {MAX_IMAGE_PX} each",
            code="image-size-invalid",
            where=where,
            action="Calibrate again",
            table=key,
        )
    try:
        return Camera(
            str(table.get("name", key)),
            (int(size[0]), int(size[1])),
            matrix,
            distortions if fisheye else _trim_distortions(distortions),
            Rotation.from_rotvec(rotation).as_matrix(),
            translation,
            fisheye,
        )
    except CaptureError as error:
        raise CaptureError(
            error.problem,
            code=error.code,
            where=where,
            action=error.action,
            **{**error.data, "table": key},
        ) from None


def _trim_distortions(distortions: Any) -> Any:
    """Return 5 or 8 coefficients: without trailing zeros, and with missing ones as zeros."""
    d = np.trim_zeros(distortions, "b")
    length = next((n for n in (5, 8) if len(d) <= n), len(d))
    return np.append(d, np.zeros(length - len(d)))


def write_rig(path: Path, cameras: Sequence[Camera], metadata: Mapping[str, Any]) -> None:
    """Write cameras, completely or not at all.

    Args:
        path: File to write.
        cameras: The cameras.
        metadata: Plain values that describe the calibration.

    Raises:
        CaptureError: If names could not be read again.
        StorageError: If the file cannot be written.
    """
    check_names([c.name for c in cameras])
    document = tomlkit.document()
    for k, c in enumerate(cameras):
        document[f"cam_{k}"] = {
            "name": c.name,
            "size": list(c.size),
            "matrix": c.matrix.tolist(),
            "distortions": c.distortions.tolist(),
            "rotation": Rotation.from_matrix(c.rotation).as_rotvec().tolist(),
            "translation": c.translation.tolist(),
        } | ({"fisheye": True} if c.fisheye else {})
    document["metadata"] = dict(metadata)
    with storage_errors(path):
        write_text(path, tomlkit.dumps(document))
