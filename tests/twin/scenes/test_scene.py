"""Scenes: which objects hide which, and invalid patches."""

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Ball, Ellipse, Led, Patch, Scene
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.twin.views import UPRIGHT, camera, tag, turn

NOISELESS = Optics(blur=0.0, read_noise=0.0, shot_noise=0.0, vignetting=0.0)
FRONT = Patch(7, tag(), np.zeros(3), UPRIGHT, 30.0)


def shoot(scene, view=None):
    return Renderer(view or camera((0, -150, 0)), NOISELESS, np.random.default_rng(0)).shoot(scene)


def visible(*patches, **fields):
    return shoot(Scene(patches, **fields)).visible


def test_corners_go_clockwise_from_the_top_left():
    across, up = FRONT.corners @ FRONT.axes[:, 0], FRONT.corners @ FRONT.axes[:, 1]
    assert across.tolist() == pytest.approx([-15, 15, 15, -15])
    assert up.tolist() == pytest.approx([15, 15, -15, -15])
    pixels = shoot(Scene((FRONT,))).corners[0]
    assert (pixels[1] - pixels[0])[0] > 10
    assert (pixels[2] - pixels[1])[1] > 10


def test_patch_that_faces_away_is_not_drawn():
    back = FRONT.moved_to(FRONT.center, FRONT.axes @ turn(y=np.pi))
    assert visible(FRONT, back).tolist() == pytest.approx([1, 0], abs=1e-4)
    assert (shoot(Scene((back,))).image == shoot(Scene()).image).all()


def test_patch_behind_another_is_visible_where_it_is_not_covered():
    behind = FRONT.moved_to(np.array([20.0, 15, 0]), FRONT.axes)
    view = camera((0, -150, 0), lens=(0.0, 0.0, 0.0, 0.0))
    shares = shoot(Scene((behind, FRONT)), view).visible
    # It spans 5 to 35 mm. The edge of the front one, at 20 mm with its margin, is at 22 mm in
    # the depth of 165 mm.
    assert shares == pytest.approx([13 / 30, 1], abs=0.01)


def test_body_hides_half_of_a_patch():
    box = box_surface([0, -40, -50], [100, -30, 50])
    assert visible(FRONT, body=box)[0] == pytest.approx(0.5, abs=0.01)
    assert visible(FRONT, body=box_surface([0, 30, -50], [100, 40, 50]))[0] == pytest.approx(1)


def test_patch_on_the_skin_is_visible_and_one_on_the_far_side_is_not():
    box = box_surface([-30, 0, -30], [30, 20, 30])
    sunk = FRONT.moved_to(np.array([0, 1.5, 0.0]), FRONT.axes @ turn(x=0.02))
    far = FRONT.moved_to(np.array([0, 20.1, 0.0]), FRONT.axes)
    assert visible(sunk, far, body=box).tolist() == pytest.approx([1, 0], abs=1e-3)
    image = shoot(Scene(body=box)).image
    assert image[117, 162] == pytest.approx(90, abs=1)
    assert image[10, 10] != image[117, 162]


def test_ball_hides_a_patch_behind_it():
    near, far = (Ball(np.array([0, y, 0.0]), 60.0, 33.0) for y in (-70.0, 90.0))
    assert visible(FRONT, occluders=(near,))[0] == 0
    assert visible(FRONT, occluders=(far,))[0] == pytest.approx(1, abs=1e-4)
    assert shoot(Scene((FRONT,), occluders=(near,))).image[117, 162] == 33


def test_ellipse_hides_patches_from_its_camera_alone():
    pixels = shoot(Scene((FRONT,))).corners[0]
    spot = Ellipse((pixels[0, 0], pixels[:, 1].mean()), (8.0, 200.0), 0.0, 10.0, "left")
    assert 0.5 < visible(FRONT, occluders=(spot,))[0] < 0.9
    other = camera((0, -150, 0), name="right")
    assert shoot(Scene((FRONT,), occluders=(spot,)), other).visible[0] == pytest.approx(1)


def test_led_has_different_levels_on_and_off():
    view, position = camera((0, -150, 0)), np.array([10, 0, 8.0])
    x, y = np.round(view.project(position)).astype(int)
    for is_on, level in ((True, 250), (False, 60)):
        assert shoot(Scene(led=Led(position, is_on)), view).image[y, x] == level


def test_patches_outside_the_view_are_not_visible():
    for center in ([0, -400.0, 0], [5000.0, 0, 0], [0, -149.0, 0]):
        picture = shoot(Scene((FRONT.moved_to(np.array(center), FRONT.axes),)))
        assert picture.visible[0] <= 1e-3 or center[1] == -149.0
        assert picture.image.shape == (240, 320)
    cut = FRONT.moved_to(view_edge(), FRONT.axes)
    assert 0.2 < visible(cut)[0] < 0.8


def view_edge():
    """Return the point on the plane of the patch at the right side of the image."""
    x, y = camera((0, -150, 0)).to_plane(np.array([319.5, 117.0]))
    return np.array([150 * x, 0, -150 * y])


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"pattern": np.zeros((4, 4))}, "pattern-invalid"),
        ({"axes": np.eye(3)[:, [1, 0, 2]]}, "axes-not-rotation"),
        ({"axes": 2 * np.eye(3)}, "axes-not-rotation"),
        ({"center": np.zeros(2)}, "patch-shape-invalid"),
        ({"size": 0.0}, "out-of-range"),
        ({"center": np.array([0, np.nan, 0])}, "out-of-range"),
    ],
)
def test_invalid_patches_are_rejected(change, code):
    valid = {"pattern": tag(), "center": np.zeros(3), "axes": np.eye(3), "size": 15.0}
    with raises(CaptureError, code):
        Patch(1, **{**valid, **change})
