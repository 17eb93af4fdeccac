"""Frames are aligned with the rest pose by rigid motions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from benchmarks.alignment import frames, loop
from defsense_fab.capture.tracking.alignment import MIN_WIDTH, align, rotate_covariances
from defsense_fab.capture.tracking.rest_pose import find_rest_pose
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises

REST = np.array([[0, 0, 0], [40, 0, 5], [35, 20, 0], [5, 25, 10], [20, 10, 15], [60, 5, 0.0]])


def motions(t, rng, far=500.0):
    return Rotation.random(t, rng=rng).as_matrix(), rng.uniform(-far, far, (t, 3))


def moved(points, rotation, shift):
    return points @ rotation.swapaxes(1, 2) + shift[:, None]


def off_one_line(rest, used):
    """Return whether markers are off one line, by the documented rule."""
    s = np.linalg.svd(rest[used] - rest[used].mean(axis=0), compute_uv=False)
    return np.hypot(s[1], s[2]) > MIN_WIDTH * s[0]


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(3, 12), st.integers(0, 10_000), st.booleans(), st.sampled_from([0.0, 0.3]))
def test_any_rigid_motion_is_undone_with_any_mask(m, seed, flat, noise):
    rng = np.random.default_rng(seed)
    rest = rng.uniform(-50, 50, (m, 3)) * [1, 1, 0 if flat else 1]
    points = rest + rng.normal(0, noise, (8, m, 3))
    points[rng.random((8, m)) < 0.2] = np.nan
    mask, weights = rng.random(m) < 0.7, rng.uniform(0.2, 5, m)
    if mask.sum() < 3 or not off_one_line(rest, mask):
        with pytest.raises(CaptureError) as caught:
            align(points, rest, weights, mask)
        assert caught.value.code in ("too-few-markers", "markers-on-one-line")
        return
    before = align(points, rest, weights, mask)
    after = align(moved(points, *motions(8, rng)), rest, weights, mask)
    assert after.ok.tolist() == before.ok.tolist()
    assert after.used.tolist() == before.used.tolist()
    np.testing.assert_allclose(after.points, before.points, atol=1e-9)
    np.testing.assert_allclose(after.residual, before.residual, atol=1e-9)
    if noise == 0:
        there = np.isfinite(points[..., 0]) & before.ok[:, None]
        np.testing.assert_allclose(
            after.points[there], np.broadcast_to(rest, points.shape)[there], atol=1e-9
        )
        used = mask & np.isfinite(points[..., 0])
        fits = [k.sum() >= 3 and off_one_line(rest, k) for k in used]
        equal = align(points, rest, None, mask)
        assert equal.ok.tolist() == fits


def test_result_equals_that_of_scipy():
    points, rest, weights = frames(200, 12)
    ours, (theirs, residual) = align(points, rest, weights), loop(points, rest, weights)
    assert ours.ok.all()
    np.testing.assert_allclose(ours.points, theirs, atol=1e-10)
    np.testing.assert_allclose(ours.residual, residual, atol=1e-10)
    back = np.einsum("tij,tmj->tmi", ours.rotation, points) + ours.translation[:, None]
    np.testing.assert_allclose(back, ours.points, atol=1e-9)


def test_zero_weights_act_as_a_mask():
    rng = np.random.default_rng(1)
    points = moved(REST + rng.normal(0, 1, (20, 6, 3)), *motions(20, rng))
    mask = np.array([True, True, True, False, True, False])
    by_mask, by_weight = align(points, REST, None, mask), align(points, REST, mask * 3.0)
    np.testing.assert_allclose(by_mask.points, by_weight.points, atol=1e-10)
    assert by_weight.used.tolist() == [4] * 20
    each = np.broadcast_to(mask, (20, 6))
    np.testing.assert_array_equal(align(points, REST, None, each).points, by_mask.points)
    firm = align(points, REST, np.array([1, 1e9, 1, 1, 1, 1.0]))
    assert np.abs(firm.points[:, 1] - REST[1]).max() < 1e-6


def test_mirrored_frame_is_rotated_not_reflected():
    rng = np.random.default_rng(2)
    mirrored = moved(np.broadcast_to(REST * [1, 1, -1], (5, 6, 3)), *motions(5, rng))
    out = align(mirrored, REST)
    assert out.ok.all()
    np.testing.assert_allclose(np.linalg.det(out.rotation), 1, atol=1e-12)
    assert out.residual.min() > 3
    # A regular tetrahedron is as long every way: of its mirror image no turn is the best.
    solid = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]]) * 20
    assert not align(-solid[None], solid).ok.any()


def test_frames_of_too_few_or_on_a_line_are_rejected():
    line = np.array([[0, 0, 0], [30, 1, 0], [60, 0, 0], [90, 0, 0], [40, 25, 0.0]])
    points = np.tile(line, (7, 1, 1))
    points[1, 4] = np.nan  # what is left lies on a line
    points[2, 1:4] = np.nan  # two are left
    points[3] = np.nan
    points[4, :, 1:] = 0  # the frame shows a line, not the rest pose
    points[5] = 7.0  # all in one place
    points[6, 1, 1], points[6, 4] = 40.0, np.nan  # off the line only in the frame
    out = align(points, line)
    assert out.ok.tolist() == [True, *[False] * 6]
    assert out.used.tolist() == [5, 4, 2, 0, 5, 5, 4]
    for array in (out.points, out.rotation, out.translation, out.residual):
        assert np.isnan(array[1:]).all()
        assert np.isfinite(array[0]).all()


def test_rest_pose_without_a_rotation_is_rejected():
    line = np.outer(np.arange(5.0), [10, 3, 0])
    line[4] += [0, 0, 30]
    points, ids = np.zeros((2, 5, 3)), np.array([4, 8, 15, 16, 23])
    mask = np.arange(5) < 4
    with raises(CaptureError, "markers-on-one-line", markers=[4, 8, 15, 16]):
        align(points, line, None, mask, ids=ids)
    with raises(CaptureError, "too-few-markers", markers=[4, 23]):
        align(points, np.where(np.isin(ids, [4, 23])[:, None], line, np.nan), ids=ids)
    with raises(CaptureError, "out-of-range", marker=15, frame=0):
        align(points, line, np.array([1, 1, -1, 1, 1.0]), ids=ids)
    with raises(CaptureError, "wrong-shape"):
        align(points, line[:4])


def test_missing_points_have_no_effect_and_stay_missing():
    rng = np.random.default_rng(3)
    points = moved(REST + rng.normal(0, 0.5, (10, 6, 3)), *motions(10, rng))
    points[:, 5] = np.nan
    points[3, 2, 1] = np.inf  # a part that is no number is not seen
    weights = np.where(np.isfinite(points).all(axis=2), 2.0, np.nan)
    out = align(points, REST, weights, sigma=np.where(np.isfinite(points), 0.1, np.nan))
    rows = np.arange(10) != 3
    less = align(points[rows, :5], REST[:5])
    np.testing.assert_allclose(out.points[rows, :5], less.points, atol=1e-10)
    assert np.isnan(out.points[:, 5]).all()
    assert np.isnan(out.points[3, 2]).all()
    assert (np.isfinite(out.sigma) == np.isfinite(out.points)).all()
    assert out.used.tolist() == [4 if k == 3 else 5 for k in range(10)]


def test_residual_is_the_rms_distance():
    points = np.array([[[10, 0, 0], [-10, 0, 0], [0, 10, 0], [0, -10, 0.0]]])
    rest = points[0] + [[0, 0, 1], [0, 0, 1], [0, 0, -1], [0, 0, -1]]  # twisted: no turn helps
    out = align(points, rest)
    assert out.residual[0] == pytest.approx(1.0, abs=1e-12)
    assert align(points * 1.1, points[0]).residual[0] == pytest.approx(1.0, abs=1e-12)


def test_covariances_match_sampled_errors():
    rng = np.random.default_rng(4)
    R, shift = (a[0] for a in motions(1, rng))
    A = rng.normal(0, 0.1, (6, 3, 3))
    S = A @ A.swapaxes(1, 2) + 0.01 * np.eye(3)
    true = REST @ R.T + shift
    n = 20_000
    errors = np.einsum("mij,tmj->tmi", np.linalg.cholesky(S), rng.normal(size=(n, 6, 3)))
    weights, mask = np.array([1, 2, 0.5, 1, 1, 1]), np.arange(6) != 5
    sampled = align(true + errors, REST, weights, mask)
    message = align(true[None], REST, weights, mask, sigma=S[None])
    for k in range(6):
        result = np.cov(sampled.points[:, k].T)
        scale = np.trace(result)
        assert np.abs(result - message.covariance[0, k]).max() < 0.03 * scale
    spin = Rotation.from_matrix(sampled.rotation @ R).as_rotvec()
    assert message.rotation_sigma[0] == pytest.approx(
        np.sqrt(np.linalg.eigvalsh(np.cov(spin.T))[-1]), rel=0.03
    )
    np.testing.assert_allclose(message.sigma[0] ** 2, np.einsum("mii->mi", message.covariance[0]))


def test_covariances_turn_with_the_points():
    rng = np.random.default_rng(5)
    R = Rotation.random(3, rng=rng).as_matrix()
    sigma = rng.uniform(0.1, 2, (3, 2, 3))
    full = np.einsum("tmi,ij->tmij", sigma**2, np.eye(3))
    expected = np.einsum("tij,tmjk,tlk->tmil", R, full, R)
    np.testing.assert_allclose(rotate_covariances(sigma, R), expected, atol=1e-13)
    np.testing.assert_allclose(rotate_covariances(full, R), expected, atol=1e-13)
    np.testing.assert_allclose(rotate_covariances(expected, R.swapaxes(1, 2)), full, atol=1e-12)


def test_noise_that_hides_the_shape_is_rejected():
    points = np.tile(REST, (2, 1, 1))
    sigma = np.full((2, 6, 3), 0.05)
    sigma[1] = 30.0
    out = align(points, REST, sigma=sigma)
    assert out.ok.tolist() == [True, False]
    assert np.isnan(out.points[1]).all()
    assert np.isnan(out.sigma[1]).all()
    unknown = align(points, REST, sigma=sigma * np.nan)
    assert unknown.ok.all()
    assert np.isnan(unknown.sigma).all()


def test_no_frames():
    out = align(np.empty((0, 6, 3)), REST, sigma=np.empty((0, 6, 3)))
    assert out.points.shape == (0, 6, 3)
    assert out.covariance.shape == (0, 6, 3, 3)


def resting(t, rng, rest=REST, noise=0.1, missing=0.4):
    points = moved(rest + rng.normal(0, noise, (t, len(rest), 3)), *motions(t, rng))
    points[rng.random(points.shape[:2]) < missing] = np.nan
    return points


def test_rest_pose_from_noisy_frames_that_move():
    rng = np.random.default_rng(6)
    points = resting(300, rng)
    sigma = np.where(np.isfinite(points), 0.1, np.nan)
    out = find_rest_pose(points, sigma, REST)
    assert np.abs(out.points - REST).max() < 0.04  # noise 0.1 over some 180 frames, 4 sigma
    assert not out.is_misplaced.any()


def test_better_frames_count_for_more():
    rng = np.random.default_rng(7)
    good, bad = resting(20, rng, noise=0.01, missing=0), resting(200, rng, noise=1.0, missing=0)
    points = np.concatenate([good, bad])
    sigma = np.where(np.arange(220) < 20, 0.01, 1.0)[:, None, None] * np.ones(points.shape)
    assert np.abs(find_rest_pose(points, sigma, REST).points - REST).max() < 0.015
    assert np.abs(find_rest_pose(points, None, REST).points - REST).max() > 0.05


def test_positions_of_one_camera_have_little_weight_in_the_rest_pose():
    """Their depth has the same error in every frame, as large as stated."""
    rng = np.random.default_rng(12)
    visible_markers = REST.copy()
    visible_markers[5] += [0, 2.4, 0]
    points = resting(100, rng, visible_markers, 0.02, 0.0)
    sigma = np.full(points.shape, 0.02)
    sigma[:, 5] = 2.0
    off = np.linalg.norm(find_rest_pose(points, sigma, REST).points - REST, axis=1)
    assert off[:5].max() < 0.1
    alike = find_rest_pose(points, np.full(points.shape, 0.02), REST).points - REST
    assert np.linalg.norm(alike, axis=1)[:5].max() > 0.5
    visible_markers[5] += [0, 2, 0]
    points = resting(100, rng, visible_markers, 0.02, 0.0)
    assert not find_rest_pose(points, sigma, REST).is_misplaced.any()
    assert find_rest_pose(points, None, REST).is_misplaced.tolist() == [False] * 5 + [True]


def test_misplaced_markers_are_reported_and_have_no_effect():
    rng = np.random.default_rng(8)
    glued = REST.copy()
    glued[1] += [0, 12, 0]
    design = np.vstack([REST, [[0, 0, 40.0]]])
    design[4] = np.nan  # not in the design
    points = np.concatenate([resting(100, rng, glued, 0.02, 0.2), np.full((100, 1, 3), np.nan)], 1)
    out = find_rest_pose(points, None, design)
    assert np.flatnonzero(out.is_misplaced).tolist() == [1]
    assert out.distance[1] == pytest.approx(12, abs=0.05)
    assert np.abs(out.points[:6] - glued).max() < 0.05
    assert np.isnan(out.points[6]).all()
    assert np.isnan(out.distance[[4, 6]]).all()


def test_several_misplaced_markers_are_reported():
    rng = np.random.default_rng(10)
    design = rng.uniform(-40, 40, (9, 3))
    glued = design.copy()
    glued[[0, 4, 5, 8]] += [30, 20, 0]  # all in one direction, which would move the mean
    out = find_rest_pose(resting(20, rng, glued, 0.02, 0.0), None, design)
    assert np.flatnonzero(out.is_misplaced).tolist() == [0, 4, 5, 8]
    assert np.abs(out.points - glued).max() < 0.1


def test_alignment_by_three_markers_removes_their_errors_across_the_plane():
    points = REST[None, [0, 1, 2, 5]]
    out = align(points, points[0], None, np.arange(4) < 3, sigma=np.full((1, 4, 3), 0.1))
    normal = np.cross(REST[1] - REST[0], REST[2] - REST[0])
    across = out.covariance[0] @ (normal / np.linalg.norm(normal))
    np.testing.assert_allclose(across[:3], 0, atol=1e-12)  # they lie in the plane of the rest pose
    assert np.isfinite(out.sigma).all()
    assert out.sigma[0, 3].max() > 0.1


def test_undetermined_rest_pose_is_rejected():
    rng = np.random.default_rng(9)
    points = resting(10, rng, missing=0)
    with raises(CaptureError, "markers-misplaced", total=6):
        find_rest_pose(points * 1.5, None, REST)
    with raises(CaptureError, "too-few-markers", count=2):
        find_rest_pose(points, None, np.where(np.arange(6)[:, None] < 2, REST, np.nan))
    points[:, 2:] = np.nan
    with raises(CaptureError, "rest-pose-not-visible", frames=10):
        find_rest_pose(points, None, REST)
    with raises(CaptureError, "rest-pose-not-visible", frames=0):
        find_rest_pose(np.empty((0, 6, 3)), None, REST)
