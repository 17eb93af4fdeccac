"""Test the camera model against OpenCV, and invalid records of cameras and tracks."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from defsense_fab.core.camera import Camera, check_names, distort, undistort
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.markers import Tracks
from tests.support.errors import raises

LENSES = [
    (0.0, 0.0, 0.0, 0.0),
    (-0.25, 0.1, 0.002, -0.001),
    (-0.35, 0.15, 0.004, -0.003, -0.02),
    (0.3, -0.1, 0.002, -0.003, 0.05, 0.2, -0.05, 0.02),
]
MATRIX = np.array([[700, 0, 321.5], [0, 705, 238.0], [0, 0, 1]])


def camera(lens=LENSES[2], rotation=(0.3, -0.2, 0.1), translation=(10.0, -20, 30)):
    turn = Rotation.from_rotvec(rotation).as_matrix()
    return Camera("a", (640, 480), MATRIX, np.array(lens), turn, np.array(translation))


@pytest.mark.parametrize("lens", LENSES)
def test_projection_equals_opencv(lens):
    c, rng = camera(lens), np.random.default_rng(0)
    inside = np.column_stack([rng.uniform(-0.4, 0.4, (200, 2)), np.ones(200)])
    points = (inside * rng.uniform(200, 900, (200, 1)) - c.translation) @ c.rotation
    shown, _ = cv2.projectPoints(points, cv2.Rodrigues(c.rotation)[0], c.translation, MATRIX,
                                 c.distortions)  # fmt: skip
    assert np.allclose(c.project(points), shown[:, 0], atol=1e-9)
    assert np.allclose(c.project(points.reshape(10, 20, 3))[3, 4], shown[64, 0], atol=1e-9)
    assert np.allclose(c.to_plane(c.project(points)), inside[:, :2], atol=1e-9)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    plane = cv2.undistortPoints(shown, MATRIX, c.distortions, criteria=criteria)
    assert np.allclose(c.to_plane(shown[:, 0]), plane[:, 0], atol=1e-9)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.sampled_from(LENSES), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_derivatives_equal_finite_differences(lens, x, y):
    lens, at, h = np.array(lens), np.array([x, y]), 1e-6
    _, J = distort(at, lens)
    both = [(distort(at + h * e, lens)[0] - distort(at - h * e, lens)[0]) for e in np.eye(2)]
    assert np.allclose(J, np.array(both).T / (2 * h), atol=1e-8)
    assert np.allclose(undistort(distort(at, lens)[0], lens), at, atol=1e-10)


def test_points_behind_the_camera_are_nan():
    c = camera()
    ahead = -c.rotation.T @ c.translation + 300 * c.rotation[2]
    behind = c.center - 300 * c.rotation[2]
    shown = c.project(np.array([ahead, behind, [np.nan, 0, 0]]))
    assert np.isfinite(shown[0]).all()
    assert np.isnan(shown[1:]).all()
    assert np.allclose(c.to_camera(c.center), 0, atol=1e-12)


def test_pixels_without_a_ray_are_nan():
    lens = np.array([-0.35, 0.0, 0.0, 0.0])  # its largest radius: 2/3 / sqrt(3 * 0.35)
    far = np.array([[0.3, 0.0], [0.9, 0.0], [0.0, 3.0]])
    plane = undistort(far, lens)
    assert np.allclose(distort(plane[0], lens)[0], far[0])
    assert np.isnan(plane[1:]).all()


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"matrix": np.eye(2)}, "wrong-shape"),
        ({"matrix": MATRIX * [[np.nan], [1], [1]]}, "not-finite"),
        ({"matrix": MATRIX * [[-1], [1], [1]]}, "not-positive"),
        ({"matrix": MATRIX @ (np.eye(3) + 0.1 * np.eye(3, k=1))}, "skew-not-zero"),
        ({"matrix": (np.eye(3) + 0.1 * np.eye(3, k=-1)) @ MATRIX}, "not-a-camera-matrix"),
        ({"matrix": MATRIX * 2}, "not-a-camera-matrix"),
        ({"distortions": np.zeros(6)}, "wrong-coefficient-count"),
        ({"distortions": np.zeros(5), "fisheye": True}, "wrong-coefficient-count"),
        ({"distortions": np.full(5, np.inf)}, "not-finite"),
        ({"rotation": np.diag([1.0, 1, 2])}, "not-a-rotation"),
        ({"rotation": np.diag([1.0, 1, -1])}, "not-a-rotation"),
        ({"translation": np.zeros(2)}, "wrong-shape"),
        ({"size": (0, 480)}, "image-too-small"),
    ],
)
def test_invalid_camera_is_refused(change, code):
    with raises(CaptureError, code, camera="a") as caught:
        replace(camera(), **change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "code"),
    [
        *((n, "camera-name-invalid") for n in (
            "", "../left", "/tmp/left", "a\\b", "C:left", "..", ".left", "left ", "left.", "a\nb",
            "cam%d", "left?", "\x7f", "\ud800", "x" * 61)),
        *((n, "reserved-camera-name") for n in ("frames", "Log", "session", "NUL", "com1.left")),
    ],
)  # fmt: skip
def test_name_that_is_no_file_name_is_refused(name, code):
    with raises(CaptureError, code, camera=name) as caught:
        replace(camera(), name=name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "names",
    [
        ("left", "left"), ("left", "Left"), ("straße", "STRASSE"), ("k\u00e4se", "ka\u0308se"),
        ("a", "a-frames"), ("A-frames", "b", "a"),
    ],
)  # fmt: skip
def test_cameras_with_the_same_files_are_refused(names):
    for name in names:
        check_names([name])
    with raises(CaptureError, "name-repeated"):
        check_names(names)
    check_names(["left", "left 2", "left.2", "left-frame"])


def test_invalid_tracks_are_refused():
    good = {
        "time": np.arange(3.0), "ids": np.array([4, 7]), "points": np.zeros((3, 2, 3)),
        "sigma": np.zeros((3, 2, 3)), "frame": np.arange(3),
    }  # fmt: skip
    points = np.zeros((3, 2, 3))
    points[1, 0] = np.nan
    assert Tracks(**{**good, "points": points}).visible.tolist() == [[True] * 2, [False, True],
                                                                  [True] * 2]  # fmt: skip
    partly_nan = points.copy()
    partly_nan[0, 0, 1] = np.nan
    for bad, code in (
        ({"time": np.array([0, 2.0, 1])}, "times-not-increasing"),
        ({"time": np.array([0, 1, np.nan])}, "times-not-increasing"),
        ({"ids": np.array([1, 1])}, "marker-repeated"),
        ({"points": partly_nan}, "point-partly-nan"),
        ({"sigma": np.zeros((3, 2))}, "wrong-shape"),
    ):
        with raises(CaptureError, code):
            Tracks(**{**good, **bad})
