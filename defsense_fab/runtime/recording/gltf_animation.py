"""Animations in glTF 2.0 (Khronos 2021), one binary file with morph targets.

Positions are metres with y up, as glTF has them: x, z, -y of the device's millimetres, written so
and not by a node's scale, so that meshes can be taken out of their scene. The mesh is the surface
at rest; its targets are principal components of the motion (`deformation_basis`), so that the file
grows with vertices plus frames and not with their product. Weights are 0 to 1. Normals are left
out: they would turn with the surface, and readers then shade it flat or work them out themselves.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.storage.files import replacing
from ...core.version import __version__
from .animation import Animation, AnimationFile
from .deformation_basis import deformation_basis

_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UINT = 5126, 5125
_VERTICES, _FACES = 34962, 34963  # what a buffer view is for


def write_gltf(
    path: Path, animation: Animation, tolerance: float = 0.02, most: int = 128
) -> AnimationFile:
    """Every vertex within `tolerance` (mm) of the recording, unless that took more than so many
    targets; `error` of what is returned says what was reached. Raises StorageError, LiveError."""
    basis = deformation_basis(animation, tolerance, most)
    data = _Buffer()
    rest = data.add(_metres(animation.rest), "VEC3", _VERTICES, bounds=True)
    faces = data.add(animation.faces.ravel().astype(np.uint32), "SCALAR", _FACES)
    targets = [data.add(_metres(t), "VEC3", _VERTICES, bounds=True) for t in basis.targets]
    times = data.add(animation.times.astype(np.float32), "SCALAR", bounds=True)
    weights = data.add(basis.weights.ravel(), "SCALAR")
    document = {
        "asset": {"version": "2.0", "generator": f"defsense-fab {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": animation.name}],
        "meshes": [
            {
                "name": animation.name,
                "primitives": [
                    {
                        "attributes": {"POSITION": rest},
                        "indices": faces,
                        "targets": [{"POSITION": target} for target in targets],
                    }
                ],
                "weights": [0.0] * len(targets),
                # What Blender and others call the targets by.
                "extras": {
                    "targetNames": [
                        f"component {k}" if k else "offset" for k in range(len(targets))
                    ]
                },
            }
        ],
        "animations": [
            {
                "name": animation.name,
                "samplers": [{"input": times, "interpolation": "LINEAR", "output": weights}],
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
            }
        ],
        "accessors": data.accessors,
        "bufferViews": data.views,
        "buffers": [{"byteLength": data.size}],
    }
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + data.size
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(struct.pack("<III", _MAGIC, 2, size))
        file.write(struct.pack("<II", len(text), _JSON) + text)
        file.write(struct.pack("<II", data.size, _BIN))
        for block in data.blocks:
            file.write(block)
    frames, seconds = len(animation.steps), float(np.ptp(animation.times))
    return AnimationFile(path, size, frames, seconds, basis.error, len(targets))


class _Buffer:
    """The file's numbers, each array with its view and accessor. All are of four bytes, so that
    each begins where it may."""

    def __init__(self) -> None:
        self.blocks: list[bytes] = []
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(
        self, array: NDArray[Any], kind: str, target: int | None = None, bounds: bool = False
    ) -> int:
        """The number of its accessor."""
        block = array.astype(array.dtype.newbyteorder("<")).tobytes()
        view = {"buffer": 0, "byteOffset": self.size, "byteLength": len(block)}
        if target is not None:
            view["target"] = target
        accessor = {
            "bufferView": len(self.views),
            "componentType": _UINT if array.dtype == np.uint32 else _FLOAT,
            "count": len(array),
            "type": kind,
        }
        if bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.views.append(view)
        self.accessors.append(accessor)
        self.blocks.append(block)
        self.size += len(block)
        return len(self.accessors) - 1


def _metres(vertices: NDArray[Any]) -> NDArray[np.float32]:
    """(v, 3) mm with z up to m with y up."""
    turned = np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)
    return np.asarray(turned / 1000, np.float32)
