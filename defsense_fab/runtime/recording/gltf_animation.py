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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.storage.files import replace_file
from ...core.version import __version__
from .animation import Animation, AnimationFile, Float32

# An animation as few shapes with weights that vary over time.
#
# x(t) = rest + sum_k w_k(t) T_k with the principal components T_k of the displacements (Alexa &
# Mueller 2000, Representing animations by principal components): as many as keep every vertex of
# every frame within a tolerance. Found in passes over the frames, so that memory does not grow with
# their number: a basis is widened by what it leaves of each chunk, then turned to its principal
# components.


@dataclass(frozen=True)
class DeformationBasis:
    """`targets` (k, v, 3) mm and `weights` (n, k), 0 to 1, of the animation's frames. The first
    target is always at 1: it brings rest to where all others only add, as programs cut weights
    below 0 off (Blender's shape keys). The others are the principal components, the largest first.
    `error` (mm) is the largest distance of a vertex from where it was recorded, with both as they
    are."""

    targets: Float32
    weights: Float32
    error: float


def deformation_basis(
    animation: Animation, tolerance: float = 0.02, most: int = 128
) -> DeformationBasis:
    """With one to so many (`most`) components; where these do not reach the `tolerance` (mm),
    `error` says what they reach. Raises LiveError where a position is not finite."""
    wide = _span(animation, tolerance / 2, 2 * most)
    gram = np.zeros((len(wide), len(wide)))
    for _, moved in animation.chunks():
        weights = moved @ wide.T
        gram += weights.T @ weights
    turned = np.linalg.eigh(gram)[1].T[::-1] @ wide
    count = min(_needed(animation, turned, tolerance), most)
    while True:
        basis = _written(animation, turned[:count])
        if basis.error <= tolerance or count >= min(most, len(turned)):
            return basis
        count += 1


def _span(animation: Animation, tolerance: float, most: int) -> Float:
    """Orthonormal directions (k, 3v) whose span holds every vertex within a tolerance (mm)."""
    found = np.zeros((1, animation.rest.size))
    found[0, 0] = 1.0  # of an animation without motion
    used = 0
    for _, moved in animation.chunks():
        left = moved - (moved @ found[:used].T) @ found[:used] if used else moved
        left = left[_largest(left) > tolerance]
        while len(left) and used < most:
            # The directions of the frames that are left, from the small matrix of their products.
            values, vectors = np.linalg.eigh(left @ left.T)
            keep = values[::-1] > 1e-12 * values[-1]
            new = vectors.T[::-1][keep] @ left
            new /= np.linalg.norm(new, axis=1, keepdims=True)
            count = _enough(left, new, tolerance)
            new = _orthonormal(new[: min(count, most - used)], found[:used])
            found = np.concatenate([found[:used], new])
            used = len(found)
            left = left - (left @ new.T) @ new
            left = left[_largest(left) > tolerance]
    return found


def _enough(moved: Float, directions: Float, tolerance: float) -> int:
    """How many of orthonormal directions hold every vertex, found by halving; all where none do."""
    low, high = 0, len(directions)
    while high - low > 1:
        middle = (low + high) // 2
        part = directions[:middle]
        within = _largest(moved - (moved @ part.T) @ part).max() <= tolerance
        low, high = (low, middle) if within else (middle, high)
    return high


def _orthonormal(new: Float, found: Float) -> Float:
    """`new` without what rounding left of its products with itself and with what was `found`."""
    for _ in range(2):
        if len(found):
            new = new - (new @ found.T) @ found
        new = np.linalg.qr(new.T)[0].T
    return new


def _needed(animation: Animation, directions: Float, tolerance: float) -> int:
    """The first so many directions that hold all frames, by the frames one after another."""
    count = 1
    for _, moved in animation.chunks():
        left = moved - (moved @ directions[:count].T) @ directions[:count]
        left = left[_largest(left) > tolerance]
        while len(left) and count < len(directions):
            left = left - np.outer(left @ directions[count], directions[count])
            left = left[_largest(left) > tolerance]
            count += 1
    return count


def _written(animation: Animation, directions: Float) -> DeformationBasis:
    """Rounded to float32, with the error that this leaves."""
    weights = np.concatenate([moved @ directions.T for _, moved in animation.chunks()])
    low = weights.min(axis=0)
    scale = weights.max(axis=0) - low
    shares = (weights - low) / np.where(scale > 0, scale, 1.0)
    rounded = np.column_stack([np.ones(len(shares)), shares]).astype(np.float32)
    targets = np.vstack([low @ directions, directions * scale[:, None]]).astype(np.float32)
    error = 0.0
    for part, moved in animation.chunks():
        shown = rounded[part].astype(float) @ targets.astype(float)
        error = max(error, float(_largest(moved - shown).max()))
    return DeformationBasis(targets.reshape(len(targets), -1, 3), rounded, error)


def _largest(moved: Float) -> Float:
    """The largest distance of a vertex (c,) of displacements (c, 3v)."""
    x = moved.reshape(len(moved), -1, 3)
    return np.asarray(np.sqrt(np.einsum("cvi,cvi->cv", x, x).max(axis=1, initial=0.0)))


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
    with replace_file(path) as temporary, temporary.open("wb") as file:
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
