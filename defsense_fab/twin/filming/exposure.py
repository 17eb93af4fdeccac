"""Motion during an exposure: smear while the shutter is open, and the rows of a rolling shutter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.mesh import Surface
from ..scenes.scene import Scene
from .camera_optics import Optics

SHUTTER_ITERATIONS = 3  # of the fixed point between position and readout time
MIN_SMEAR_PX = 0.05  # shorter smears are not rendered
INSTANT_SPACING_PX = 0.5
MAX_INSTANTS = 13


def expose(
    scene_at: Callable[[float], Scene], camera: Camera, time: float, optics: Optics
) -> tuple[Scene, list[Scene]]:
    """Return what a camera sees during an exposure.

    Patches move evenly along a line through their true position in the middle of the exposure, a
    fraction of a pixel from instant to instant; everything else stays. With a rolling shutter each
    patch, the LED and each vertex of the body are as they are when their row is read.

    Args:
        scene_at: Returns the scene at a time, s.
        camera: The camera.
        time: Middle of the exposure, s.
        optics: Exposure time and readout time of the camera.

    Returns:
        The scene in the middle of the exposure, and the scenes at instants of the exposure; the
        list is empty if no patch moves.
    """
    middle = scene_at(time)
    span = max(optics.exposure, optics.readout_time) / 2
    if span <= 0 or not middle.patches:
        return middle, []
    after = scene_at(time + span)
    if len(after.patches) != len(middle.patches):
        return middle, []
    poses, later = (
        np.stack([np.column_stack([p.center, p.axes]) for p in s.patches]) for s in (middle, after)
    )
    speed = (later - poses) / span
    if optics.readout_time:
        delay = np.zeros(len(poses))
        for _ in range(SHUTTER_ITERATIONS):
            centers = poses[:, :, 0] + delay[:, None] * speed[:, :, 0]
            delay = _readout_delay(camera, centers, optics.readout_time)
        poses = poses + delay[:, None, None] * speed
        moved = _place_patches(middle, poses)
        middle = _roll_body_and_led(moved, after, scene_at, camera, time, span, optics)
    half = optics.exposure / 2 * speed
    corners = (
        np.stack([p.corners for p in s.patches])
        for s in (middle, _place_patches(middle, poses + half))
    )
    first, last = (camera.project(c) for c in corners)
    smear = 2 * float(np.nanmax(np.linalg.norm(last - first, axis=-1), initial=0.0))
    if not smear > MIN_SMEAR_PX:
        return middle, []
    count = int(np.clip(np.ceil(smear / INSTANT_SPACING_PX), 2, MAX_INSTANTS))
    # The spacing gives the instants the variance of an even smear.
    offsets = ((2 * np.arange(count) + 1) / count - 1) / np.sqrt(1 - 1 / count**2)
    return middle, [_place_patches(middle, poses + o * half) for o in offsets]


def _place_patches(scene: Scene, poses: Float) -> Scene:
    """Return the scene with its patches at poses (m, 3, 4): centers and approximate axes."""
    placed = zip(scene.patches, poses[:, :, 0], _nearest_rotations(poses[:, :, 1:]), strict=True)
    return scene.replace(patches=tuple(p.moved_to(center, axes) for p, center, axes in placed))


def _readout_delay(camera: Camera, points: Float, readout_time: float) -> Float:
    """Return when the rows of points (n, 3) mm are read, s (n,) after the middle row."""
    height = camera.size[1]
    row = np.nan_to_num(camera.project(points)[:, 1], nan=height / 2)
    return np.asarray(readout_time * (np.clip(row, 0, height) / height - 0.5))


def _roll_body_and_led(
    scene: Scene,
    after: Scene,
    scene_at: Callable[[float], Scene],
    camera: Camera,
    time: float,
    span: float,
    optics: Optics,
) -> Scene:
    """Return the scene with the body and the LED as a rolling shutter sees them."""
    body, led = scene.body, scene.led
    if body is not None and after.body is not None:
        delay = _readout_delay(camera, body.vertices, optics.readout_time)[:, None]
        speed = (after.body.vertices - body.vertices) / span
        body = Surface(body.vertices + delay * speed, body.faces)
    if led is not None:
        led_delay = float(_readout_delay(camera, led.center[None], optics.readout_time)[0])
        led = scene_at(time + led_delay).led
    return scene.replace(body=body, led=led)


def _nearest_rotations(axes: Float) -> Float:
    """Return the rotations (m, 3, 3) nearest to near-rotations, by Newton's method."""
    for _ in range(3):
        axes = axes @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(axes, 1, 2) @ axes)
    return axes
