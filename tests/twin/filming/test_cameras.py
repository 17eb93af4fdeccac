"""Simulated cameras that run live, and the motion during an exposure."""

import time

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.cameras import LiveCamera, expose
from defsense_fab.twin.scenes.scene import Patch, Scene
from tests.support.errors import raises
from tests.twin.views import UPRIGHT, camera, tag, turn

VIEW = camera((0, -150, 0), size=(160, 120), focal=160.0)


def scene_at(t, speed=40.0):
    return Scene((Patch(4, tag(), np.array([speed * (t - 0.5), 0, 0]), UPRIGHT, 30.0),))


def test_live_camera_stamps_frames_by_the_clock():
    started_ns = time.monotonic_ns()
    live = LiveCamera(VIEW, scene_at, Optics(), np.random.default_rng(0), started_ns, 50.0, 0.002)
    live.start()
    frames = [live.read(60.0) for _ in range(6)]
    live.close()
    stamps = [stamp for _, stamp in frames]
    assert all(image.shape == (120, 160) for image, _ in frames)
    assert (live.name, live.size) == ("left", (160, 120))
    log = dict(live.frame_times)
    for stamp in stamps:
        assert (stamp - started_ns) * 1e-9 - 0.002 == pytest.approx(log[stamp], abs=1e-8)
    steps = np.diff(stamps) * 1e-9 * 50
    assert steps == pytest.approx(np.round(steps), abs=1e-4)
    assert stamps[0] > started_ns
    while live.read(0.0):
        pass
    assert live.read(0.01) is None


def test_live_camera_reports_a_failing_scene():
    def broken(t):
        raise ValueError("no scene at all")

    live = LiveCamera(VIEW, broken, Optics(), np.random.default_rng(0), time.monotonic_ns())
    live.start()
    with raises(CaptureError, "scene-failed", camera="left") as caught:
        live.read(5.0)
    assert isinstance(caught.value.__cause__, ValueError)
    live.close()


def test_only_moving_patches_are_smeared():
    assert expose(scene_at, VIEW, 0.2, Optics(exposure=0.01))[1]
    assert not expose(lambda t: scene_at(t, speed=0.0), VIEW, 0.2, Optics(exposure=0.01))[1]
    assert not expose(scene_at, VIEW, 0.2, Optics(exposure=0.0))[1]


def test_instants_follow_the_motion():
    def spinning(t):
        axes = UPRIGHT @ turn(z=9.0 * t)
        return Scene((Patch(4, tag(), np.array([900 * t * t, 0, 5 * t]), axes, 30.0),))

    middle, instants = expose(spinning, VIEW, 0.2, Optics(exposure=0.02))
    assert (middle.patches[0].center == spinning(0.2).patches[0].center).all()
    positions = np.array([s.patches[0].center for s in instants])
    assert 3 <= len(instants) <= 13
    assert positions.mean(0) == pytest.approx(middle.patches[0].center)
    # An even smear over the distance that 900 * 2 * 0.2 mm/s cover in 0.02 s.
    assert positions[:, 0].std() == pytest.approx(360 * 0.02 / np.sqrt(12), rel=0.03)
    for scene in (instants[0], instants[-1]):
        offset = (scene.patches[0].center[2] - 1.0) / 5
        exact = spinning(0.2 + offset).patches[0]
        assert 0.009 < abs(offset) < 0.0105
        assert scene.patches[0].axes == pytest.approx(exact.axes, abs=0.01)
