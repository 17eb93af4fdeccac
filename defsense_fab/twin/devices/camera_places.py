"""Where a twin's cameras stand about a device, and where its read-out board's LED lies."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.markers import Markers
from ...core.mesh import Surface

_FOCAL, _SIZE = 900.0, (1280, 720)
_DISTORTIONS = np.array([0.04, -0.09, 0.0008, -0.0005, 0.01])
_NEAR, _APART = 200.0, 0.45  # mm, at least; distance between cameras, of their distance
_FACES = 0.35  # cosine, at least, at which a camera sees a tag well
_FILLS = 0.55  # of the picture's width, by the body


def camera_places(body: Surface, markers: Markers, count: int) -> tuple[Camera, ...]:
    """From where most tags are seen, side by side."""
    low, high = body.bounds
    middle = (low + high) / 2
    extent = float(np.linalg.norm(high - low))
    away = max(_NEAR, extent * _FOCAL / (_FILLS * _SIZE[0]))
    normals = markers.axes[:, :, 2]
    k = np.arange(400) + 0.5  # spread over the sphere (Fibonacci)
    polar, turn = np.arccos(1 - 2 * k / 400), np.pi * (1 + 5**0.5) * k
    ways = np.column_stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
    )
    longest = np.eye(3)[int((high - low).argmax())]
    asides = longest - (ways @ longest)[:, None] * ways
    along = np.linalg.norm(asides, axis=1) < 0.3  # seen end on
    asides[along] = np.cross(ways[along], np.eye(3)[int(np.abs(longest).argmin())])
    asides /= np.linalg.norm(asides, axis=1, keepdims=True)
    places = (np.arange(count) - (count - 1) / 2) * _APART
    eyes = middle + away * (ways + places[:, None, None] * asides)
    to = eyes[:, :, None] - markers.centers
    facing = np.einsum("cwmi,mi->cwm", to / np.linalg.norm(to, axis=3, keepdims=True), normals)
    facing = facing.min(axis=0)  # by the camera that sees it at the greatest slant
    score = (facing > _FACES).sum(axis=1) + 0.5 * np.clip(facing, 0, 1).sum(axis=1)
    # Three of the anchor's tags lay the others onto the rest pose.
    anchor = (facing[:, markers.anchor] > _FACES).sum(axis=1)
    score = score + 2 * anchor + len(normals) * (anchor >= 3)
    best = int(score.argmax())
    aside = asides[best]
    out = []
    for k_, eye in enumerate(eyes[:, best]):
        z = (middle - eye) / np.linalg.norm(middle - eye)
        y = np.cross(z, aside)
        y /= np.linalg.norm(y)
        R = np.stack([np.cross(y, z), y, z])
        K = np.array(
            [
                [_FOCAL + 3 * k_, 0, _SIZE[0] / 2 + 4],
                [0, _FOCAL + 3 * k_, _SIZE[1] / 2 - 3],
                [0, 0, 1],
            ]
        )
        out.append(Camera(f"cam_{k_}", _SIZE, K, _DISTORTIONS, R, -R @ eye))
    return tuple(out)


def led_place(camera: Camera, body: Surface) -> Float:
    """A place for the LED (3,) mm: above the body as the camera sees it."""
    at = camera.to_camera(body.vertices)
    highest = float((at[:, 1] / at[:, 2]).min())
    depth = float(at[:, 2].mean())
    spot = np.array([at[:, 0].mean(), (highest - 0.08) * depth, depth])
    return np.asarray(camera.rotation.T @ (spot - camera.translation))
