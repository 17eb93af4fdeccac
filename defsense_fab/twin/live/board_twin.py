"""A hand that shows a board to simulated cameras: their calibration rehearsed without hardware.

Time is the twin's own: frames come as fast as they are rendered, and are the same for each seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from ...capture.cameras.image_sources import Images
from ...capture.tags.tag_patterns import CharucoBoard
from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ..filming.camera_kinds import CAMERA_KINDS, DEFAULT_CAMERA_KIND
from ..filming.cameras import RenderedCamera
from ..scenes.scene import Backdrop, Patch, Scene

_SIZE, _FOCAL = (1280, 720), 900.0
_DISTORTIONS = np.array([0.04, -0.09, 0.0008, -0.0005, 0.01])
_FILLS = 0.4  # of the picture's width, by the board where all cameras look
_APART, _ROUND = 0.45, 1.2  # of that distance: between two cameras, and all of them at most
_RATE, _STAY, _MOVE = 10.0, 0.25, 0.15  # frames/s; s in a place, and to the next
_TIRES = 250  # places after which the hand gives up
_TREMOR = 2e-4  # of the board's width, and rad
_UPRIGHT = np.diag([1.0, -1.0, -1.0])  # a picture that faces the camera
#: Where a board is held, -1 to 1 across the picture; how much of its width it fills; which way it
#: is tilted, and by how much, degrees. Their numbers have no common divisor, so that all go with
#: all.
_SPOTS = np.array(
    [(-1, -1), (1, 1), (1, -1), (-1, 1), (0, 0), (0, -1), (1, 0), (0, 1), (-1, 0)], float
)
_WIDTHS = (0.55, 0.42, 0.36, 0.48)
_WAYS, _TILT = np.array([(1, 0), (0, 1), (-1, 0), (0, -1), (0, 0)], float), 33.0
_TOGETHER, _BACK = 0.4, 0.85  # of the spots and widths, where several cameras must see the board

Pose = tuple[Rotation, Float]


class BoardTwin:
    """`cameras` of a `kind`, the truth, before which a hand holds a board as it was printed (and
    measured)."""

    def __init__(
        self, board: CharucoBoard, seed: int = 1, count: int = 2, kind: str = DEFAULT_CAMERA_KIND
    ) -> None:
        self._optics = CAMERA_KINDS[kind].optics
        self._width = board.columns * board.scale * board.square
        self._patch, self._seed = _picture(board, self._width), seed
        self._away = _FOCAL * self._width / (_FILLS * _SIZE[0])
        self.cameras = _cameras(self._away, np.random.default_rng([seed, 0]), count)

    @property
    def distances(self) -> list[float]:
        """Of each camera from the first one, mm."""
        return [float(np.linalg.norm(c.center - self.cameras[0].center)) for c in self.cameras]

    def alone(self, name: str) -> Images:
        """Frames of one camera, which the board is shown to."""
        k, camera = self._camera(name)
        return self._filmed(camera, self._hand(camera, 1 + k, several=False), 1 + k)

    def together(self, *, again: bool = False) -> Callable[[str], Images]:
        """Opens cameras by name, which the board is shown to all at once; `again`, in other
        places."""
        number = 200 if again else 100
        hand = self._hand(_middle(), number, several=True)

        def opened(name: str) -> Images:
            k, camera = self._camera(name)
            return self._filmed(camera, hand, number + 1 + k)

        return opened

    def _camera(self, name: str) -> tuple[int, Camera]:
        return next((k, c) for k, c in enumerate(self.cameras) if c.name == name)

    def _filmed(self, camera: Camera, hand: Callable[[float], Scene], number: int) -> Images:
        rng = np.random.default_rng([self._seed, number, 1])
        return RenderedCamera(camera, hand, self._optics, rng, _moments(camera.name))

    def _hand(self, camera: Camera, number: int, *, several: bool) -> Callable[[float], Scene]:
        """The board at a time, s, as it is held before a camera."""
        p, w = self._patch, self._width
        height = w * p.pattern.shape[0] / p.pattern.shape[1]

        def place(k: int) -> Pose:
            rng = np.random.default_rng([self._seed, number, 0, k])
            fills = _WIDTHS[k % len(_WIDTHS)] * rng.uniform(0.92, 1.08) * (_BACK if several else 1)
            depth = _FOCAL * w / (fills * _SIZE[0])
            px = np.array([1, height / w]) * fills * _SIZE[0]  # of the board
            room = np.maximum(np.array(_SIZE) / 2 - 0.42 * px, 0) * (_TOGETHER if several else 1)
            at = _SPOTS[k % len(_SPOTS)] * room + rng.uniform(-25, 25, 2)
            tilt = _WAYS[k % len(_WAYS)] * _TILT + rng.uniform(-6, 6, 2)
            held = Rotation.from_rotvec(np.radians([*tilt, 0])) * Rotation.from_rotvec(
                [0, 0, np.radians(rng.uniform(-15, 15))]
            )
            there = np.append(at / camera.focal * depth, depth)
            turn = Rotation.from_matrix(camera.rotation.T)
            return turn * held, turn.apply(there - camera.translation)

        def scene_at(time: float) -> Scene:
            k, rest = divmod(time, _STAY + _MOVE)
            (R, at), (S, to) = place(int(k)), place(int(k) + 1)
            s = float(np.clip((rest - _STAY) / _MOVE, 0, 1))
            s = s * s * (3 - 2 * s)
            shake = _TREMOR * np.sin(2 * np.pi * np.array([5.1, 6.3, 4.7, 5.7, 4.3, 6.9]) * time)
            turn = Rotation.from_rotvec(shake[3:] + s * (S * R.inv()).as_rotvec()) * R
            where = at + s * (to - at) + w * shake[:3]
            return Scene((p.moved_to(where, turn.as_matrix() @ _UPRIGHT),), backdrop=Backdrop())

        return scene_at


def _moments(name: str) -> Iterator[tuple[float, int]]:
    """When pictures are taken. Raises CaptureError where the board was shown long enough."""
    for k in range(int(_TIRES * (_STAY + _MOVE) * _RATE) + 1):
        yield k / _RATE, round(k / _RATE * 1e9)
    raise CaptureError(
        f"twin camera {name}: the board was held in {_TIRES} places, and too few were good views of"
        " it; take fewer (--views), or a board with fewer and larger squares"
    )


def _picture(board: CharucoBoard, width: float) -> Patch:
    """The board with a rim of half a square."""
    cell = 8 * (board.family.cells + 2 + 7)  # px of a square, so that tags have whole ones
    size = (board.columns * cell, board.rows * cell)
    image = np.asarray(board.charuco.generateImage(size, marginSize=0), np.uint8)
    image = np.pad(image, cell // 2, constant_values=255)
    if board.inverted:
        image = 255 - image
    rim = 1 + 1 / board.columns
    return Patch(0, image, np.zeros(3), np.eye(3), width * rim, margin=0.0)


def _middle() -> Camera:
    """Of no picture: how the hand sees where all cameras look."""
    return Camera("middle", _SIZE, _lens(_FOCAL), np.zeros(5), np.eye(3), np.zeros(3))


def _lens(focal: float, center: Float | None = None) -> Float:
    x, y = np.array(_SIZE) / 2 if center is None else center
    return np.array([[focal, 0, x], [0, focal, y], [0, 0, 1]])


def _cameras(away: float, rng: np.random.Generator, count: int) -> tuple[Camera, ...]:
    """Side by side, looking about where the board is held when all of them see it: `away` mm along
    the z axis."""
    step = min(_APART, _ROUND / max(count - 1, 1))
    out = []
    for k in range(count):
        eye = away * np.append(step * (k - (count - 1) / 2), np.zeros(2))
        eye = eye + away * rng.uniform(-0.03, 0.03, 3)
        z = np.array([0, 0, away]) + away * rng.uniform(-0.02, 0.02, 3) - eye
        z /= np.linalg.norm(z)
        right = np.cross([0.0, 1, 0], z)
        right /= np.linalg.norm(right)
        level = np.stack([right, np.cross(z, right), z])
        R = Rotation.from_rotvec([0, 0, rng.uniform(-0.04, 0.04)]).as_matrix() @ level
        K = _lens(_FOCAL * rng.uniform(0.94, 1.06), np.array(_SIZE) / 2 + rng.uniform(-12, 12, 2))
        bent = _DISTORTIONS * rng.uniform(0.8, 1.2, 5)
        out.append(Camera(f"cam_{k}", _SIZE, K, bent, R, -R @ eye))
    return tuple(out)
