"""What moves while the shutter is open."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from .scene import Scene

_STILL, _STEP, _MOST = 0.05, 0.5, 13  # px: not worth a smear; between instants; instants


def exposed(
    scene_at: Callable[[float], Scene], camera: Camera, time: float, exposure: float
) -> tuple[Scene, list[Scene]]:
    """The scene at a time, s, and its instants while the shutter is open around it; none where no
    patch moves. Patches go evenly along a line through their true place in the middle, a fraction
    of a pixel from instant to instant; all else stays."""
    middle = scene_at(time)
    if exposure <= 0 or not middle.patches:
        return middle, []
    after = scene_at(time + exposure / 2)
    if len(after.patches) != len(middle.patches):
        return middle, []
    poses, later = (
        np.stack([np.column_stack([p.center, p.axes]) for p in s.patches]) for s in (middle, after)
    )
    corners = (np.stack([p.corners for p in s.patches]) for s in (middle, after))
    seen, then = (camera.project(c) for c in corners)
    moved = 2 * float(np.nanmax(np.linalg.norm(then - seen, axis=-1), initial=0.0))
    if not moved > _STILL:
        return middle, []
    count = int(np.clip(np.ceil(moved / _STEP), 2, _MOST))
    # Spread so that the variance is that of an even smear.
    offsets = ((2 * np.arange(count) + 1) / count - 1) / np.sqrt(1 - 1 / count**2)
    instants = []
    for offset in offsets:
        at = poses + offset * (later - poses)
        placed = zip(middle.patches, at[:, :, 0], _square(at[:, :, 1:]), strict=True)
        patches = tuple(patch.moved(center, axes) for patch, center, axes in placed)
        instants.append(middle.moved(patches=patches))
    return middle, instants


def _square(axes: Float) -> Float:
    """The rotations (m, 3, 3) nearest to what is almost one (Newton's method)."""
    for _ in range(3):
        axes = axes @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(axes, 1, 2) @ axes)
    return axes
