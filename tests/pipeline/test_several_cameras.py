"""Three cameras: in another order than their calibration, and one that went."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.detect import NOTHING, View
from defsense_fab.capture.rig_file import Rig
from defsense_fab.capture.video import timing
from defsense_fab.core.camera import Camera
from defsense_fab.core.errors import CaptureError
from defsense_fab.pipeline.process import assemble
from defsense_fab.pipeline.watch import Watched
from tests.capture.rigs import flat, rig, spread, tags

SIZE, FRAMES, NOISE = 15.0, 40, 0.03


def cameras():
    """Three that are not alike, so that an order is told by more than their places."""
    out = []
    for k, c in enumerate(rig(3)):
        matrix = c.matrix * np.array([[1 + 0.02 * k, 1, 1], [1, 1 + 0.02 * k, 1], [1, 1, 1]])
        out.append(Camera(c.name, c.size, matrix, c.distortions, c.rotation, c.translation))
    return tuple(out)


def filmed(seen_by, taken_as, rng):
    """What each camera saw, in pixels of the camera that it is taken for; the tags' corners."""
    base = tags(8, rng)
    time = np.arange(FRAMES) / 30
    move = 20 * np.sin(2 * np.pi * np.outer(time, [0.7, 1.1, 0.5]))
    corners = base + move[:, None, None]
    out = []
    for camera, named in zip(seen_by, taken_as, strict=True):
        px = flat(camera, corners) + rng.normal(scale=NOISE, size=(*corners.shape[:3], 2))
        px = (px - camera.matrix[:2, 2]) / camera.focal * named.focal + named.matrix[:2, 2]
        views = tuple(View(np.arange(8), p, spread((8,), NOISE), p) for p in px)
        out.append(Watched(time, views, timing(time), FRAMES))
    return out, corners


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_cameras_in_another_order_are_named(order):
    true = cameras()
    watched, corners = filmed([true[k] for k in order], true, np.random.default_rng(1))
    names = ["a.mkv", "b.mkv", "c.mkv"]
    if order == (0, 1, 2):
        found = assemble(watched, Rig(true), SIZE, names)
        middle = true[0].to_camera(corners.mean(axis=2))
        assert np.abs(found.tracks.points - middle).max() < 0.1
        assert (found.cameras == 3).all()
        return
    with pytest.raises(CaptureError, match="another order") as told:
        assemble(watched, Rig(true), SIZE, names)
    for name, k in zip(names, order, strict=True):
        assert f"{name} is of {true[k].name}" in str(told.value)


@pytest.mark.parametrize("by", [(8.0, 0, 0), (0, 2.5, 0), (1.0, 1.5, -2)])
@pytest.mark.parametrize("moved", range(3))
def test_one_of_three_that_was_moved_is_left_out(moved, by):
    true = cameras()
    there = list(true)
    there[moved] = replace(true[moved], translation=true[moved].translation + np.array(by))
    watched, corners = filmed(there, true, np.random.default_rng(2))
    found = assemble(watched, Rig(true), SIZE, ["a", "b", "c"])
    middle = true[0].to_camera(corners.mean(axis=2))
    assert (found.cameras == 2).all()
    assert np.abs(found.tracks.points - middle).max() < 0.2
    named = [w for w in found.quality["warnings"] if "was moved since" in w]
    assert [w[0] for w in named] == ["abc"[moved]]


def test_one_of_three_that_stops_leaves_two():
    true = cameras()
    watched, corners = filmed(true, true, np.random.default_rng(3))
    gone = watched[2].views[: FRAMES // 2] + (NOTHING,) * (FRAMES // 2)
    watched[2] = Watched(watched[2].time, gone, watched[2].timing, FRAMES)
    found = assemble(watched, Rig(true), SIZE, ["a", "b", "c"])
    assert (found.cameras[: FRAMES // 2] == 3).all()
    assert (found.cameras[FRAMES // 2 :] == 2).all()
    middle = true[0].to_camera(corners.mean(axis=2))
    assert np.abs(found.tracks.points - middle).max() < 0.1


def test_one_of_three_that_began_late_is_brought_in_step():
    true = cameras()
    watched, corners = filmed(true, true, np.random.default_rng(4))
    watched[2] = replace(watched[2], time=watched[2].time - 0.08)
    found = assemble(watched, Rig(true), SIZE, ["a", "b", "c"])
    assert found.quality["offsets"][2] == pytest.approx(0.08, abs=1e-3)
    assert not [w for w in found.quality["warnings"] if "was moved since" in w]
    assert (found.cameras == 3).mean() > 0.9
    middle = true[0].to_camera(corners.mean(axis=2))
    assert np.nanmax(np.abs(found.tracks.points - middle)) < 0.15
