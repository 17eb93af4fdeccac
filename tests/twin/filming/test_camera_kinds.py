"""Kinds of cameras: their effects on images, prints and hands, and tags found in their images."""

import numpy as np
import pytest

from defsense_fab.capture.tags.detection import Detector
from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_kinds import (
    CAMERA_KINDS,
    print_patch,
    simulate_passing_finger,
)
from defsense_fab.twin.filming.camera_optics import ImageProcessing, Optics
from defsense_fab.twin.filming.cameras import expose
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Backdrop, Patch, Scene
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.twin.views import UPRIGHT, camera, tag

FAMILY = dictionary("4X4_50")
VIEW = camera((0, -150, 0))
NOISELESS = {"blur": 0.0, "read_noise": 0.0, "shot_noise": 0.0, "vignetting": 0.0}
TAG = Patch(7, tag(), np.zeros(3), UPRIGHT, 30.0)
PLAIN = ImageProcessing(mosaic=False, gamma=1.0, sharpening=0.0, quality=None)


def make_tag(x=0.0, z=0.0):
    return Patch(3, FAMILY.pattern(3), np.array([x, 0.0, z]), UPRIGHT, 30.0)


def test_grey_scene_stays_grey_through_the_mosaic():
    grey = np.full((60, 80), 128.0)
    mosaic = ImageProcessing(gamma=1.0, sharpening=0.0, quality=None)
    raw = np.round(grey * mosaic.sensitivity((80, 60))).astype(np.uint8)
    assert np.ptp(raw) > 30
    assert np.abs(mosaic.run(raw).astype(int) - 128).max() <= 2


def test_sharpening_overshoots_and_gamma_lifts_tones():
    step = np.repeat(np.array([[60] * 20 + [180] * 20], np.uint8), 30, axis=0)
    sharp = ImageProcessing(mosaic=False, gamma=1.0, sharpening=1.2, quality=None).run(step)
    assert sharp.max() > 190
    assert sharp.min() < 50
    brightened = ImageProcessing(mosaic=False, gamma=0.6, sharpening=0.0, quality=None).run(step)
    assert brightened[0, 0] == round(255 * (60 / 255) ** 0.6)
    assert (PLAIN.run(step) == step).all()
    blocks = ImageProcessing(mosaic=False, gamma=1.0, sharpening=0.0, quality=20).run(step)
    assert 0 < np.abs(blocks.astype(int) - step).max() < 60


@pytest.mark.parametrize("invalid", [{"gamma": 0.0}, {"sharpening": -1.0}, {"quality": 0}])
def test_invalid_processing_is_rejected(invalid):
    with raises(CaptureError, "out-of-range", record="image processing"):
        ImageProcessing(**invalid)


def test_defocus_spreads_light_over_a_disc():
    dot = Patch(3, np.zeros((1, 1), np.uint8), np.zeros(3), UPRIGHT, 0.7, margin=0.0)
    scene = Scene((dot,), backdrop=Backdrop(200, (0, 0), 0), ink=(0, 0), shade=0)
    sharp, soft = (
        Renderer(VIEW, Optics(**NOISELESS, defocus_radius=f), np.random.default_rng(0))
        .shoot(scene)
        .image
        for f in (0.0, 4.0)
    )
    dark = 200.0 - soft
    assert dark.sum() == pytest.approx((200.0 - sharp).sum(), rel=0.1)  # of whole grey levels
    y, x = np.nonzero(dark > 0.5 * dark.max())
    radius = np.hypot(x - x.mean(), y - y.mean())
    assert 3.0 < radius.max() < 5.5  # sharp rim, unlike a Gaussian


def test_lamps_flicker_over_the_rows_of_a_rolling_shutter():
    optics = Optics(**NOISELESS, exposure=0.002, readout_time=0.025, flicker=0.1)
    wall = Scene(backdrop=Backdrop(128, (0, 0), 0))
    renderer = Renderer(VIEW, optics, np.random.default_rng(0))
    rows = renderer.shoot(wall, time=0.0).image.mean(axis=1)
    # 2.5 periods of 100 Hz in 25 ms.
    crossings = np.flatnonzero(np.diff(rows > 128))
    assert 4 <= len(crossings) <= 6
    assert np.ptp(rows) == pytest.approx(0.2 * 128, rel=0.15)
    later = renderer.shoot(wall, time=0.005).image.mean(axis=1)
    assert np.abs(later - rows).max() > 15


def test_rolling_shutter_sees_objects_where_they_are_when_their_row_is_read():
    speed = 400.0  # mm/s to the right
    high, low = 30.0, -30.0

    def scene_at(t):
        body = box_surface([-80 + speed * t, 5, -50], [80 + speed * t, 30, 50])
        return Scene((make_tag(speed * t, high), make_tag(speed * t, low)), body=body)

    optics = Optics(exposure=0.0, readout_time=0.02)
    middle, instants = expose(scene_at, VIEW, 0.0, optics)
    assert not instants
    for patch, z in zip(middle.patches, (high, low), strict=True):
        row = VIEW.project(np.array([[0.0, 0, z]]))[0, 1]
        delay = 0.02 * (row / VIEW.size[1] - 0.5)
        assert patch.center[0] == pytest.approx(speed * delay, abs=0.02)
        assert patch.axes == pytest.approx(UPRIGHT)
    assert middle.patches[1].center[0] - middle.patches[0].center[0] > 1.5
    shift = middle.body.vertices[:, 0] - scene_at(0.0).body.vertices[:, 0]
    top = middle.body.vertices[:, 2] > 0
    assert shift[top].max() < 0 < shift[~top].min()


@pytest.mark.parametrize("name", CAMERA_KINDS)
def test_tags_are_detected_by_each_kind_of_camera(name):
    kind = CAMERA_KINDS[name]
    positions = [(x, z) for x in (-45.0, 0.0, 45.0) for z in (-25.0, 25.0)]
    patches = tuple(
        print_patch(
            Patch(k, FAMILY.pattern(k), np.array([x, 0.0, z]), UPRIGHT, 20.0), kind.ink, kind.curl
        )
        for k, (x, z) in enumerate(positions)
    )
    renderer = Renderer(VIEW, kind.optics, np.random.default_rng(1))
    picture = renderer.shoot(Scene(patches, gloss=kind.gloss), time=0.3)
    view = Detector(VIEW, FAMILY).find(picture.image)
    view = view.only(view.ids < len(positions))
    assert sorted(view.ids) == list(range(len(positions)))
    rays = VIEW.to_camera(np.array([p.corners for p in patches]).reshape(-1, 3))
    true = rays[:, :2] / rays[:, 2:] * VIEW.focal + VIEW.matrix[:2, 2]
    error = view.corners.mean(axis=1) - true.reshape(-1, 4, 2).mean(axis=1)[view.ids]
    is_unprocessed = kind.optics.processing is None
    assert np.linalg.norm(error, axis=1).max() < (0.03 if is_unprocessed else 0.1)
    assert (renderer.shoot(Scene(patches), time=0.3).image != picture.image).any()


def test_ink_widens_black_by_its_spread():
    inked = print_patch(TAG, 0.2, 0.0)
    assert inked.size == pytest.approx(30.4)
    widened = inked.corners - TAG.corners
    assert np.abs(widened @ UPRIGHT[:, :2]) == pytest.approx(np.full((4, 2), 0.2))
    silent = Optics(blur=0.0, read_noise=0.0, shot_noise=0.0, vignetting=0.0)
    pictures = [
        Renderer(camera((0, -150, 0)), silent, np.random.default_rng(0)).shoot(Scene((p,)))
        for p in (TAG, inked)
    ]
    edges = (np.diff(TAG.pattern.astype(int), axis=1) != 0).sum()
    edges += (np.diff(TAG.pattern.astype(int), axis=0) != 0).sum()
    edges += 4 * TAG.pattern.shape[0]  # to the margin
    lost = (pictures[0].image.astype(float) - pictures[1].image).sum() / (210 - 25) / 0.965
    scale = np.linalg.norm(pictures[0].corners[0, 1] - pictures[0].corners[0, 0]) / 30
    assert lost == pytest.approx(edges * TAG.cell * 0.2 * scale**2, rel=0.1)
    with raises(CaptureError, "ink-too-wide"):
        print_patch(TAG, 6.0, 0.0)


def test_curled_paper_keeps_its_corners_and_bows_between_them():
    curled = print_patch(TAG, 0.0, 0.004)
    assert curled.corners == pytest.approx(TAG.corners)
    n = TAG.pattern.shape[0]
    top = np.array([[n / 2, 0.0]])
    height = (curled.to_world(top) - TAG.to_world(top)) @ UPRIGHT[:, 2]
    assert height == pytest.approx([-0.004 * 15**2 / 2])
    images = [
        Renderer(camera((0, -150, 60)), Optics(), np.random.default_rng(0)).shoot(Scene((p,))).image
        for p in (TAG, curled)
    ]
    assert (images[0] != images[1]).any()


def test_finger_passes_before_the_body_once_per_period():
    bounds = np.array([[0.0, -15, -15], [150, 15, 15]])
    towards = np.array([0.6, 0.0, 0.8])
    finger_at = simulate_passing_finger(np.random.default_rng(1), bounds, towards)
    times = np.arange(0, 60, 0.05)
    is_present = np.array([bool(finger_at(t)) for t in times])
    assert 0.1 < is_present.mean() < 0.3
    assert (np.diff(is_present.astype(int)) == 1).sum() == 10
    for t in times[is_present]:
        (ball,) = finger_at(t)
        # The finger is in front of every corner of the body, seen from the cameras.
        assert ball.center @ towards - ball.radius > (bounds[1] @ towards)
        assert finger_at(t)[0].center == pytest.approx(ball.center)


def test_no_finger_is_present_before_the_start():
    bounds = np.array([[-10.0, -10, -10], [10, 10, 10]])
    finger_at = simulate_passing_finger(np.random.default_rng(1), bounds, np.array([0.0, 0, 1]))
    assert finger_at(-0.01) == finger_at(0.0) == ()
