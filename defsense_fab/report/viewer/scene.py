"""Collect the data of the 3D view of a build, and render it as part of a page.

The page opens from a file, without a network.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from markupsafe import Markup

from ...core.arrays import Float, Int
from ...core.device.device import Device
from ...core.mesh import Surface, TetMesh
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...store.build import Build
from ...store.manifest import Manifest, PartRecord
from ..guide.steps import joint_movements
from ..html import render
from ..pictures.sheet import COLORS
from ..surface_errors import SurfaceErrors, state_words
from .compact_data import PackedArrays, decimate_faces, simplify_parts, vertex_order
from .followers import CORD, Follower, follower_movements, followers

_STEPS_PER_SIZE = 20_000  # of coordinates, along the device's size
_STEPS_PER_ERROR = 2000  # of errors, up to the largest one along an axis
_TOP_STRAIN_PERCENTILE = 99.5  # of the strains in the shown states: the end of their scale


@dataclass(frozen=True)
class PosePath:
    """The path from rest to a state.

    Attributes:
        name: Name of the state.
        states: Simulated states (k,) on the path; the state itself is the last one.
        at: Position (k,) of these states on the path, up to 1.
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
    """Return how far along the path to `full` a state is, or None if it is on another path."""
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


@dataclass(frozen=True)
class Scene:
    """Data of the 3D view.

    Attributes:
        content: Contents for JSON; they refer to the arrays by their indices.
        numbers: The packed arrays as text.
    """

    content: Mapping[str, Any]
    numbers: str


def scene(device: Device, build: Build, errors: SurfaceErrors, frame: Float) -> Scene:
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
        "noun": device.cord.noun,
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


def view3d(scene: Scene) -> Markup:
    """Render the view of a scene, for one place in a page.

    Args:
        scene: Data of the view.

    Returns:
        HTML with style, three.js, script and data.
    """
    return Markup(  # noqa: S704  # the template escapes, the files are this package's
        render(
            "viewer/view",
            style=Markup(_built_file("report.css")),  # noqa: S704
            three=Markup(_built_file("three.js")),  # noqa: S704
            script=Markup(_built_file("report.js")),  # noqa: S704
            content=Markup(in_script(scene.content)),  # noqa: S704
            numbers=scene.numbers,
            noun=scene.content["noun"],
        )
    )


def in_script(value: Any) -> str:
    """Return JSON that cannot end or open a tag inside `<script>`, whatever names it holds."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _built_file(name: str) -> str:
    """Return a file of the built front end; its sources are in `studio/web`."""
    return (files("defsense_fab") / "data" / "web" / name).read_text(encoding="utf-8")
