"""Films and live cameras of the twin: every grey level, every stamp, the whole truth."""

import time

import cv2
import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.cameras import LiveCamera
from defsense_fab.twin.filming.exposure import expose
from defsense_fab.twin.filming.film import Shutter, record_film, load_truth
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Led, Patch, Scene
from tests.errors import raises
from tests.twin.views import camera, tag, turn

UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
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


def test_a_film_keeps_every_grey_level_and_tells_the_truth(tmp_path):
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
    again = load_truth(tmp_path / "left.npz")
    assert (again.pixels == truth.pixels).all()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["left.csv", "left.mkv", "left.npz"]
    table = np.loadtxt(tmp_path / "left.csv", delimiter=",", skiprows=1)
    assert table[:, 1] == pytest.approx(truth.stamp, abs=1e-9)


def test_frames_are_dropped_repeated_and_late():
    shutter = Shutter(50.0, offset=3.0, drift=1e-4, jitter=0.003, dropped=0.1, repeated=0.1)
    number, times, stamp, repeats = shutter.schedule(40.0, np.random.default_rng(0))
    assert 1 - len(number) / 2000 == pytest.approx(0.1, abs=0.03)
    assert repeats.mean() == pytest.approx(0.1, abs=0.03)
    assert (np.diff(stamp) > 0).all()
    assert (np.diff(times)[repeats[1:]] == 0).all()
    assert (np.diff(times)[~repeats[1:]] > 0).all()
    own = ~repeats
    late = stamp[own] - (3.0 + (1 + 1e-4) * times[own])
    assert late.min() > -1e-9
    assert late.mean() == pytest.approx(0.003, rel=0.2)
    assert times[own] == pytest.approx(number[own] / 50 / 1.0001)


def test_repeated_frames_are_the_same(tmp_path):
    shutter = Shutter(20.0, repeated=0.5)
    rng = np.random.default_rng(1)
    truth = record_film(tmp_path / "a.mkv", VIEW, scene_at, 0.5, shutter, Optics(), rng)
    shown = frames(tmp_path / "a.mkv")
    same = (shown[1:] == shown[:-1]).all((1, 2, 3))
    assert (same == truth.repeats[1:]).all()
    assert truth.repeats.any()


def test_only_what_moves_is_smeared():
    assert expose(scene_at, VIEW, 0.2, Optics(exposure=0.01))[1]
    assert not expose(lambda t: scene_at(t, speed=0.0), VIEW, 0.2, Optics(exposure=0.01))[1]
    assert not expose(scene_at, VIEW, 0.2, Optics(exposure=0.0))[1]


def test_instants_follow_the_motion():
    def spinning(t):
        axes = UPRIGHT @ turn(z=9.0 * t)
        return Scene((Patch(4, tag(), np.array([900 * t * t, 0, 5 * t]), axes, 30.0),))

    middle, instants = expose(spinning, VIEW, 0.2, Optics(exposure=0.02))
    assert (middle.patches[0].center == spinning(0.2).patches[0].center).all()
    places = np.array([s.patches[0].center for s in instants])
    assert 3 <= len(instants) <= 13
    assert places.mean(0) == pytest.approx(middle.patches[0].center)
    # An even smear over the way of 900 * 2 * 0.2 mm/s within 0.02 s.
    assert places[:, 0].std() == pytest.approx(360 * 0.02 / np.sqrt(12), rel=0.03)
    for scene in (instants[0], instants[-1]):
        offset = (scene.patches[0].center[2] - 1.0) / 5
        exact = spinning(0.2 + offset).patches[0]
        assert 0.009 < abs(offset) < 0.0105
        assert scene.patches[0].axes == pytest.approx(exact.axes, abs=0.01)


def test_films_that_cannot_be(tmp_path):
    rng = np.random.default_rng(0)
    with raises(CaptureError, "unknown-codec", codec="H264"):
        record_film(tmp_path / "a.mkv", VIEW, scene_at, 0.1, Shutter(), Optics(), rng, codec="H264")
    with raises(CaptureError, "no-frames"):
        record_film(tmp_path / "a.mkv", VIEW, scene_at, 0.0, Shutter(), Optics(), rng)
    with raises(StorageError, "file-not-writable"):
        record_film(tmp_path / "none" / "a.mkv", VIEW, scene_at, 0.1, Shutter(), Optics(), rng)
    (tmp_path / "b.npz").write_text("nothing")
    with raises(StorageError, "file-unreadable"):
        load_truth(tmp_path / "b.npz")
    assert [p.name for p in tmp_path.iterdir()] == ["b.npz"]


def test_a_live_camera():
    began = time.monotonic_ns()
    live = LiveCamera(VIEW, scene_at, Optics(), np.random.default_rng(0), began, 50.0, 0.002)
    live.start()
    got = [live.read(2.0) for _ in range(6)]
    live.close()
    stamps = [stamp for _, stamp in got]
    assert all(image.shape == (120, 160) for image, _ in got)
    assert (live.name, live.size) == ("left", (160, 120))
    log = dict(live.taken)
    for stamp in stamps:
        assert (stamp - began) * 1e-9 - 0.002 == pytest.approx(log[stamp], abs=1e-8)
    steps = np.diff(stamps) * 1e-9 * 50
    assert steps == pytest.approx(np.round(steps), abs=1e-4)
    assert stamps[0] > began
    while live.read(0.0):
        pass
    assert live.read(0.01) is None


def test_a_live_camera_says_what_failed():
    def broken(t):
        raise ValueError("no scene at all")

    live = LiveCamera(VIEW, broken, Optics(), np.random.default_rng(0), time.monotonic_ns())
    live.start()
    with raises(CaptureError, "scene-failed", camera="left") as caught:
        live.read(5.0)
    assert isinstance(caught.value.__cause__, ValueError)
    live.close()
