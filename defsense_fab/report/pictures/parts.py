"""The parts of a device, moved apart."""

from __future__ import annotations

from collections.abc import Mapping

from ...core.arrays import Float
from ...core.mesh import Surface
from ..colors import COLORS
from . import labelled, views
from .scene import Scene


def exploded(parts: Mapping[str, Surface], shifts: Mapping[str, Float], frame: Float) -> str:
    """The parts, each moved by its shift (3,) mm, with their names, from the side that shows them
    best. `frame` (3, 3) says how the body stands."""
    colors = {n: COLORS[i % len(COLORS)] for i, n in enumerate(parts)}
    moved = {n: Surface(s.vertices + shifts[n], s.faces) for n, s in parts.items()}
    with Scene() as scene:
        for name, surface in moved.items():
            scene.solid(surface, colors[name], name=name)
        sides = [views.three_quarter(frame), *views.around(frame)]
        view = labelled.clearest(scene, sides, list(parts))
        centers = {n: s.bounds.mean(0) for n, s in moved.items()}
        return labelled.picture(scene, view, colors, centers)
