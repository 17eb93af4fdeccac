"""Several cameras: their order, one that was moved, and clocks that differ."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.cameras.image_sources import measure_timing
from defsense_fab.capture.cameras.rig_file import Rig
from defsense_fab.capture.tags.detection import TagView
from defsense_fab.capture.tracking.observations import store_views
from defsense_fab.capture.videos.video_detection import VideoDetections
from defsense_fab.capture.videos.video_tracks import assemble
from defsense_fab.core.camera import Camera
from defsense_fab.core.errors import CaptureError
from tests.capture.rigs import flat, rig, spread, tags
from tests.support.errors import raises
from tests.support.late_stamps import trial

pytestmark = pytest.mark.slow

SIZE, FRAMES, NOISE = 15.0, 40, 0.03
NAMES = ["a", "b", "c"]


def cameras():
    """Return three cameras with different lenses, so that their order matters."""
    out = []
    for k, c in enumerate(rig(3)):
        matrix = c.matrix * np.array([[1 + 0.02 * k, 1, 1], [1, 1 + 0.02 * k, 1], [1, 1, 1]])
        out.append(Camera(c.name, c.size, matrix, c.distortions, c.rotation, c.translation))
    return tuple(out)


def filmed(seen_by, taken_as, rng, late=0.0, frames=FRAMES):
    """Return the detections of each camera and the corners at the first one's times.

    Pixels are those of the cameras `taken_as`; the last camera starts `late` s later.
    """
    base = tags(8, rng)
    time = np.arange(frames) / 30
    out, corners = [], base
    for k, (camera, named) in enumerate(zip(seen_by, taken_as, strict=True)):
        at = time + (late if k == len(seen_by) - 1 else 0)
        move = 20 * np.sin(2 * np.pi * np.outer(at, [0.7, 1.1, 0.5]) + [0, 1, 2])
        shown = base + move[:, None, None]
        if not k:
            corners = shown
        px = flat(camera, shown) + rng.normal(scale=NOISE, size=(*shown.shape[:3], 2))
        px = (px - camera.matrix[:2, 2]) / camera.focal * named.focal + named.matrix[:2, 2]
        views = [TagView(np.arange(8), p, spread((8,), NOISE), p) for p in px]
        out.append(VideoDetections(time, store_views(views), measure_timing(time), frames))
    return out, corners


def views_of(detections):
    """Return the tags of each frame."""
    tags = detections.tags
    rows = [tags.store.read(np.arange(a, b)) for a, b in zip(tags.first, tags.last, strict=True)]
    return [TagView(r["id"], r["corners"], r["covariance"], r["corners"]) for r in rows]


def test_three_cameras_locate_all_tags():
    true = cameras()
    detections, corners = filmed(true, true, np.random.default_rng(1))
    result = assemble(detections, Rig(true), SIZE, NAMES)
    middle = true[0].to_camera(corners.mean(axis=2))
    assert np.abs(result.tracks.points - middle).max() < 0.1
    assert (result.cameras == 3).all()


@pytest.mark.parametrize("order", [(1, 0, 2), (1, 2, 0)])
def test_videos_in_another_order_are_rejected(order):
    true = cameras()
    detections, _ = filmed([true[k] for k in order], true, np.random.default_rng(1))
    with raises(CaptureError, "camera-order-differs", order=order):
        assemble(detections, Rig(true), SIZE, NAMES)


@pytest.mark.parametrize("by", [(8.0, 0, 0), (0, 2.5, 0), (1.0, 1.5, -2)])
@pytest.mark.parametrize("moved", range(3))
def test_one_of_three_cameras_that_was_moved_is_left_out(moved, by):
    true = cameras()
    moved_rig = list(true)
    moved_rig[moved] = replace(true[moved], translation=true[moved].translation + np.array(by))
    detections, corners = filmed(moved_rig, true, np.random.default_rng(2))
    result = assemble(detections, Rig(true), SIZE, NAMES)
    middle = true[0].to_camera(corners.mean(axis=2))
    assert (result.cameras == 2).all()
    assert np.abs(result.tracks.points - middle).max() < 0.2
    left_out = [w for w in result.quality["warnings"] if w.code == "camera-left-out"]
    assert [w[0] for w in left_out] == ["abc"[moved]]


def test_one_of_three_cameras_that_stops_leaves_two():
    true = cameras()
    detections, corners = filmed(true, true, np.random.default_rng(3))
    late = np.arange(FRAMES) >= FRAMES // 2
    detections[2] = replace(detections[2], tags=detections[2].tags.without(late))
    result = assemble(detections, Rig(true), SIZE, NAMES)
    assert (result.cameras[: FRAMES // 2] == 3).all()
    assert (result.cameras[FRAMES // 2 :] == 2).all()
    middle = true[0].to_camera(corners.mean(axis=2))
    assert np.abs(result.tracks.points - middle).max() < 0.1


@pytest.mark.parametrize(("count", "late"), [(3, 0.08), (3, 0.3), (2, 3.2)])
def test_camera_that_started_late_is_synchronized(count, late):
    true = cameras()[:count]
    detections, corners = filmed(true, true, np.random.default_rng(4), late, frames=180)
    result = assemble(detections, Rig(true), SIZE, NAMES[:count])
    assert result.quality["offsets"][-1] == pytest.approx(late, abs=1e-3)
    assert "camera-left-out" not in [w.code for w in result.quality["warnings"]]
    middle = true[0].to_camera(corners.mean(axis=2))
    is_shared = result.cameras >= 2
    assert is_shared.mean() > 0.95 - late / 6
    assert np.nanmax(np.abs(result.tracks.points - middle)[is_shared]) < 0.2


@pytest.mark.parametrize("by", [(0, 3.0, 0), (1.0, 2.5, -1), (2.0, 0, 0)])
def test_camera_of_two_that_is_moved_while_recording_gets_a_new_pose(by):
    true = cameras()[:2]
    bumped = replace(true[1], translation=true[1].translation + np.array(by))
    half = 60
    detections, corners = filmed(true, true, np.random.default_rng(5), frames=2 * half)
    after, _ = filmed([true[0], bumped], true, np.random.default_rng(5), frames=2 * half)
    shown = [
        views_of(w[1])[part] for w, part in ((detections, slice(half)), (after, slice(half, None)))
    ]
    detections[1] = replace(detections[1], tags=store_views([*shown[0], *shown[1]]))
    result = assemble(detections, Rig(true), SIZE, ["a", "b"])
    (moved,) = result.quality["moved"]
    assert moved["time"] == pytest.approx(half / 30, abs=0.05)
    is_near = np.abs(result.tracks.time - half / 30) < 0.25
    assert (result.cameras[~is_near] == 2).all()
    assert (result.cameras[is_near] == 2).mean() < 0.5
    error = np.linalg.norm(result.tracks.points - true[0].to_camera(corners.mean(axis=2)), axis=2)
    assert np.nanmax(error[:half]) < 0.2
    assert np.nanmax(error[half:]) < 0.5  # 3 mm with the former pose
    assert [w.code for w in result.quality["warnings"]].count("camera-moved") == 1


@pytest.mark.parametrize(
    ("late", "lost", "drift"), [(0.0, 0.0, 0.0), (3e-3, 0.0, 0.0), (10e-3, 0.15, 500e-6)]
)
def test_late_stamps_do_not_move_positions(late, lost, drift):
    """Two free-running cameras have half-normal delays of their stamps, and lose frames."""
    left_out, lag, stated, error = trial(late, lost, drift, 15.0, seed=1)
    assert left_out <= 3 + 0.1 * (lost > 0) * 450
    assert abs(lag) < 1.0
    assert error < 0.12
    assert stated < 0.05
