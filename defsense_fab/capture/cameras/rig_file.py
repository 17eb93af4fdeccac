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
    cameras = tuple(_CameraTable(path, key, table).camera() for key, table in ordered)
    try:
        check_names([c.name for c in cameras])
    except CaptureError as error:
        raise CaptureError(
            error.problem, code=error.code, where=path, action=error.action, **error.data
        ) from None
    metadata = data.get("metadata", {})
    placed = len(cameras) == 1 or not all(np.allclose(c.center, 0) for c in cameras)
    return Rig(cameras, placed, metadata if isinstance(metadata, dict) else {})


class _CameraTable:
    """A table `[key]` of a file, with errors that name it."""

    def __init__(self, path: Path, key: str, table: Any) -> None:
        self._where, self._key = f"{path}: [{key}]", key
        if not isinstance(table, dict):
            raise CaptureError(
                "must be a table",
                code="not-a-table",
                where=self._where,
                action="Calibrate again",
                key=key,
            )
        self._table = table

    def error(
        self, problem: str, code: str, action: str = "Calibrate again", **data: Any
    ) -> CaptureError:
        """Return an error about the table."""
        data = {**data, "table": self._key}
        return CaptureError(problem, code=code, where=self._where, action=action, **data)

    def numbers(self, name: str, shape: tuple[int, ...] | None = None) -> Any:
        """Return numbers of a shape, or of any."""
        try:
            values = np.array(self._table[name], float)
        except KeyError:
            raise self.error(f"{name} is missing", "key-missing", key=name) from None
        except (TypeError, ValueError):
            raise self.error(f"{name} must be numbers", "not-a-number", key=name) from None
        if shape is not None and values.shape != shape:
            raise self.error(
                f"{name} must have the shape {' x '.join(map(str, shape))}, but has"
                f" {' x '.join(map(str, values.shape)) or 'one number'}",
                "wrong-shape",
                key=name,
            )
        return values

    def size(self) -> tuple[int, int]:
        """Return the width and height of the images, px."""
        size = self.numbers("size", (2,))
        if not np.isfinite(size).all() or (size != np.round(size)).any():
            raise self.error("size must be whole numbers", "not-a-number", key="size")
        if not ((size >= 1) & (size <= MAX_IMAGE_PX)).all():
            raise self.error(
                f"size must be the width and height in pixels, 1 to {MAX_IMAGE_PX} each",
                "image-size-invalid",
                key="size",
            )
        return int(size[0]), int(size[1])

    def is_fisheye(self) -> bool:
        """Return whether the lens is a fisheye."""
        fisheye = self._table.get("fisheye", False)
        if not isinstance(fisheye, bool):
            raise self.error(
                "fisheye must be true or false",
                "not-a-bool",
                "Write true or false",
                key="fisheye",
            )
        return fisheye

    def camera(self) -> Camera:
        """Return the camera."""
        is_fisheye, size = self.is_fisheye(), self.size()
        distortions = self.numbers("distortions").ravel()
        rotation = self.numbers("rotation", (3,))
        if not np.isfinite(rotation).all():
            raise self.error("rotation must be finite numbers", "not-a-number", key="rotation")
        matrix, translation = self.numbers("matrix", (3, 3)), self.numbers("translation", (3,))
        try:
            return Camera(
                str(self._table.get("name", self._key)),
                size,
                matrix,
                distortions if is_fisheye else _trim_distortions(distortions),
                Rotation.from_rotvec(rotation).as_matrix(),
                translation,
                is_fisheye,
            )
        except CaptureError as error:
            raise self.error(error.problem, error.code, error.action, **error.data) from None


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
