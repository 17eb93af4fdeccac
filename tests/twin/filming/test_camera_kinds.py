"""Cameras as people have them: what they do to pictures, and that tags are found in these."""

import numpy as np
import pytest

from defsense_fab.capture.tags.detection import Detector
from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_kinds import CAMERA_KINDS, print_patch
from defsense_fab.twin.filming.camera_optics import ImageProcessing, Optics
from defsense_fab.twin.filming.exposure import expose
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Backdrop, Patch, Scene
from tests.conftest import box_surface
from tests.errors import raises
from tests.twin.views import camera

UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
FAMILY = dictionary("4X4_50")
VIEW = camera((0, -150, 0))
QUIET = {"blur": 0.0, "read": 0.0, "shot": 0.0, "vignetting": 0.0}
PLAIN = ImageProcessing(mosaic=False, gamma=1.0, sharpened=0.0, quality=None)


def seat(x=0.0, z=0.0):
    return Patch(3, FAMILY.pattern(3), np.array([x, 0.0, z]), UPRIGHT, 30.0)


def test_a_grey_scene_stays_grey_through_the_mosaic():
    grey = np.full((60, 80), 128.0)
    mosaic = ImageProcessing(gamma=1.0, sharpened=0.0, quality=None)
    raw = np.round(grey * mosaic.tiles((80, 60))).astype(np.uint8)
    assert np.ptp(raw) > 30
    assert np.abs(mosaic.run(raw).astype(int) - 128).max() <= 2


def test_sharpening_overshoots_and_tones_are_lifted():
    step = np.repeat(np.array([[60] * 20 + [180] * 20], np.uint8), 30, axis=0)
    sharp = ImageProcessing(mosaic=False, gamma=1.0, sharpened=1.2, quality=None).run(step)
    assert sharp.max() > 190
    assert sharp.min() < 50
    lifted = ImageProcessing(mosaic=False, gamma=0.6, sharpened=0.0, quality=None).run(step)
    assert lifted[0, 0] == round(255 * (60 / 255) ** 0.6)
    assert (PLAIN.run(step) == step).all()
    blocks = ImageProcessing(mosaic=False, gamma=1.0, sharpened=0.0, quality=20).run(step)
    assert 0 < np.abs(blocks.astype(int) - step).max() < 60


@pytest.mark.parametrize("wrong", [{"gamma": 0.0}, {"sharpened": -1.0}, {"quality": 0}])
def test_processing_that_cannot_be(wrong):
    with raises(CaptureError, "setting-out-of-range", record="image processing"):
        ImageProcessing(**wrong)


def test_out_of_focus_light_goes_where_a_disc_has_it():
    dot = Patch(3, np.zeros((1, 1), np.uint8), np.zeros(3), UPRIGHT, 0.7, margin=0.0)
    scene = Scene((dot,), backdrop=Backdrop(200, (0, 0), 0), ink=(0, 0), shade=0)
    sharp, soft = (
        Renderer(VIEW, Optics(**QUIET, focus=f), np.random.default_rng(0)).shoot(scene).image
        for f in (0.0, 4.0)
    )
    dark = 200.0 - soft
    assert dark.sum() == pytest.approx((200.0 - sharp).sum(), rel=0.1)  # of whole grey levels
    y, x = np.nonzero(dark > 0.5 * dark.max())
    away = np.hypot(x - x.mean(), y - y.mean())
    assert 3.0 < away.max() < 5.5  # even out to the rim, unlike a Gaussian


def test_lamps_flicker_down_the_rows_of_a_rolling_shutter():
    optics = Optics(**QUIET, exposure=0.002, rolling=0.025, flicker=0.1)
    wall = Scene(backdrop=Backdrop(128, (0, 0), 0))
    renderer = Renderer(VIEW, optics, np.random.default_rng(0))
    rows = renderer.shoot(wall, time=0.0).image.mean(axis=1)
    # 2.5 periods of 100 Hz in 25 ms.
    turns = np.flatnonzero(np.diff(rows > 128))
    assert 4 <= len(turns) <= 6
    assert np.ptp(rows) == pytest.approx(0.2 * 128, rel=0.15)
    other = renderer.shoot(wall, time=0.005).image.mean(axis=1)
    assert np.abs(other - rows).max() > 15


def test_a_rolling_shutter_sees_what_moves_where_its_row_was_read():
    speed = 400.0  # mm/s to the right
    high, low = 30.0, -30.0

    def scene_at(t):
        body = box_surface([-80 + speed * t, 5, -50], [80 + speed * t, 30, 50])
        return Scene((seat(speed * t, high), seat(speed * t, low)), body=body)

    optics = Optics(exposure=0.0, rolling=0.02)
    middle, instants = expose(scene_at, VIEW, 0.0, optics)
    assert not instants
    for patch, z in zip(middle.patches, (high, low), strict=True):
        row = VIEW.project(np.array([[0.0, 0, z]]))[0, 1]
        when = 0.02 * (row / VIEW.size[1] - 0.5)
        assert patch.center[0] == pytest.approx(speed * when, abs=0.02)
        assert patch.axes == pytest.approx(UPRIGHT)
    assert middle.patches[1].center[0] - middle.patches[0].center[0] > 1.5
    shift = middle.body.vertices[:, 0] - scene_at(0.0).body.vertices[:, 0]
    top = middle.body.vertices[:, 2] > 0
    assert shift[top].max() < 0 < shift[~top].min()


@pytest.mark.parametrize("name", CAMERA_KINDS)
def test_tags_are_found_before_each_kind_of_camera(name):
    kind = CAMERA_KINDS[name]
    places = [(x, z) for x in (-45.0, 0.0, 45.0) for z in (-25.0, 25.0)]
    patches = tuple(
        print_patch(
            Patch(k, FAMILY.pattern(k), np.array([x, 0.0, z]), UPRIGHT, 20.0), kind.ink, kind.curl
        )
        for k, (x, z) in enumerate(places)
    )
    renderer = Renderer(VIEW, kind.optics, np.random.default_rng(1))
    picture = renderer.shoot(Scene(patches, gloss=kind.gloss), time=0.3)
    view = Detector(VIEW, FAMILY).find(picture.image)
    view = view.only(view.ids < len(places))
    assert sorted(view.ids) == list(range(len(places)))
    rays = VIEW.to_camera(np.array([p.corners for p in patches]).reshape(-1, 3))
    true = rays[:, :2] / rays[:, 2:] * VIEW.focal + VIEW.matrix[:2, 2]
    off = view.corners.mean(axis=1) - true.reshape(-1, 4, 2).mean(axis=1)[view.ids]
    sharp = kind.optics.processing is None
    assert np.linalg.norm(off, axis=1).max() < (0.03 if sharp else 0.1)
    assert (renderer.shoot(Scene(patches), time=0.3).image != picture.image).any()
