"""All that the view shows of a build, as numbers in one text and words in another."""

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
from .followers import CORD, Follower, followers, move_with_parts, openings
from .simplified import light_faces, order_of, simplified

# Arrays of numbers as text inside a page: rounded to integers, deflated, base64.

_ALIGNED = 4  # bytes: where a browser may lay an array of any of these types
_TYPES: dict[str, type[np.integer[Any]]] = {
    "u1": np.uint8,
    "i2": np.int16,
    "u2": np.uint16,
    "u4": np.uint32,
}


class Packed:
    """Arrays in the order in which they are added; each is known by its place."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.index: list[tuple[str, int, int]] = []  #: Type, first byte, numbers of each array.

    def add(self, numbers: Any, kind: str) -> int:
        """Integers as type `kind`, little-endian; what is out of its range is set to its ends.
        Returns the array's place."""
        limits = np.iinfo(_TYPES[kind])
        fit = np.clip(np.rint(np.asarray(numbers)), limits.min, limits.max)
        data = fit.astype(np.dtype(_TYPES[kind]).newbyteorder("<"))
        self._bytes += bytes(-len(self._bytes) % _ALIGNED)
        self.index.append((kind, len(self._bytes), data.size))
        self._bytes += data.tobytes()
        return len(self.index) - 1

    def lengths(self, mm: Float, step: float) -> int:
        """Coordinates or ways (..., 3) mm as multiples of `step` mm, each axis on its own."""
        return self.add(np.moveaxis(np.asarray(mm), -1, 0) / step, "i2")

    def faces(self, faces: Int) -> int:
        """Triangles (f, 3) of vertex numbers, as differences from the one before: of meshes whose
        triangles follow one another these are small."""
        flat = np.asarray(faces, np.int64).ravel()
        steps = np.diff(flat, prepend=0)
        return self.add((steps << 1) ^ (steps >> 63), "u2" if np.ptp(flat) < 2**15 else "u4")

    def shares(self, values: Float, top: float) -> int:
        """Values from 0 to `top` in 255 steps."""
        return self.add(255 * np.asarray(values) / max(top, 1e-12), "u1")

    def text(self) -> str:
        """All arrays: base64 of their deflated bytes, the same for the same numbers."""
        return base64.b64encode(zlib.compress(bytes(self._bytes), 6)).decode("ascii")


# The poses that are played: the simulated shapes on the way to each, and what is read of them.


@dataclass(frozen=True)
class PosePath:
    """From rest to a state: the states (k,) on the way, the state itself last, and how far along
    it they are (k,), up to 1; whether the device was not designed for the state."""

    name: str
    states: Int
    at: Float
    held_out: bool


def pose_paths(found: SurfaceErrors) -> list[PosePath]:
    """Of the states that reports show."""
    return [_path(found, i) for i in found.shown]


def _path(found: SurfaceErrors, state: int) -> PosePath:
    """All states that have the same poses in the same ratio and are not further along."""
    full = found.weights[state]
    at = {k: _fraction(weights, full) for k, weights in enumerate(found.weights)}
    on = sorted((a, k) for k, a in at.items() if a is not None and (a < 1 or k == state))
    return PosePath(
        state_words(full),
        np.array([k for _, k in on]),
        np.array([a for a, _ in on]),
        bool(found.held_out[state]),
    )


def _fraction(weights: Mapping[str, float], full: Mapping[str, float]) -> float | None:
    """How far along the way to `full` a state is; None where it lies on another way."""
    if {p for p, w in weights.items() if w} != {p for p, w in full.items() if w}:
        return None
    some = [weights[pose] / w for pose, w in full.items() if w]
    least, most = min(some), max(some)
    return least if 0 < least <= 1 + 1e-9 and most - least < 1e-6 else None


def moved_points(mesh: TetMesh, points: Float, fields: Float) -> Float:
    """Where points (p, 3) mm of the body at rest go in states with fields (k, n, 3) mm of its mesh:
    their displacements (k, p, 3) mm."""
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    return locator.displacement(locator.find(points), np.ascontiguousarray(fields))


_FINENESS = 20_000  # steps of coordinates along the device's size
_ERROR_STEPS = 2000  # from no error to the largest along an axis
_TOP = 99.5  # per cent of the strains in the states shown: the end of their scale


@dataclass(frozen=True)
class Scene:
    """What the page's script reads: `told`, which JSON can hold, and `numbers` as text, to whose
    arrays it refers by their places."""

    told: Mapping[str, Any]
    numbers: str


def scene(
    device: Device,
    build: Build,
    found: SurfaceErrors,
    frame: Float,
) -> Scene:
    """Return the 3D view of a build: parts, cords, and the body's surface in all poses.

    Args:
        device: The device.
        build: Its build, with parts.
        found: Errors of the build's surface.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.

    Raises:
        StorageError: A result is missing or damaged.
    """
    layout, manifest, parts = build.layout, build.manifest, build.parts
    packed, bounds = Packed(), np.array([s.bounds for s in parts.values()])
    low, high = bounds[:, 0].min(0), bounds[:, 1].max(0)
    size, middle = float(np.linalg.norm(high - low)), (low + high) / 2
    paths = pose_paths(found)
    states = np.unique(np.concatenate([p.states for p in paths]))
    following = followers(device, layout, manifest)
    ways = openings(manifest.assembly, [p.name for p in manifest.parts], size)
    light = simplified(parts, size)
    points = np.concatenate([f.points for f in following])
    gone = moved_points(build.mesh, points, found.fields.displacements[states])
    lengths = _Lengths(packed, middle, size, found.moved[states], gone)
    told = {
        "device": device.name,
        "step": lengths.step,
        "size": size,
        "frame": _rounded(frame),
        "parts": [_part(lengths, p, light[p.name], k) for k, p in enumerate(manifest.parts)],
        "joints": [
            {"join": s.join, "cords": s.cords, "ways": _rounded(w)}
            for s, w in zip(manifest.assembly, ways, strict=True)
        ],
        "followers": _followers(lengths, following, move_with_parts(following, parts, ways), gone),
        "surface": _surface(lengths, found, states),
        "states": _states(build.prediction.signals[1:], found, states),
        "poses": [_pose(p, states) for p in paths],
        "resistances": [_resistance(manifest, s.name) for s in layout.sensors],
    }
    return Scene({**told, "arrays": packed.index}, packed.text())


class _Lengths:
    """Lengths in steps fine enough for a screen, and coarse enough for what moves furthest."""

    def __init__(self, packed: Packed, middle: Float, size: float, *moved: Float) -> None:
        furthest = size + max(float(np.abs(m).max(initial=0.0)) for m in moved)
        self.packed, self._middle = packed, middle
        self.step = float(f"{max(size / _FINENESS, furthest / 32_000):.6g}")

    def places(self, points: Float) -> int:
        return self.packed.lengths(points - self._middle, self.step)

    def ways(self, ways: Float) -> int:
        return self.packed.lengths(ways, self.step)


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
    lengths: _Lengths, following: Sequence[Follower], opened: Sequence[Float], gone: Float
) -> list[dict[str, Any]]:
    pieces = np.split(gone, np.cumsum([len(f.points) for f in following])[:-1], axis=1)
    return [
        {
            "kind": f.kind,
            "name": f.name,
            "color": COLORS[k % len(COLORS)] if f.kind == CORD else None,
            "facts": f.facts,
            "radius": round(f.radius, 4),
            "places": lengths.places(f.points),
            "opened": lengths.ways(o),
            "moved": lengths.ways(m),
        }
        for k, (f, o, m) in enumerate(zip(following, opened, pieces, strict=True))
    ]


def _surface(lengths: _Lengths, found: SurfaceErrors, states: Int) -> dict[str, Any]:
    """The body's simulated surface, and in each state where it goes, how far off it is read
    and how it is strained."""
    faces = light_faces(Surface(found.rest, found.faces), len(states))
    kept = order_of(faces)
    number = np.zeros(len(found.rest), np.int64)
    number[kept] = np.arange(len(kept))
    missed, strain = found.missed[states][:, kept], found.strain[states][:, kept]
    shown = found.strain[list(found.shown)]
    top = float(np.percentile(shown, _TOP))
    missed_step = float(f"{np.abs(missed).max(initial=1e-9) / _ERROR_STEPS:.6g}")
    return {
        "places": lengths.places(found.rest[kept]),
        "faces": lengths.packed.faces(number[faces]),
        "moved": lengths.ways(found.moved[states][:, kept]),
        "missed": lengths.packed.lengths(missed, missed_step),
        "missed_step": missed_step,
        "strain": lengths.packed.shares(strain, top),
        "top_error": float(f"{found.highest:.4g}"),
        "top_strain": float(f"{top:.4g}"),
    }


def _states(signals: Float, found: SurfaceErrors, states: Int) -> list[dict[str, Any]]:
    return [{"name": found.names[s], "signals": _rounded(signals[s])} for s in states]


def _pose(path: PosePath, states: Int) -> dict[str, Any]:
    return {
        "name": path.name,
        "held_out": path.held_out,
        "states": np.searchsorted(states, path.states).tolist(),
        "at": _rounded(path.at),
    }


def _resistance(manifest: Manifest, name: str) -> float:
    """Of a cord at rest in the device, ohm."""
    return next(round(c.resistance, 1) for c in manifest.cords if c.sensor == name)


def _rounded(numbers: Float) -> Any:
    return np.round(np.asarray(numbers, float), 6).tolist()
