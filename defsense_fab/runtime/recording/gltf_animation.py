"""Write animations in glTF 2.0 (Khronos 2021), as one binary file with morph targets.

Positions are in meters with y up, as glTF prescribes: x, z, -y of the device's millimeters. They
are converted rather than scaled by a node, so that meshes can be taken out of their scene. The mesh
is the surface at rest. Its targets are principal components of the motion (`deformation_basis`), so
that the file grows with vertices plus frames, not with their product. Weights are 0 to 1. Normals
are omitted: they would turn with the surface; readers shade it flat or compute normals themselves.
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


@dataclass(frozen=True)
class DeformationBasis:
    """An animation as a few shapes with weights that vary over time.

    The first target always has the weight 1: it offsets the rest so that all other targets are
    only added, because programs clip negative weights (Blender's shape keys). The others are the
    principal components, the largest first.

    Attributes:
        targets: Shapes (k, v, 3), mm.
        weights: Weights (n, k) of the animation's frames, 0 to 1.
        error: Largest distance of a vertex from where it was recorded, mm, with the rounding of
            both.
    """

    targets: Float32
    weights: Float32
    error: float


def deformation_basis(
    animation: Animation, tolerance: float = 0.02, max_targets: int = 128
) -> DeformationBasis:
    """Return the principal components that keep every vertex of every frame within a tolerance.

    x(t) = rest + sum_k w_k(t) T_k with the principal components T_k of the displacements. The
    frames are read in several passes, so that memory does not grow with their number: a basis is
    extended by the residual of each chunk, then rotated to its principal components.

    Args:
        animation: The animation.
        tolerance: Largest distance of a vertex from where it was recorded, mm.
        max_targets: Largest number of components, at least 1. If it does not suffice, `error` is
            larger than the tolerance.

    Raises:
        LiveError: A position is not finite.

    References:
        Alexa, Mueller: Representing animations by principal components, 2000.
    """
    span = _spanning_directions(animation, tolerance / 2, 2 * max_targets)
    gram = np.zeros((len(span), len(span)))
    for _, displacements in animation.chunks():
        weights = displacements @ span.T
        gram += weights.T @ weights
    components = np.linalg.eigh(gram)[1].T[::-1] @ span
    count = min(_needed_directions(animation, components, tolerance), max_targets)
    while True:
        basis = _rounded_basis(animation, components[:count])
        if basis.error <= tolerance or count >= min(max_targets, len(components)):
            return basis
        count += 1


def _spanning_directions(animation: Animation, tolerance: float, max_targets: int) -> Float:
    """Return orthonormal directions (k, 3v) that span all frames within a tolerance (mm)."""
    directions = np.zeros((1, animation.rest.size))
    directions[0, 0] = 1.0  # for an animation without motion
    count_used = 0
    for _, displacements in animation.chunks():
        residual = (
            displacements - (displacements @ directions[:count_used].T) @ directions[:count_used]
            if count_used
            else displacements
        )
        residual = residual[_largest_distance(residual) > tolerance]
        while len(residual) and count_used < max_targets:
            # The directions of the remaining frames, from the small matrix of their products.
            values, vectors = np.linalg.eigh(residual @ residual.T)
            keep = values[::-1] > 1e-12 * values[-1]
            new = vectors.T[::-1][keep] @ residual
            new /= np.linalg.norm(new, axis=1, keepdims=True)
            count = _sufficient_count(residual, new, tolerance)
            new = _orthonormal(new[: min(count, max_targets - count_used)], directions[:count_used])
            directions = np.concatenate([directions[:count_used], new])
            count_used = len(directions)
            residual = residual - (residual @ new.T) @ new
            residual = residual[_largest_distance(residual) > tolerance]
    return directions


def _sufficient_count(displacements: Float, directions: Float, tolerance: float) -> int:
    """Return, by bisection, how many of the orthonormal directions are needed; all at most."""
    low, high = 0, len(directions)
    while high - low > 1:
        middle = (low + high) // 2
        part = directions[:middle]
        within = (
            _largest_distance(displacements - (displacements @ part.T) @ part).max() <= tolerance
        )
        low, high = (low, middle) if within else (middle, high)
    return high


def _orthonormal(new: Float, directions: Float) -> Float:
    """Orthonormalize `new` among itself and against `directions`, twice because of rounding."""
    for _ in range(2):
        if len(directions):
            new = new - (new @ directions.T) @ directions
        new = np.linalg.qr(new.T)[0].T
    return new


def _needed_directions(animation: Animation, directions: Float, tolerance: float) -> int:
    """Return how many leading directions keep all frames within the tolerance."""
    count = 1
    for _, displacements in animation.chunks():
        residual = displacements - (displacements @ directions[:count].T) @ directions[:count]
        residual = residual[_largest_distance(residual) > tolerance]
        while len(residual) and count < len(directions):
            residual = residual - np.outer(residual @ directions[count], directions[count])
            residual = residual[_largest_distance(residual) > tolerance]
            count += 1
    return count


def _rounded_basis(animation: Animation, directions: Float) -> DeformationBasis:
    """Return the basis rounded to float32, with the resulting error."""
    weights = np.concatenate(
        [displacements @ directions.T for _, displacements in animation.chunks()]
    )
    low = weights.min(axis=0)
    scale = weights.max(axis=0) - low
    shares = (weights - low) / np.where(scale > 0, scale, 1.0)
    rounded = np.column_stack([np.ones(len(shares)), shares]).astype(np.float32)
    targets = np.vstack([low @ directions, directions * scale[:, None]]).astype(np.float32)
    error = 0.0
    for part, displacements in animation.chunks():
        rounded_shapes = rounded[part].astype(float) @ targets.astype(float)
        error = max(error, float(_largest_distance(displacements - rounded_shapes).max()))
    return DeformationBasis(targets.reshape(len(targets), -1, 3), rounded, error)


def _largest_distance(displacements: Float) -> Float:
    """Return the largest displacement of a vertex (c,), of displacements (c, 3v)."""
    x = displacements.reshape(len(displacements), -1, 3)
    return np.asarray(np.sqrt(np.einsum("cvi,cvi->cv", x, x).max(axis=1, initial=0.0)))


_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UINT = 5126, 5125
_VERTICES, _FACES = 34962, 34963  # targets of buffer views


def write_gltf(
    path: Path, animation: Animation, tolerance: float = 0.02, max_targets: int = 128
) -> AnimationFile:
    """Write an animation as a .glb file.

    Args:
        path: The file.
        animation: The animation.
        tolerance: Largest distance of a vertex from where it was recorded, mm, unless that needs
            more than `max_targets`.
        max_targets: Largest number of morph targets.

    Returns:
        The file, with the error that was reached.

    Raises:
        StorageError: The file cannot be written.
        LiveError: A position is not finite.
    """
    basis = deformation_basis(animation, tolerance, max_targets)
    data = _Buffer()
    document = _describe(animation, basis, data)
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
    return AnimationFile(path, size, frames, seconds, basis.error, len(basis.targets))


def _describe(animation: Animation, basis: DeformationBasis, data: _Buffer) -> dict[str, Any]:
    """Add the arrays to the buffer, and return the glTF document that describes them."""
    rest = data.add(_to_gltf(animation.rest), "VEC3", _VERTICES, bounds=True)
    faces = data.add(animation.faces.ravel().astype(np.uint32), "SCALAR", _FACES)
    targets = [data.add(_to_gltf(t), "VEC3", _VERTICES, bounds=True) for t in basis.targets]
    times = data.add(animation.times.astype(np.float32), "SCALAR", bounds=True)
    weights = data.add(basis.weights.ravel(), "SCALAR")
    surface = {
        "attributes": {"POSITION": rest},
        "indices": faces,
        "targets": [{"POSITION": target} for target in targets],
    }
    # Blender and others show these names for the targets.
    target_names = [f"component {k}" if k else "offset" for k in range(len(targets))]
    return {
        "asset": {"version": "2.0", "generator": f"defsense-fab {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": animation.name}],
        "meshes": [
            {
                "name": animation.name,
                "primitives": [surface],
                "weights": [0.0] * len(targets),
                "extras": {"targetNames": target_names},
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


class _Buffer:
    """The arrays of a file, each with its view and accessor.

    All numbers have four bytes, so that each array is aligned.
    """

    def __init__(self) -> None:
        self.blocks: list[bytes] = []
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(
        self, array: NDArray[Any], kind: str, target: int | None = None, bounds: bool = False
    ) -> int:
        """Add an array and return the number of its accessor."""
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


def _to_gltf(vertices: NDArray[Any]) -> NDArray[np.float32]:
    """Convert vertices (v, 3) from mm with z up to m with y up."""
    components = np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)
    return np.asarray(components / 1000, np.float32)
