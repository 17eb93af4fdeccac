"""Collect the data of the 3D view of a build: contents for JSON, and packed arrays of numbers."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.device import Device
from ...core.mesh import Surface, TetMesh
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...store.build import Build
from ...store.manifest import Manifest, PartRecord
from ..pictures.sheet import COLORS
from ..surface_errors import SurfaceErrors, state_words
from .followers import CORD, Follower, follower_movements, followers, joint_movements
from .simplified import decimate_faces, simplify_parts, vertex_order

_ALIGNMENT_BYTES = 4  # at which a browser can place an array of any of these types
_TYPES: dict[str, type[np.integer[Any]]] = {
    "u1": np.uint8,
    "i2": np.int16,
    "u2": np.uint16,
    "u4": np.uint32,
}


class PackedArrays:
    """Arrays of integers in one text: deflated and base64-encoded.

    Attributes:
        index: Type, first byte and number of values of each array.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.index: list[tuple[str, int, int]] = []

    def add(self, numbers: Any, kind: str) -> int:
        """Add an array of integers.

        Args:
            numbers: Numbers; they are rounded, and clipped to the range of the type.
            kind: Type, one of "u1", "i2", "u2" and "u4" (little-endian).

        Returns:
            The array's index.
        """
        limits = np.iinfo(_TYPES[kind])
        clipped = np.clip(np.rint(np.asarray(numbers)), limits.min, limits.max)
        data = clipped.astype(np.dtype(_TYPES[kind]).newbyteorder("<"))
        self._bytes += bytes(-len(self._bytes) % _ALIGNMENT_BYTES)
        self.index.append((kind, len(self._bytes), data.size))
        self._bytes += data.tobytes()
        return len(self.index) - 1

    def lengths(self, mm: Float, step: float) -> int:
        """Add coordinates (..., 3) mm as multiples of `step` mm, axis by axis; return the index."""
        return self.add(np.moveaxis(np.asarray(mm), -1, 0) / step, "i2")

    def faces(self, faces: Int) -> int:
        """Add triangles (f, 3) as differences of consecutive vertex numbers; return the index.

        The differences are small in meshes whose triangles follow one another.
        """
        flat = np.asarray(faces, np.int64).ravel()
        steps = np.diff(flat, prepend=0)
        return self.add((steps << 1) ^ (steps >> 63), "u2" if np.ptp(flat) < 2**15 else "u4")

    def shares(self, values: Float, top: float) -> int:
        """Add values from 0 to `top` in 255 steps; return the index."""
        return self.add(255 * np.asarray(values) / max(top, 1e-12), "u1")

    def text(self) -> str:
        """Return all arrays as text; the same numbers give the same text."""
        return base64.b64encode(zlib.compress(bytes(self._bytes), 6)).decode("ascii")


@dataclass(frozen=True)
class PosePath:
    """The way from rest to a state.

    Attributes:
        name: Name of the state.
        states: Simulated states (k,) on the way; the state itself is the last one.
        at: Position (k,) of these states on the way, up to 1.
        held_out: Whether the layout was optimized without the state.
    """

    name: str
    states: Int
    at: Float
    held_out: bool


def pose_paths(errors: SurfaceErrors) -> list[PosePath]:
    """Return the paths to the states that reports show."""
    return [_path(errors, i) for i in errors.shown]


def _path(errors: SurfaceErrors, state: int) -> PosePath:
    """Return the path to a state: the states with the same poses in the same ratio, up to it."""
    full = errors.weights[state]
    position_by_state = {k: _fraction(weights, full) for k, weights in enumerate(errors.weights)}
    on_path = sorted(
        (a, k) for k, a in position_by_state.items() if a is not None and (a < 1 or k == state)
    )
    return PosePath(
        state_words(full),
        np.array([k for _, k in on_path]),
        np.array([a for a, _ in on_path]),
        bool(errors.held_out[state]),
    )


def _fraction(weights: Mapping[str, float], full: Mapping[str, float]) -> float | None:
    """Return how far along the way to `full` a state is, or None if it is on another way."""
    if {p for p, w in weights.items() if w} != {p for p, w in full.items() if w}:
        return None
    ratios = [weights[pose] / w for pose, w in full.items() if w]
    lowest, highest = min(ratios), max(ratios)
    return lowest if 0 < lowest <= 1 + 1e-9 and highest - lowest < 1e-6 else None


def moved_points(mesh: TetMesh, points: Float, fields: Float) -> Float:
    """Return the displacements of points of a body in simulated states.

    Args:
        mesh: Mesh of the body.
        points: Points (p, 3) of the body at rest, mm.
        fields: Displacements (k, n, 3) of the mesh's nodes, mm.

    Returns:
        Displacements (k, p, 3), mm.
    """
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    return locator.displacement(locator.find(points), np.ascontiguousarray(fields))


_STEPS_PER_SIZE = 20_000  # of coordinates, along the device's size
_STEPS_PER_ERROR = 2000  # of errors, up to the largest one along an axis
_TOP_STRAIN_PERCENTILE = 99.5  # of the strains in the shown states: the end of their scale


@dataclass(frozen=True)
class Scene:
    """Data of the 3D view.

    Attributes:
        content: Contents for JSON; they refer to the arrays by their indices.
        numbers: The packed arrays as text.
    """

    content: Mapping[str, Any]
    numbers: str


def scene(
    device: Device,
    build: Build,
    errors: SurfaceErrors,
    frame: Float,
) -> Scene:
    """Return the 3D view of a build: parts, cords, and the body's surface in all poses.

    Args:
        device: The device.
        build: Its build, with parts.
        errors: Errors of the build's surface.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.

    Raises:
        StorageError: A result is missing or damaged.
    """
    layout, manifest, parts = build.layout, build.manifest, build.parts
    packed, bounds = PackedArrays(), np.array([s.bounds for s in parts.values()])
    low, high = bounds[:, 0].min(0), bounds[:, 1].max(0)
    size, middle = float(np.linalg.norm(high - low)), (low + high) / 2
    paths = pose_paths(errors)
    states = np.unique(np.concatenate([p.states for p in paths]))
    device_followers = followers(device, layout, manifest)
    movements = joint_movements(manifest.assembly, [p.name for p in manifest.parts], size)
    light_parts = simplify_parts(parts, size)
    points = np.concatenate([f.points for f in device_followers])
    displacements = moved_points(build.mesh, points, errors.fields.displacements[states])
    lengths = _Lengths(packed, middle, size, errors.moved[states], displacements)
    content = {
        "device": device.name,
        "step": lengths.step,
        "size": size,
        "frame": _round(frame),
        "parts": [_part(lengths, p, light_parts[p.name], k) for k, p in enumerate(manifest.parts)],
        "joints": [
            {"join": s.join, "cords": s.cords, "ways": _round(w)}
            for s, w in zip(manifest.assembly, movements, strict=True)
        ],
        "followers": _followers(
            lengths,
            device_followers,
            follower_movements(device_followers, parts, movements),
            displacements,
        ),
        "surface": _surface(lengths, errors, states),
        "states": _states(build.prediction.signals[1:], errors, states),
        "poses": [_pose(p, states) for p in paths],
        "resistances": [_resistance(manifest, s.name) for s in layout.sensors],
    }
    return Scene({**content, "arrays": packed.index}, packed.text())


class _Lengths:
    """Packs lengths in steps that suit a screen, and that hold the largest movement.

    Args:
        packed: The arrays.
        middle: Middle (3,) of the device, mm.
        size: Diagonal of the device, mm.
        moved: Displacements (..., 3), mm.
    """

    def __init__(self, packed: PackedArrays, middle: Float, size: float, *moved: Float) -> None:
        max_length = size + max(float(np.abs(m).max(initial=0.0)) for m in moved)
        self.packed, self._middle = packed, middle
        self.step = float(f"{max(size / _STEPS_PER_SIZE, max_length / 32_000):.6g}")

    def places(self, points: Float) -> int:
        return self.packed.lengths(points - self._middle, self.step)

    def movements(self, movements: Float) -> int:
        return self.packed.lengths(movements, self.step)


def _part(lengths: _Lengths, part: PartRecord, surface: Surface, k: int) -> dict[str, Any]:
    x, y, z = part.bbox[1] - part.bbox[0]
    return {
        "name": part.name,
        "color": COLORS[k % len(COLORS)],
        "facts": [
            ("size", f"{x:.1f} × {y:.1f} × {z:.1f} mm"),
            ("volume", f"{part.volume / 1000:.1f} cm³"),
            ("file", f"parts/{part.stl}"),
        ],
        "places": lengths.places(surface.vertices),
        "faces": lengths.packed.faces(surface.faces),
    }


def _followers(
    lengths: _Lengths,
    device_followers: Sequence[Follower],
    movements: Sequence[Float],
    displacements: Float,
) -> list[dict[str, Any]]:
    pieces = np.split(
        displacements, np.cumsum([len(f.points) for f in device_followers])[:-1], axis=1
    )
    return [
        {
            "kind": f.kind,
            "name": f.name,
            "color": COLORS[k % len(COLORS)] if f.kind == CORD else None,
            "facts": f.facts,
            "radius": round(f.radius, 4),
            "places": lengths.places(f.points),
            "opened": lengths.movements(o),
            "moved": lengths.movements(m),
        }
        for k, (f, o, m) in enumerate(zip(device_followers, movements, pieces, strict=True))
    ]


def _surface(lengths: _Lengths, errors: SurfaceErrors, states: Int) -> dict[str, Any]:
    """Return the simulated surface, and its displacement, error and strain in each state."""
    faces = decimate_faces(Surface(errors.rest, errors.faces), len(states))
    vertices = vertex_order(faces)
    number = np.zeros(len(errors.rest), np.int64)
    number[vertices] = np.arange(len(vertices))
    missed, strain = errors.missed[states][:, vertices], errors.strain[states][:, vertices]
    shown = errors.strain[list(errors.shown)]
    top = float(np.percentile(shown, _TOP_STRAIN_PERCENTILE))
    missed_step = float(f"{np.abs(missed).max(initial=1e-9) / _STEPS_PER_ERROR:.6g}")
    return {
        "places": lengths.places(errors.rest[vertices]),
        "faces": lengths.packed.faces(number[faces]),
        "moved": lengths.movements(errors.moved[states][:, vertices]),
        "missed": lengths.packed.lengths(missed, missed_step),
        "missed_step": missed_step,
        "strain": lengths.packed.shares(strain, top),
        "top_error": float(f"{errors.highest:.4g}"),
        "top_strain": float(f"{top:.4g}"),
    }


def _states(signals: Float, errors: SurfaceErrors, states: Int) -> list[dict[str, Any]]:
    return [{"name": errors.names[s], "signals": _round(signals[s])} for s in states]


def _pose(path: PosePath, states: Int) -> dict[str, Any]:
    return {
        "name": path.name,
        "held_out": path.held_out,
        "states": np.searchsorted(states, path.states).tolist(),
        "at": _round(path.at),
    }


def _resistance(manifest: Manifest, name: str) -> float:
    """Return the resistance of a cord in the device at rest, ohm."""
    return next(round(c.resistance, 1) for c in manifest.cords if c.sensor == name)


def _round(numbers: Float) -> Any:
    return np.round(np.asarray(numbers, float), 6).tolist()
