"""A device before simulated cameras: the places of cameras and LED, and the scenes to film."""

from __future__ import annotations

import numpy as np

from ...capture.tags.tag_patterns import dictionary
from ...core.arrays import Float
from ...core.camera import Camera
from ...core.markers import Markers
from ...core.mesh import Surface
from ..filming.camera_kinds import (
    DISTORTIONS,
    FOCAL_PX,
    IMAGE_SIZE,
    CameraKind,
    print_patch,
    simulate_passing_finger,
)
from ..scenes.device_motion import draw_sway
from ..scenes.device_twin import DeviceTwin
from ..scenes.scene import Backdrop, Ball, Led, Patch, Scene

MIN_DISTANCE_MM = 200.0
CAMERA_SPACING = 0.45  # distance between cameras, relative to their distance from the body
MIN_FACING_COSINE = 0.35  # between the normal of a tag and the direction to a camera
BODY_SHARE = 0.55  # of the width of the image
DIRECTIONS = 400  # candidate directions, spread over the sphere (Fibonacci)
MIN_ANCHOR_TAGS = 3  # align the tags with the rest pose
LED_ABOVE = 0.08  # above the body, in the plane at depth one
LED_RADIUS_MM = 3.0


class FilmedDevice:
    """A device with printed tags, which a hand holds before cameras.

    Args:
        rest: Surface of the body at rest, n vertices, mm.
        fields: Displacements (s, n, 3) mm of the vertices in each state.
        markers: The tags as they are designed.
        kind: Kind of the cameras.
        count: Number of cameras.
        sway: Extent of the sway of the hand, mm and degrees.
        rng: Random generator of the sway and of the finger.

    Attributes:
        cameras: The cameras, named `cam_0`, `cam_1`, ...
    """

    def __init__(
        self,
        rest: Surface,
        fields: Float,
        markers: Markers,
        kind: CameraKind,
        count: int,
        sway: float,
        rng: np.random.Generator,
    ) -> None:
        family = dictionary(markers.dictionary)
        tags = tuple(
            print_patch(
                Patch(int(n), family.pattern(int(n)), c, a, markers.size), kind.ink, kind.curl
            )
            for n, c, a in zip(markers.ids, markers.centers, markers.axes, strict=True)
        )
        self._twin = DeviceTwin(rest, fields, tags)
        self.cameras = place_cameras(rest, markers, count)
        self._led_position = place_led(self.cameras[0], rest)
        middle = rest.bounds.mean(axis=0)
        self._sway = draw_sway(rng, middle, shift=sway, degrees=sway)
        self._surroundings = Scene(backdrop=Backdrop(), gloss=kind.gloss)
        towards = np.mean([c.center for c in self.cameras], axis=0) - middle
        towards /= np.linalg.norm(towards)
        self._finger_at = (
            simulate_passing_finger(rng, rest.bounds, towards) if kind.passing else _no_finger
        )

    def scene(self, weights: Float, seconds: float, *, is_led_on: bool) -> Scene:
        """Return the scene at a time, s, in a mixture of states by weights (s,)."""
        scene = self._twin.scene(weights, self._sway.pose_at(seconds), self._surroundings)
        return scene.replace(
            occluders=self._finger_at(seconds),
            led=Led(self._led_position, is_led_on, radius=LED_RADIUS_MM),
        )


def _no_finger(_: float) -> tuple[Ball, ...]:
    return ()


def place_cameras(body: Surface, markers: Markers, count: int) -> tuple[Camera, ...]:
    """Place cameras side by side where they see most tags.

    Args:
        body: Surface of the body at rest, mm.
        markers: The tags.
        count: Number of cameras.

    Returns:
        Cameras named `cam_0`, `cam_1`, ...
    """
    low, high = body.bounds
    middle = (low + high) / 2
    extent = float(np.linalg.norm(high - low))
    distance = max(MIN_DISTANCE_MM, extent * FOCAL_PX / (BODY_SHARE * IMAGE_SIZE[0]))
    directions = _spread_directions()
    longest = np.eye(3)[int((high - low).argmax())]
    asides = longest - (directions @ longest)[:, None] * directions
    is_end_on = np.linalg.norm(asides, axis=1) < 0.3
    asides[is_end_on] = np.cross(directions[is_end_on], np.eye(3)[int(np.abs(longest).argmin())])
    asides /= np.linalg.norm(asides, axis=1, keepdims=True)
    offsets = (np.arange(count) - (count - 1) / 2) * CAMERA_SPACING
    eyes = middle + distance * (directions + offsets[:, None, None] * asides)
    best = int(_score_views(eyes, markers).argmax())
    return tuple(_aim_camera(k, eye, middle, asides[best]) for k, eye in enumerate(eyes[:, best]))


def _spread_directions() -> Float:
    """Return unit vectors (n, 3) spread over the sphere."""
    k = np.arange(DIRECTIONS) + 0.5
    polar, turn = np.arccos(1 - 2 * k / DIRECTIONS), np.pi * (1 + 5**0.5) * k
    return np.column_stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
    )


def _score_views(eyes: Float, markers: Markers) -> Float:
    """Return a score (n,) of n placements of c cameras, with centers (c, n, 3) mm."""
    normals = markers.axes[:, :, 2]
    to = eyes[:, :, None] - markers.centers
    facing = np.einsum("cwmi,mi->cwm", to / np.linalg.norm(to, axis=3, keepdims=True), normals)
    facing = facing.min(axis=0)  # of the camera that sees the tag at the greatest slant
    score = (facing > MIN_FACING_COSINE).sum(axis=1) + 0.5 * np.clip(facing, 0, 1).sum(axis=1)
    anchor = (facing[:, markers.anchor] > MIN_FACING_COSINE).sum(axis=1)
    return np.asarray(score + 2 * anchor + len(normals) * (anchor >= MIN_ANCHOR_TAGS))


def _aim_camera(number: int, eye: Float, target: Float, aside: Float) -> Camera:
    """Return a camera at a point (3,) mm that looks at another, with `aside` horizontal."""
    z = (target - eye) / np.linalg.norm(target - eye)
    y = np.cross(z, aside)
    y /= np.linalg.norm(y)
    R = np.stack([np.cross(y, z), y, z])
    focal = FOCAL_PX + 3 * number
    K = np.array([[focal, 0, IMAGE_SIZE[0] / 2 + 4], [0, focal, IMAGE_SIZE[1] / 2 - 3], [0, 0, 1]])
    return Camera(f"cam_{number}", IMAGE_SIZE, K, DISTORTIONS, R, -R @ eye)


def place_led(camera: Camera, body: Surface) -> Float:
    """Return a position (3,) mm for the LED, above the body as the camera sees it."""
    points = camera.to_camera(body.vertices)
    highest = float((points[:, 1] / points[:, 2]).min())
    depth = float(points[:, 2].mean())
    position = np.array([points[:, 0].mean(), (highest - LED_ABOVE) * depth, depth])
    return np.asarray(camera.rotation.T @ (position - camera.translation))
