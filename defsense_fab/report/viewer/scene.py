"""All that the view shows of a build, as numbers in one text and words in another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.device import Device
from ...core.mesh import Surface
from ...store.build import Build
from ...store.manifest import Manifest, PartRecord
from ..colors import COLORS
from ..surface_errors import SurfaceErrors
from .followers import CORD, Follower, followers
from .light_surface import light_faces
from .movement import PosePath, moved_points, pose_paths
from .opening import followed, openings
from .packed import Packed
from .simplified import order_of, simplified

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
        "followers": _followers(lengths, following, followed(following, parts, ways), gone),
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
