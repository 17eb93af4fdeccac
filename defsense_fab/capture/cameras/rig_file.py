"""Cameras in TOML, by the convention of aniposelib.

A table `[cam_0]` a camera: name, size, matrix, distortions, rotation (a rotation vector, world to
camera), translation (here mm); and `[metadata]`, with what is known of the calibration.
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


@dataclass(frozen=True)
class Rig:
    """Cameras that stand together; `placed` whether the file says where each stands; `metadata`,
    plain values."""

    cameras: tuple[Camera, ...]
    placed: bool = True
    metadata: Mapping[str, Any] = field(default_factory=dict)


def read_rig(path: Path) -> Rig:
    """The cameras of a file in the order of their numbers. Raises CaptureError for what is none."""
    try:
        text = path.read_text(encoding="utf-8")
        data = tomllib.loads(text)
    except OSError as error:
        raise CaptureError(
            f"{path}: cannot be read: {error.strerror}; 'defsense capture camera calibrate'"
            " writes this file",
            code="file-unreadable",
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CaptureError(f"{path}: is not valid TOML: {error}", code="toml-invalid") from None
    tables = {k: v for k, v in data.items() if re.fullmatch(r"cam_\d+", k)}
    if not tables:
        raise CaptureError(
            f"{path}: describes no camera, because it has no table [cam_0]",
            code="camera-table-missing",
        )
    ordered = sorted(tables.items(), key=lambda kv: int(kv[0][4:]))
    cameras = tuple(_camera(path, key, table) for key, table in ordered)
    try:
        check_names([c.name for c in cameras])
    except CaptureError as error:
        raise CaptureError(f"{path}: {error}", code=error.code, **error.data) from None
    metadata = data.get("metadata", {})
    placed = len(cameras) == 1 or not all(np.allclose(c.center, 0) for c in cameras)
    return Rig(cameras, placed, metadata if isinstance(metadata, dict) else {})


def _camera(path: Path, key: str, table: Any) -> Camera:
    def numbers(name: str, shape: tuple[int, ...]) -> Any:
        try:
            values = np.array(table[name], float)
        except KeyError:
            raise CaptureError(
                f"{path}: [{key}] has no {name}", code="key-missing", table=key, key=name
            ) from None
        except (TypeError, ValueError):
            raise CaptureError(
                f"{path}: [{key}] {name}: must be numbers", code="not-a-number", table=key, key=name
            ) from None
        if shape and values.shape != shape:
            raise CaptureError(
                f"{path}: [{key}] {name}: must have the shape {' x '.join(map(str, shape))},"
                f" but has {' x '.join(map(str, values.shape)) or 'one number'}",
                code="shape-wrong",
                table=key,
                key=name,
            )
        return values

    if not isinstance(table, dict):
        raise CaptureError(f"{path}: {key} must be a table", code="not-a-table", key=key)
    fisheye = table.get("fisheye", False)
    if not isinstance(fisheye, bool):
        raise CaptureError(
            f"{path}: [{key}] fisheye: must be true or false",
            code="not-a-boolean",
            table=key,
            key="fisheye",
        )
    size = numbers("size", (2,))
    bent = numbers("distortions", ()).ravel()
    rotation, translation = numbers("rotation", (3,)), numbers("translation", (3,))
    matrix = numbers("matrix", (3, 3))
    plain = np.isfinite(rotation).all() and np.isfinite(size).all()
    if not plain or (size != np.round(size)).any():
        raise CaptureError(
            f"{path}: [{key}] size must be whole numbers and rotation finite numbers",
            code="not-a-number",
            table=key,
        )
    if not ((size >= 1) & (size <= 100_000)).all():
        raise CaptureError(
            f"{path}: [{key}] size: must be the width and height in pixels, 1 to 100000 each",
            code="image-size-invalid",
            table=key,
        )
    try:
        return Camera(
            str(table.get("name", key)), (int(size[0]), int(size[1])), matrix,
            bent if fisheye else _shortest(bent), Rotation.from_rotvec(rotation).as_matrix(),
            translation, fisheye,
        )  # fmt: skip
    except CaptureError as error:
        raise CaptureError(
            f"{path}: [{key}]: {error}", code=error.code, **{**error.data, "table": key}
        ) from None


def _shortest(distortions: Any) -> Any:
    """Without trailing zeros that say nothing, and with those that are missing."""
    d = np.trim_zeros(distortions, "b")
    length = next((n for n in (5, 8) if len(d) <= n), len(d))
    return np.append(d, np.zeros(length - len(d)))


def write_rig(path: Path, cameras: Sequence[Camera], metadata: Mapping[str, Any]) -> None:
    """Write cameras, whole or not at all. `metadata` has plain values. Raises CaptureError for
    names that cannot be read again."""
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
