"""Moves of cameras while they record are found, also with lenses that the model lacks."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.tracking.camera_motion import (
    CameraMotion,
    find_camera_motion,
    which_moved,
)
from defsense_fab.capture.tracking.pose_equations import shared_views
from defsense_fab.core.rotations import rotation_matrices
from tests.capture.rigs import flat, rig, spread, tags

SIDE, TAGS, FRAMES, NOISE = 15.0, 6, 150, 0.03


def moved(camera, axis, shift=(0.0, 0, 0)):
    R = rotation_matrices(np.asarray(axis))
    return replace(camera, rotation=R @ camera.rotation, translation=R @ camera.translation + shift)


def film(cameras, at, mover, after, rng, lens=0.0):
    """Return views of moving tags; from frame `at` on, camera `mover` has the pose `after`."""
    base = tags(TAGS, rng)
    t = np.arange(FRAMES) / 30
    by = 25 * np.sin(2 * np.pi * np.outer(t, [0.7, 1.1, 0.5]) + [0, 1, 2])
    moving_tags = base + by[:, None, None]
    pixels = []
    for k, camera in enumerate(cameras):
        px = flat(camera, moving_tags)
        if k == mover:
            px[at:] = flat(after, moving_tags)[at:]
        off = (px - camera.matrix[:2, 2]) / camera.focal
        px += lens * camera.focal * off * (off**2).sum(-1, keepdims=True)
        pixels.append(px + rng.normal(scale=NOISE, size=px.shape))
    corners = np.stack(pixels, axis=2)
    covariance = spread((FRAMES, TAGS, len(cameras)), NOISE)
    return shared_views(np.arange(FRAMES), corners, covariance, SIDE)


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("axis", [(0.002, 0, 0), (0, 0.004, 0), (0, 0, 0.01)])
def test_turn_and_a_shift_are_found(count, axis):
    rng = np.random.default_rng(count)
    cameras = rig(count)
    after = moved(cameras[1], axis, (0.5, -0.4, 0.3))
    (result,) = find_camera_motion(cameras, film(cameras, 90, 1, after, rng, lens=0.01), 1)
    assert result.camera == 1
    assert abs(result.at - 90) <= 1
    # A turn and a shift are hard to distinguish, so projections are compared.
    there = tags(20, rng)
    off = flat(result.moved(cameras[1]), there) - flat(after, there)
    assert np.sqrt((off**2).mean()) < 0.2 * np.sqrt(
        ((flat(cameras[1], there) - flat(after, there)) ** 2).mean()
    )


@pytest.mark.parametrize("lens", [0.0, 0.02])
def test_no_move_is_found_without_motion(lens):
    rng = np.random.default_rng(5)
    cameras = rig(2)
    assert find_camera_motion(cameras, film(cameras, 0, 1, cameras[1], rng, lens=lens), 1) == []


def test_tags_of_a_single_camera_show_no_move():
    cameras = rig(2)
    views = film(cameras, 0, 1, cameras[1], np.random.default_rng(0))
    none = np.zeros(0, int)
    few = replace(views, frame=none, corners=views.corners[:0], variance=views.variance[:0])
    assert find_camera_motion(cameras, few, 1) == []


def test_motions_of_two_cameras_are_inverse():
    one, two = rig(2)
    R = rotation_matrices(np.array([0.01, -0.02, 0.03]))
    motion = CameraMotion(1, 0, R, np.array([1.0, 2.0, 3.0]))
    other = motion.of_other(two, one, 0)
    points = tags(3, np.random.default_rng(1)).reshape(-1, 3)
    # The relative pose of the pair is the same.
    first, second = motion.moved(two), other.moved(one)
    at = first.to_camera((points - one.translation) @ one.rotation)
    again = two.to_camera((points - second.translation) @ second.rotation)
    assert at == pytest.approx(again)


def test_image_that_jumps_shows_which_camera_moved():
    time = np.arange(300) / 30
    rng = np.random.default_rng(2)
    slow = 10 * np.sin(0.5 * time)[:, None, None] + rng.normal(0, 0.05, (300, 4, 2))
    jumped = slow + np.where(time > 5, 6.0, 0.0)[:, None, None]
    assert which_moved([(time, slow), (time, jumped)], 5.0, 0.1) == 1
    assert which_moved([(time, jumped), (time, slow)], 5.0, 0.1) == 0
    fast = slow + 80 * np.sin(8 * time)[:, None, None]
    assert which_moved([(time, fast), (time, fast + jumped)], 5.0, 0.1) is None
