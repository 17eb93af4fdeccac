"""What moves while the shutter is open, or goes on from row to row."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.mesh import Surface
from ..scenes.scene import Scene
from .camera_optics import Optics

_ROUNDS = 3
_STILL, _STEP, _MOST = 0.05, 0.5, 13  # px: not worth a smear; between instants; instants


def expose(
    scene_at: Callable[[float], Scene], camera: Camera, time: float, optics: Optics
) -> tuple[Scene, list[Scene]]:
    """The scene at a time, s, and its instants while the shutter is open around it; none where no
    patch moves. Patches go evenly along a line through their true place in the middle, a fraction
    of a pixel from instant to instant; all else stays. Of a rolling shutter each patch, the LED and
    each vertex of the body are as they are when the row that they are seen in is read."""
    middle = scene_at(time)
    span = max(optics.exposure, optics.rolling) / 2
    if span <= 0 or not middle.patches:
        return middle, []
    after = scene_at(time + span)
    if len(after.patches) != len(middle.patches):
        return middle, []
    poses, later = (
        np.stack([np.column_stack([p.center, p.axes]) for p in s.patches]) for s in (middle, after)
    )
    speed = (later - poses) / span
    if optics.rolling:
        when = np.zeros(len(poses))
        for _ in range(_ROUNDS):  # where a patch is when its row is read
            at = poses[:, :, 0] + when[:, None] * speed[:, :, 0]
            when = _read_at(camera, at, optics.rolling)
        poses = poses + when[:, None, None] * speed
        middle = _rolled(_placed(middle, poses), after, scene_at, camera, time, span, optics)
    half = optics.exposure / 2 * speed
    corners = (
        np.stack([p.corners for p in s.patches]) for s in (middle, _placed(middle, poses + half))
    )
    seen, then = (camera.project(c) for c in corners)
    moved = 2 * float(np.nanmax(np.linalg.norm(then - seen, axis=-1), initial=0.0))
    if not moved > _STILL:
        return middle, []
    count = int(np.clip(np.ceil(moved / _STEP), 2, _MOST))
    # Spread so that the variance is that of an even smear.
    offsets = ((2 * np.arange(count) + 1) / count - 1) / np.sqrt(1 - 1 / count**2)
    return middle, [_placed(middle, poses + o * half) for o in offsets]


def _placed(scene: Scene, poses: Float) -> Scene:
    """With its patches at `poses` (m, 3, 4): centers and, nearly, axes."""
    at = zip(scene.patches, poses[:, :, 0], _square(poses[:, :, 1:]), strict=True)
    return scene.moved(patches=tuple(patch.moved(center, axes) for patch, center, axes in at))


def _read_at(camera: Camera, points: Float, rolling: float) -> Float:
    """s (n,) after the middle row's that the rows of points (n, 3) mm are read."""
    height = camera.size[1]
    row = np.nan_to_num(camera.project(points)[:, 1], nan=height / 2)
    return np.asarray(rolling * (np.clip(row, 0, height) / height - 0.5))


def _rolled(
    scene: Scene, after: Scene, scene_at: Callable[[float], Scene], camera: Camera, time: float,
    span: float, optics: Optics,
) -> Scene:  # fmt: skip
    """With body and LED as a rolling shutter sees them."""
    body, led = scene.body, scene.led
    if body is not None and after.body is not None:
        when = _read_at(camera, body.vertices, optics.rolling)[:, None]
        way = (after.body.vertices - body.vertices) / span
        body = Surface(body.vertices + when * way, body.faces)
    if led is not None:
        led = scene_at(time + float(_read_at(camera, led.center[None], optics.rolling)[0])).led
    return scene.moved(body=body, led=led)


def _square(axes: Float) -> Float:
    """The rotations (m, 3, 3) nearest to what is almost one (Newton's method)."""
    for _ in range(3):
        axes = axes @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(axes, 1, 2) @ axes)
    return axes
