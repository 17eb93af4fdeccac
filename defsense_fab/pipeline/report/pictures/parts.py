"""The parts of a device, moved apart, and how they are joined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ....core.arrays import Float
from ....core.mesh import Surface
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


def joining(
    lower: Mapping[str, Surface],
    upper: Mapping[str, Surface],
    colors: Mapping[str, str],
    opens: Float,
    lift: float,
    cords: Sequence[tuple[Float, str, float]],
    pins: Sequence[tuple[Float, float, float]],
) -> str:
    """One step of the assembly: the `upper` parts `lift` mm above the `lower` ones along `opens`
    (3,), cords and wires (line (p, 3) mm, colour, radius) in their grooves, pins (center (3,),
    diameter, length)."""
    moved = {n: Surface(s.vertices + lift * opens, s.faces) for n, s in upper.items()}
    shown = {**lower, **moved}
    with Scene() as scene:
        for name, surface in shown.items():
            scene.solid(surface, colors[name], name=name)
        for line, color, radius in cords:
            scene.tube(line, color, radius)
        for center, diameter, length in pins:
            scene.cylinder(center, opens, diameter, length, "#f4f1de")
        points = np.concatenate([s.vertices for s in [*lower.values(), *upper.values()]])
        flat = points - points @ opens[:, None] * opens
        short = np.linalg.svd(flat - flat.mean(0), full_matrices=False)[2][1]
        side = short if short @ [0.3, -1.0, 0.1] > 0 else -short
        long = np.cross(opens, side)
        view = views.looking(0.75 * side + 0.6 * opens + 0.2 * long, opens)
        return labelled.picture(
            scene,
            view,
            {n: colors[n] for n in shown},
            {n: s.bounds.mean(0) for n, s in shown.items()},
        )
