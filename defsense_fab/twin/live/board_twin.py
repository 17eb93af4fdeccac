"""Simulated cameras before which a hand shows a calibration board, to rehearse their calibration.

Time is simulated: frames come as fast as they are rendered, and are the same for each seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from ...capture.cameras.image_sources import ImageSource
from ...capture.tags.tag_patterns import CharucoBoard
from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ..filming.camera_kinds import CAMERA_KINDS, DISTORTIONS, FOCAL_PX, IMAGE_SIZE
from ..filming.cameras import RenderedCamera
from ..options import TwinCameras
from ..scenes.scene import Backdrop, Patch, Scene

BOARD_SHARE = 0.4  # of the image's width, by the board where all cameras look
CAMERA_SPACING, MAX_SPREAD = 0.45, 1.2  # of the distance to the board: between two, and in all
FRAME_RATE_HZ = 10.0
HOLD_S, MOVE_S = 0.25, 0.15  # in a position, and on the way to the next
MAX_POSITIONS = 250  # before the hand gives up
TREMOR = 2e-4  # of the board's width, and rad
FACING_CAMERA = np.diag([1.0, -1.0, -1.0])
# Positions of the board, -1 to 1 across the image; its share of the image's width; and directions
# and size of its tilt, degrees. The numbers of positions, widths and tilts have no common divisor,
# so that all their combinations occur.
SPOTS = np.array(
    [(-1, -1), (1, 1), (1, -1), (-1, 1), (0, 0), (0, -1), (1, 0), (0, 1), (-1, 0)], float
)
WIDTHS = (0.55, 0.42, 0.36, 0.48)
TILT_DIRECTIONS = np.array([(1, 0), (0, 1), (-1, 0), (0, -1), (0, 0)], float)
TILT_DEG = 33.0
# Of the positions and widths, if several cameras must see the board at once.
SHARED_SPOTS, SHARED_WIDTHS = 0.4, 0.85
DEFAULT_CAMERAS = TwinCameras()

Pose = tuple[Rotation, Float]


class BoardTwin:
    """Simulated cameras and a hand that shows them a board as it was printed.

    Args:
        board: The board, with its measured size.
        cameras: Number and kind of the cameras, and the seed of everything that is random.

    Attributes:
        cameras: The true cameras.
    """

    def __init__(self, board: CharucoBoard, cameras: TwinCameras = DEFAULT_CAMERAS) -> None:
        seed, count = cameras.seed, cameras.count
        self._optics = CAMERA_KINDS[cameras.kind].optics
        self._width = board.columns * board.scale * board.square
        self._patch, self._seed = _board_patch(board, self._width), seed
        distance = FOCAL_PX * self._width / (BOARD_SHARE * IMAGE_SIZE[0])
        self.cameras = _make_cameras(distance, np.random.default_rng([seed, 0]), count)

    @property
    def distances(self) -> list[float]:
        """Distance of each camera from the first one, mm."""
        return [float(np.linalg.norm(c.center - self.cameras[0].center)) for c in self.cameras]

    def alone(self, name: str) -> ImageSource:
        """Return the images of one camera to which the board is shown."""
        k, camera = self._find_camera(name)
        return self._film(camera, self._show_to_one(camera, 1 + k), 1 + k)

    def together(self, *, again: bool = False) -> Callable[[str], ImageSource]:
        """Return a function that opens cameras by name; the board is shown to all at once.

        Args:
            again: Whether the board is shown in other positions than before.
        """
        number = 200 if again else 100
        scene_at = self.show_to_all(again=again)

        def open_camera(name: str) -> ImageSource:
            k, camera = self._find_camera(name)
            return self._film(camera, scene_at, number + 1 + k)

        return open_camera

    def show_to_all(self, *, again: bool = False) -> Callable[[float], Scene]:
        """Return the scene at a time, s, in which the board is shown to all cameras at once."""
        return self._show(_middle_camera(), 200 if again else 100, is_shared=True)

    def _show_to_one(self, camera: Camera, number: int) -> Callable[[float], Scene]:
        return self._show(camera, number, is_shared=False)

    def _find_camera(self, name: str) -> tuple[int, Camera]:
        return next((k, c) for k, c in enumerate(self.cameras) if c.name == name)

    def _film(self, camera: Camera, scene_at: Callable[[float], Scene], number: int) -> ImageSource:
        rng = np.random.default_rng([self._seed, number, 1])
        return RenderedCamera(camera, scene_at, self._optics, rng, _frame_times(camera.name))

    def _show(self, camera: Camera, number: int, *, is_shared: bool) -> Callable[[float], Scene]:
        def scene_at(time: float) -> Scene:
            k, elapsed = divmod(time, HOLD_S + MOVE_S)
            R, start = self._hold(camera, number, int(k), is_shared=is_shared)
            S, end = self._hold(camera, number, int(k) + 1, is_shared=is_shared)
            s = float(np.clip((elapsed - HOLD_S) / MOVE_S, 0, 1))
            s = s * s * (3 - 2 * s)
            frequencies = np.array([5.1, 6.3, 4.7, 5.7, 4.3, 6.9])  # Hz
            tremor = TREMOR * np.sin(2 * np.pi * frequencies * time)
            turn = Rotation.from_rotvec(tremor[3:] + s * (S * R.inv()).as_rotvec()) * R
            center = start + s * (end - start) + self._width * tremor[:3]
            patch = self._patch.moved_to(center, turn.as_matrix() @ FACING_CAMERA)
            return Scene((patch,), backdrop=Backdrop())

        return scene_at

    def _hold(self, camera: Camera, number: int, k: int, *, is_shared: bool) -> Pose:
        """Return the k-th position of the board before a camera: its rotation and center, mm."""
        width = self._width
        height = width * self._patch.pattern.shape[0] / self._patch.pattern.shape[1]
        rng = np.random.default_rng([self._seed, number, 0, k])
        share = (
            WIDTHS[k % len(WIDTHS)] * rng.uniform(0.92, 1.08) * (SHARED_WIDTHS if is_shared else 1)
        )
        depth = FOCAL_PX * width / (share * IMAGE_SIZE[0])
        board_px = np.array([1, height / width]) * share * IMAGE_SIZE[0]
        room = np.maximum(np.array(IMAGE_SIZE) / 2 - 0.42 * board_px, 0)
        room = room * (SHARED_SPOTS if is_shared else 1)
        spot = SPOTS[k % len(SPOTS)] * room + rng.uniform(-25, 25, 2)
        direction = TILT_DIRECTIONS[k % len(TILT_DIRECTIONS)]
        tilt = direction * TILT_DEG + rng.uniform(-6, 6, 2)
        roll = Rotation.from_rotvec([0, 0, np.radians(rng.uniform(-15, 15))])
        held = Rotation.from_rotvec(np.radians([*tilt, 0])) * roll
        center = np.append(spot / camera.focal * depth, depth)
        turn = Rotation.from_matrix(camera.rotation.T)
        return turn * held, turn.apply(center - camera.translation)


def _frame_times(name: str) -> Iterator[tuple[float, int]]:
    """Yield the times of frames, s, and their stamps, ns; raise once the board was shown enough."""
    for k in range(int(MAX_POSITIONS * (HOLD_S + MOVE_S) * FRAME_RATE_HZ) + 1):
        yield k / FRAME_RATE_HZ, round(k / FRAME_RATE_HZ * 1e9)
    raise CaptureError(
        f"the board was held in {MAX_POSITIONS} positions, and too few of them were good views",
        code="too-few-views",
        where=f"twin camera {name}",
        action="Take fewer views, or use a board with fewer and larger squares",
        camera=name,
    )


def _board_patch(board: CharucoBoard, width: float) -> Patch:
    """Return the board with a rim of half a square."""
    cell = 8 * (board.family.cells + 2 + 7)  # px of a square: tags have whole pixels
    size = (board.columns * cell, board.rows * cell)
    image = np.asarray(board.charuco.generateImage(size, marginSize=0), np.uint8)
    image = np.pad(image, cell // 2, constant_values=255)
    if board.inverted:
        image = 255 - image
    rim = 1 + 1 / board.columns
    return Patch(0, image, np.zeros(3), np.eye(3), width * rim, margin=0.0)


def _middle_camera() -> Camera:
    """Return a camera between all cameras, to whose view the shared positions refer."""
    matrix = _camera_matrix(FOCAL_PX)
    return Camera("middle", IMAGE_SIZE, matrix, np.zeros(5), np.eye(3), np.zeros(3))


def _camera_matrix(focal: float, center: Float | None = None) -> Float:
    x, y = np.array(IMAGE_SIZE) / 2 if center is None else center
    return np.array([[focal, 0, x], [0, focal, y], [0, 0, 1]])


def _make_cameras(distance: float, rng: np.random.Generator, count: int) -> tuple[Camera, ...]:
    """Return cameras side by side that look at the shared positions of the board.

    The board is `distance` mm along the z axis.
    """
    step = min(CAMERA_SPACING, MAX_SPREAD / max(count - 1, 1))
    cameras = []
    for k in range(count):
        eye = distance * np.append(step * (k - (count - 1) / 2), np.zeros(2))
        eye = eye + distance * rng.uniform(-0.03, 0.03, 3)
        z = np.array([0, 0, distance]) + distance * rng.uniform(-0.02, 0.02, 3) - eye
        z /= np.linalg.norm(z)
        right = np.cross([0.0, 1, 0], z)
        right /= np.linalg.norm(right)
        level = np.stack([right, np.cross(z, right), z])
        R = Rotation.from_rotvec([0, 0, rng.uniform(-0.04, 0.04)]).as_matrix() @ level
        focal = FOCAL_PX * rng.uniform(0.94, 1.06)
        K = _camera_matrix(focal, np.array(IMAGE_SIZE) / 2 + rng.uniform(-12, 12, 2))
        distortions = DISTORTIONS * rng.uniform(0.8, 1.2, 5)
        cameras.append(Camera(f"cam_{k}", IMAGE_SIZE, K, distortions, R, -R @ eye))
    return tuple(cameras)
