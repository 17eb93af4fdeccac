"""Simulated cameras that run live."""

import time

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.cameras import LiveCamera
from defsense_fab.twin.scenes.scene import Patch, Scene
from tests.support.errors import raises
from tests.twin.views import camera, tag

UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
VIEW = camera((0, -150, 0), size=(160, 120), focal=160.0)


def scene_at(t):
    return Scene((Patch(4, tag(), np.array([40.0 * (t - 0.5), 0, 0]), UPRIGHT, 30.0),))


def test_live_camera_stamps_frames_by_the_clock():
    started_ns = time.monotonic_ns()
    live = LiveCamera(VIEW, scene_at, Optics(), np.random.default_rng(0), started_ns, 50.0, 0.002)
    live.start()
    frames = [live.read(2.0) for _ in range(6)]
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
