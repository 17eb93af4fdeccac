"""Films for tests: grey levels, time stamps and truth."""

import cv2
import numpy as np
import pytest

from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.cameras import expose
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Led, Patch, Scene
from tests.twin.film import Shutter, load_truth, record_film
from tests.twin.views import UPRIGHT, camera, tag

VIEW = camera((0, -150, 0), size=(160, 120), focal=160.0)


def scene_at(t, speed=40.0):
    patch = Patch(4, tag(), np.array([speed * (t - 0.5), 0, 0]), UPRIGHT, 30.0)
    return Scene((patch,), led=Led(np.array([0, 0, 30.0]), int(4 * t) % 2 == 1))


def frames(path):
    video, out = cv2.VideoCapture(str(path)), []
    while True:
        good, image = video.read()
        if not good:
            return np.array(out)
        out.append(image)


def test_film_keeps_every_grey_level_and_the_truth(tmp_path):
    path = tmp_path / "left.mkv"
    truth = record_film(
        path, VIEW, scene_at, 1.0, Shutter(20.0), Optics(), np.random.default_rng(3)
    )
    rng = np.random.default_rng(3)
    Shutter(20.0).schedule(1.0, rng)
    renderer = Renderer(VIEW, Optics(), rng)
    shown = frames(path)
    assert len(shown) == 20 == len(truth.time)
    for k, image in enumerate(shown):
        exact = renderer.shoot(*expose(scene_at, VIEW, k / 20, Optics())).image
        assert (image == exact[:, :, None]).all()
    patch = scene_at(0.35).patches[0]
    assert truth.centers[7, 0] == pytest.approx(patch.center)
    assert truth.corners[7, 0] == pytest.approx(patch.corners)
    assert truth.pixels[7, 0] == pytest.approx(VIEW.project(patch.corners))
    assert truth.ids.tolist() == [4]
    assert truth.led.tolist() == [int(4 * k / 20) % 2 == 1 for k in range(20)]
    loaded = load_truth(tmp_path / "left.npz")
    assert (loaded.pixels == truth.pixels).all()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["left.csv", "left.mkv", "left.npz"]
    table = np.loadtxt(tmp_path / "left.csv", delimiter=",", skiprows=1)
    assert table[:, 1] == pytest.approx(truth.stamp, abs=1e-9)


def test_frames_are_dropped_repeated_and_delayed():
    shutter = Shutter(50.0, offset=3.0, drift=1e-4, jitter=0.003, dropped=0.1, repeated=0.1)
    number, times, stamp, repeats = shutter.schedule(40.0, np.random.default_rng(0))
    assert 1 - len(number) / 2000 == pytest.approx(0.1, abs=0.03)
    assert repeats.mean() == pytest.approx(0.1, abs=0.03)
    assert (np.diff(stamp) > 0).all()
    assert (np.diff(times)[repeats[1:]] == 0).all()
    assert (np.diff(times)[~repeats[1:]] > 0).all()
    is_new = ~repeats
    delay = stamp[is_new] - (3.0 + (1 + 1e-4) * times[is_new])
    assert delay.min() > -1e-9
    assert delay.mean() == pytest.approx(0.003, rel=0.2)
    assert times[is_new] == pytest.approx(number[is_new] / 50 / 1.0001)


def test_repeated_frames_are_identical(tmp_path):
    shutter = Shutter(20.0, repeated=0.5)
    rng = np.random.default_rng(1)
    truth = record_film(tmp_path / "a.mkv", VIEW, scene_at, 0.5, shutter, Optics(), rng)
    shown = frames(tmp_path / "a.mkv")
    same = (shown[1:] == shown[:-1]).all((1, 2, 3))
    assert (same == truth.repeats[1:]).all()
    assert truth.repeats.any()
