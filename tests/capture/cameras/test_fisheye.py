"""Fisheye lenses: model, calibration, arrangement, files, and tags in images."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.capture.cameras.extrinsics import estimate_extrinsics
from defsense_fab.capture.cameras.intrinsics import calibrate_camera
from defsense_fab.capture.cameras.rig_check import check_rig
from defsense_fab.capture.cameras.rig_file import read_rig, write_rig
from defsense_fab.capture.tags.detection import BoardView, Detector
from defsense_fab.capture.tags.tag_patterns import CharucoBoard, dictionary
from defsense_fab.core.camera import Camera, distort
from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Patch, Scene
from tests.twin.views import turn

BOARD = CharucoBoard()
LENS = np.array([0.03, -0.012, 0.004, -0.0008])
#: Of a wide action camera: 140 degrees across the picture.
K = np.array([[520.0, 0, 643], [0, 522, 356], [0, 0, 1]])


def wide(name="left", x=0.0):
    """Return a camera at (x, 0, 0) that looks along z."""
    return Camera(name, (1280, 720), K, LENS, np.eye(3), np.array([-x, 0.0, 0.0]), fisheye=True)


def view(camera, pose, rng):
    R, at = pose
    px = camera.project((BOARD.corners - BOARD.corners.mean(axis=0)) @ R.T + at)
    px = px + rng.normal(0, 0.05, px.shape)
    inside = (px > 5).all(axis=1) & (px < [1274, 714]).all(axis=1)
    return BoardView(np.flatnonzero(inside), px[inside]) if inside.sum() >= 8 else None


def poses(count, rng, across=230.0):
    for _ in range(count):
        R = turn(*rng.uniform(-0.6, 0.6, 2)) @ np.diag([1, -1, -1.0])
        yield (
            R,
            np.array([rng.uniform(-across, across), rng.uniform(-90, 90), rng.uniform(140, 260)]),
        )


def test_projection_is_opencvs():
    camera, rng = wide(), np.random.default_rng(0)
    angle, round_ = rng.uniform(0, np.radians(80), 300), rng.uniform(0, 2 * np.pi, 300)
    rays = np.column_stack([np.sin(angle) * np.cos(round_), np.sin(angle) * np.sin(round_),
                            np.cos(angle)])  # fmt: skip
    points = rays * rng.uniform(100, 900, (300, 1))
    shown, _ = cv2.fisheye.projectPoints(points[None], np.zeros(3), np.zeros(3), K, LENS)
    assert np.allclose(camera.project(points), shown[0], atol=1e-8)
    back = camera.to_plane(shown[0])
    assert np.allclose(back, points[:, :2] / points[:, 2:], rtol=1e-8, atol=1e-9)
    for at in (np.array([0.0, 0.0]), np.array([1.4, -0.3]), np.array([0.2, 3.0])):
        _, J = distort(at, LENS, fisheye=True)
        h = 1e-6
        sides = [distort(at + h * e, LENS, fisheye=True)[0]
                 - distort(at - h * e, LENS, fisheye=True)[0] for e in np.eye(2)]  # fmt: skip
        assert np.allclose(J, np.array(sides).T / (2 * h), atol=1e-7)


def test_pixels_outside_of_the_lens_model_are_nan():
    folds = replace(wide(), distortions=np.array([-0.2, 0.0, 0.0, 0.0]))  # at 74 degrees
    plane = folds.to_plane(np.array([[643.0, 356], [900.0, 356], [1279.0, 356], [643.0, 2000]]))
    assert np.allclose(plane[0], 0)
    assert np.isfinite(plane[1]).all()
    assert np.isnan(plane[2:]).all()
    with pytest.raises(CaptureError):
        replace(wide(), distortions=np.zeros(5))


def test_fisheye_is_calibrated_where_a_pinhole_does_not_fit():
    rng = np.random.default_rng(1)
    views = [v for p in poses(40, rng) if (v := view(wide(), p, rng)) is not None][:25]
    result = calibrate_camera("left", (1280, 720), BOARD, views, fisheye=True)
    assert result.error == pytest.approx(0.05 * 2**0.5, rel=0.1)
    received = np.append(
        result.camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], result.camera.distortions
    )
    true = np.append(K[[0, 1, 0, 1], [0, 1, 2, 2]], LENS)
    assert np.abs(result.camera.focal / wide().focal - 1).max() < 1e-3
    assert np.abs((received - true) / result.sigma[:8]).max() < 4
    assert result.used.all()
    plain = calibrate_camera("left", (1280, 720), BOARD, views)
    assert plain.error > 1.5 * result.error


def test_fisheye_and_a_pinhole_are_arranged_and_checked(tmp_path):
    rng = np.random.default_rng(2)
    plain = Camera("right", (1280, 720), np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]]),
                   np.zeros(5), np.eye(3), np.array([-120.0, 0, 0]))  # fmt: skip
    cameras = [wide(), plain]
    views = []
    for R, at in poses(40, rng, across=40.0):
        both = {c: view(cameras[c], (R, at + np.array([60, 0, 150])), rng) for c in (0, 1)}
        if all(v is not None for v in both.values()):
            views.append(both)
    free = [replace(c, translation=np.zeros(3)) for c in cameras]
    sigma = [np.array([3, 3, 3, 3, 0.01, 0.01, 1e-3, 1e-3, 1e-2])] * 2
    result = estimate_extrinsics(free, BOARD, views[:14], sigma)
    assert result.error == pytest.approx(0.05 * 2**0.5, rel=0.1)
    b = result.cameras[1]
    assert np.abs(b.center - [120, 0, 0]).max() < 0.5
    assert Rotation.from_matrix(b.rotation).magnitude() < 1e-3
    assert (result.cameras[0].distortions == LENS).all()
    assert check_rig(result.cameras, BOARD, views[14:18]).holds
    write_rig(tmp_path / "c.toml", result.cameras, {})
    again = read_rig(tmp_path / "c.toml").cameras
    assert [c.fisheye for c in again] == [True, False]
    assert (again[0].distortions == LENS).all()
    assert "fisheye = true" in (tmp_path / "c.toml").read_text("utf-8")  # as aniposelib has it


def test_tags_in_a_fisheye_image_are_located():
    family, camera = dictionary("4X4_50"), wide()
    facing = np.diag([1.0, -1, -1])
    places = [(-190.0, -60.0), (-80.0, 50.0), (0.0, 0.0), (120.0, -40.0), (200.0, 70.0)]
    patches = tuple(
        Patch(k, family.pattern(k), np.array([x, y, 160.0]), facing, 20.0)
        for k, (x, y) in enumerate(places)
    )
    picture = Renderer(camera, Optics(), np.random.default_rng(0)).shoot(Scene(patches))
    pixels = Detector(camera, family).find(picture.image)
    assert sorted(pixels.ids) == list(range(len(places)))
    middle = (pixels.corners.mean(axis=1) - camera.matrix[:2, 2]) / camera.focal
    true = np.array(places)[pixels.ids] / 160.0
    assert np.abs(middle - true).max() * 160 < 0.05  # mm
