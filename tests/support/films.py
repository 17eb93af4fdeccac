"""Films for tests: moving tags, and boards held before cameras."""

import json

import cv2
import numpy as np

from defsense_fab.capture.tags.tag_patterns import CharucoBoard, dictionary
from defsense_fab.cli.main import main
from defsense_fab.core.camera import Camera
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.scenes.scene import Patch, Scene
from tests.twin.film import Shutter, record_film
from tests.twin.views import turn

UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
SIZE = 22.0
BOARD = CharucoBoard(square=30.0, marker=21.0, measured=30.0)


def camera(name, eye, lens=(-0.12, 0.05, 0.001, -0.0005, 0.0)):
    """Return a camera at `eye` (3,) mm that looks at the origin."""
    eye = np.array(eye, float)
    ahead = -eye / np.linalg.norm(eye)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    matrix = np.array([[340.0, 0, 243], [0, 341.0, 177], [0, 0, 1]])
    return Camera(name, (480, 360), matrix, np.array(lens), rotation, -rotation @ eye)


LEFT = camera("left", (-60, -300, 0))
RIGHT = camera("right", (60, -300, 0), (-0.1, 0.03, -0.0008, 0.0006, 0.0))


def tags(t, numbers=range(6), family="4X4_50"):
    """Return six tags on an object that moves and bends, at a time, s."""
    R = turn(0.2 * np.sin(1.7 * t), 0.16 * np.sin(1.1 * t + 1), 0.24 * np.sin(0.9 * t))
    shift = [20 * np.sin(2.1 * t), 16 * np.sin(1.3 * t), 25 * np.sin(2.9 * t + 2)]
    patches = []
    for i, number in enumerate(numbers):
        x, z = 42.0 * (i % 3 - 1), 42.0 * (i // 3 - 0.5)
        axes = R @ turn(0.25 * np.sin(2.3 * i), 0, 0.3 * np.cos(1.7 * i)) @ UPRIGHT
        place = R @ np.array([x, 5 * np.sin(x / 40 + 2 * t), z]) + shift
        patches.append(Patch(number, dictionary(family).pattern(number), place, axes, SIZE))
    return tuple(patches)


def squares(board, cell=20):
    """Return the image of a board with `cell` pixels per square."""
    picture = np.full((board.rows * cell, board.columns * cell), 255, np.uint8)
    for r in range(board.rows):
        for c in range(r % 2, board.columns, 2):
            picture[r * cell : (r + 1) * cell, c * cell : (c + 1) * cell] = 0
    for number, corners in zip(board.charuco.getIds(), board.charuco.getObjPoints(), strict=True):
        x, y = np.round(corners.min(0)[:2] / board.square * cell).astype(int)
        tag = board.family.pattern(int(number))
        tag = np.kron(tag, np.ones((2, 2), np.uint8))
        picture[y : y + len(tag), x : x + len(tag)] = tag
    return picture


PICTURE, SHUTTER = squares(BOARD), Shutter()


def board_scene(k, spread=1.0):
    """Return the scene with the board in its k-th position."""
    rng = np.random.default_rng(100 + k)
    tilt = rng.uniform(-0.75, 0.75, 2)
    axes = turn(tilt[0], 0, tilt[1]) @ UPRIGHT @ turn(z=rng.uniform(-0.4, 0.4))
    center = rng.uniform([-90, -20, -60], [90, 140, 60]) * spread
    return Scene((Patch(0, PICTURE, center, axes, 7 * 30.0, 4.0),))


def take(path, camera, scene_at, duration=0.6, shutter=SHUTTER, seed=1, codec="FFV1"):
    """Record a film of a scene, without motion of the camera."""
    return record_film(
        path, camera, scene_at, duration, shutter, Optics(), np.random.default_rng(seed), codec
    )


def images(path):
    """Return all images of a video."""
    video, out = cv2.VideoCapture(str(path)), []
    while True:
        good, image = video.read()
        if not good:
            return out
        out.append(image)


def aligned(points, truth):
    """Return the distances (n,) of points after the best rigid alignment."""
    a, b = points - points.mean(0), truth - truth.mean(0)
    u, _, vt = np.linalg.svd(a.T @ b)
    d = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    return np.linalg.norm(a @ u @ d @ vt - b, axis=1)


def command(capsys, *words):
    """Run a command; return its exit code, standard output, and error lines without progress."""
    code = main([str(w) for w in words])
    out, err = capsys.readouterr()
    stages = ("tags ", "tracks ", "board ", "solve ")
    return code, out, [line for line in err.splitlines() if not line.startswith(stages)]


def parse_json(out):
    """Return the JSON value that a command printed."""
    return json.loads(out)
