"""Cameras are calibrated, arranged and checked from corners of boards, without images."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.capture.cameras.extrinsics import BundleAdjustment, estimate_extrinsics
from defsense_fab.capture.cameras.intrinsics import calibrate_camera
from defsense_fab.capture.cameras.rig_check import Cause, check_rig, diagnose
from defsense_fab.capture.cameras.view_selection import (
    choose_views,
    corner_motion,
    describe_view,
    measure_coverage,
)
from defsense_fab.capture.tags.detection import BoardFinder, BoardView
from defsense_fab.capture.tags.tag_patterns import CharucoBoard, load_board, save_board
from defsense_fab.core.camera import Camera
from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import render
from defsense_fab.twin.scenes.scene import Patch, Scene
from tests.capture.rigs import rig
from tests.support.errors import raises
from tests.twin.views import turn

pytestmark = pytest.mark.slow

BOARD = CharucoBoard()
LENS = np.array([-0.2, 0.08, 0.001, -0.0015, 0.0])
K = np.array([[900, 0, 645.0], [0, 905, 352], [0, 0, 1]])
LENSED = Camera("left", (1280, 720), K, LENS, np.eye(3), np.zeros(3))


def view_of(camera, pose, rng, noise=0.05, board=BOARD):
    """Return a view of the board in a pose (rotation, and position of its middle in the world)."""
    R, at = pose
    px = camera.project((board.corners - board.corners.mean(axis=0)) @ R.T + at)
    px = px + rng.normal(0, noise, px.shape)
    inside = (px > 5).all(axis=1) & (px < np.array(camera.size) - 6).all(axis=1)
    if inside.sum() < 6:
        return None
    return BoardView(np.flatnonzero(inside), px[inside])


def random_views(count, rng, tilt=0.6, noise=0.05, camera=LENSED):
    views = []
    while len(views) < count:
        at = np.array([*rng.uniform(-110, 110, 2), rng.uniform(330, 480)])
        view = view_of(camera, (turn(*rng.uniform(-tilt, tilt, 2)), at), rng, noise)
        if view is not None:
            views.append(view)
    return views


def shared_views(cameras, count, rng, pairs=None, noise=0.05, board=BOARD):
    out = []
    for k in range(count):
        who = range(len(cameras)) if pairs is None else pairs[k % len(pairs)]
        R = turn(np.pi / 2) @ turn(*rng.uniform(-0.4, 0.4, 2)) @ np.diag([1, -1, -1.0])
        pose = R, rng.uniform(-40, 40, 3)
        views = {c: view_of(cameras[c], pose, rng, noise, board) for c in who}
        out.append({c: v for c, v in views.items() if v is not None})
    return out


def relative(cameras):
    a = cameras[0]
    return [(c.rotation @ a.rotation.T, c.translation - c.rotation @ a.rotation.T @ a.translation)
            for c in cameras]  # fmt: skip


def test_intrinsics_are_estimated_without_bad_views():
    rng = np.random.default_rng(0)
    views = random_views(18, rng)
    bent = views[4].corners + rng.normal(0, 4, views[4].corners.shape)
    views[4] = BoardView(views[4].ids, bent)
    result = calibrate_camera("left", (1280, 720), BOARD, views)
    assert np.flatnonzero(~result.used).tolist() == [4]
    assert result.error == pytest.approx(0.05 * 2**0.5, rel=0.15)
    K_ = result.camera.matrix
    received = np.append(K_[[0, 1, 0, 1], [0, 1, 2, 2]], result.camera.distortions)
    true = np.append(K[[0, 1, 0, 1], [0, 1, 2, 2]], LENS)
    assert np.abs((received - true)[:8] / result.sigma[:8]).max() < 4
    assert np.abs(received - true)[:4].max() < 2


def test_views_that_do_not_determine_the_camera_are_rejected():
    rng = np.random.default_rng(1)
    with raises(CaptureError, "too-few-views", camera="left", count=7):
        calibrate_camera("left", (1280, 720), BOARD, random_views(7, rng))
    with raises(CaptureError, "focal-length-uncertain", camera="left"):
        calibrate_camera("left", (1280, 720), BOARD, random_views(8, rng, tilt=0.02))
    wrong = [BoardView(v.ids, rng.permutation(v.corners)) for v in random_views(10, rng)]
    with raises(CaptureError, "views-inconsistent", camera="left"):
        calibrate_camera("left", (1280, 720), BOARD, wrong)


@pytest.mark.parametrize(("count", "pairs"), [(2, None), (3, None), (3, [(0, 1), (1, 2)])])
def test_camera_poses_are_recovered(count, pairs):
    cameras = rig(count)
    rng = np.random.default_rng(2)
    free = [replace(c, rotation=np.eye(3), translation=np.zeros(3)) for c in cameras]
    views = shared_views(cameras, 14, rng, pairs)
    result = estimate_extrinsics(free, BOARD, views)
    for (R, t), (R_, t_) in zip(relative(cameras), relative(result.cameras), strict=True):
        assert Rotation.from_matrix(R.T @ R_).magnitude() < 1e-3
        assert np.abs(t - t_).max() < 0.5
    assert result.error == pytest.approx(0.05 * 2**0.5, rel=0.1)
    assert result.shared[0, 1] == (14 if pairs is None else 7)
    if pairs:
        assert result.shared[0, 2] == 0
    check = check_rig(result.cameras, BOARD, shared_views(cameras, 5, rng, pairs))
    assert check.holds
    assert check.ray_error < 0.2
    assert check.corner_error < 0.1


def test_intrinsics_change_within_their_uncertainty():
    cameras = rig(2)
    rng = np.random.default_rng(3)
    off = cameras[1].matrix.copy()
    off[[0, 1], [0, 1]] *= 1.004
    free = [cameras[0], replace(cameras[1], matrix=off)]
    sigma = [np.array([3, 3, 3, 3, 0.01, 0.01, 1e-3, 1e-3, 1e-2])] * 2
    views = shared_views(cameras, 16, rng)
    fixed, result = (
        estimate_extrinsics(free, BOARD, views),
        estimate_extrinsics(free, BOARD, views, sigma),
    )
    assert result.error < fixed.error
    assert np.abs(result.cameras[1].focal / cameras[1].focal - 1).max() < 0.002


def test_boards_that_move_between_the_shutters_do_not_bend_the_lenses():
    cameras, rng = rig(2), np.random.default_rng(2)
    board = CharucoBoard(columns=4, rows=5, square=30)
    lens_sigma = np.array(
        [4, 4, 15, 12, 0.015, 0.05, 4e-3, 6e-3, 0.0]
    )  # of views that fill a quarter
    views = []
    for s in shared_views(cameras, 12, rng, board=board):
        jerk = rng.normal(0, 2.0, (2, 2))  # px by which a view is of another instant
        views.append({c: BoardView(v.ids, v.corners + jerk[c]) for c, v in s.items()})
    result = estimate_extrinsics(cameras, board, views, [lens_sigma] * 2)
    for was, now in zip(cameras, result.cameras, strict=True):
        assert np.abs((now.matrix - was.matrix)[[0, 1], [2, 2]]).max() < 12  # 44 before
    turned = relative(cameras)[1][0].T @ relative(result.cameras)[1][0]
    assert np.degrees(Rotation.from_matrix(turned).magnitude()) < 2


def test_jacobian_matches_finite_differences():
    cameras = rig(3)
    cameras[2] = replace(cameras[2], distortions=np.array(
        [0.1, -0.05, 0.001, 0.002, 0.01, 0.05, -0.02, 0.01]))  # fmt: skip
    rng = np.random.default_rng(4)
    views = shared_views(cameras, 3, rng)
    sigma = [np.array([3, 3, 3, 3, 0.01, 0.01, 1e-3, 1e-3, 1e-2])] * 3
    problem = BundleAdjustment(cameras, BOARD, views, sigma)
    start = relative(cameras)
    poses = [{0: (turn(0.3, 0.2, 0.1), np.array([5.0, 3, 400]))} for _ in views]
    x = problem.pack(start, poses)
    x = x + rng.normal(0, 0.01, x.shape)
    J, h = problem.jacobian(x), 1e-6
    for k in range(len(x)):
        step = h * (np.arange(len(x)) == k)
        numeric = (problem.residuals(x + step) - problem.residuals(x - step)) / (2 * h)
        assert np.allclose(J[:, k], numeric, rtol=1e-5, atol=1e-5 * max(np.abs(numeric).max(), 1))


def test_cameras_that_are_not_linked_are_named():
    cameras, rng = rig(3), np.random.default_rng(5)
    with raises(CaptureError, "too-few-views") as caught:
        estimate_extrinsics(cameras, BOARD, shared_views(cameras, 10, rng, [(0, 1)]))
    assert "top" in caught.value.data["cameras"]
    with raises(CaptureError, "too-few-views", cameras=("left", "right"), count=3):
        estimate_extrinsics(cameras[:2], BOARD, shared_views(cameras[:2], 3, rng))


def test_views_that_were_not_taken_together_are_rejected():
    cameras, rng = rig(2), np.random.default_rng(6)
    views = shared_views(cameras, 5, rng)
    mixed = [{0: a[0], 1: b[1]} for a, b in zip(views, views[3:] + views[:3], strict=True)]
    with raises(CaptureError, "camera-poses-unsolved"):
        estimate_extrinsics(cameras, BOARD, mixed)


def test_moved_or_swapped_cameras_fail_the_check():
    cameras, rng = rig(2), np.random.default_rng(7)
    assert check_rig(cameras, BOARD, shared_views(cameras, 5, rng)).holds
    R = turn(y=np.radians(2))
    moved = [cameras[0], replace(cameras[1], rotation=R @ cameras[1].rotation,
                                 translation=R @ cameras[1].translation)]  # fmt: skip
    views = shared_views(moved, 5, rng)
    check = check_rig(cameras, BOARD, views)
    assert not check.holds
    assert check.camera_errors.max() < 0.2
    swapped = [{0: v[1], 1: v[0]} for v in shared_views(cameras, 5, rng)]
    assert not check_rig(cameras, BOARD, swapped).holds
    zoomed = [replace(c, matrix=c.matrix * [[1.05], [1.05], [1]]) for c in cameras]
    assert not check_rig(zoomed, BOARD, shared_views(cameras, 5, rng)).holds
    one = check_rig(cameras[:1], BOARD, shared_views(cameras[:1], 5, rng))
    assert one.holds
    assert np.isnan(one.ray_error)
    with raises(CaptureError, "board-never-shared"):
        check_rig(cameras, BOARD, [])


def shuffled(views, order):
    """Return views in which camera c is source order[c]."""
    return [{order[c]: v for c, v in s.items()} for s in views]


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("print_scale", [0.95, 0.97, 1.01])
def test_board_of_another_size_is_not_taken_for_a_moved_camera(count, print_scale):
    cameras, rng = rig(count), np.random.default_rng(9)
    stated = BOARD.measure(30.3)
    printed = replace(BOARD, square=30.3 * print_scale, marker=22.0)
    views = shared_views(cameras, 3, rng, board=printed)
    result = diagnose(cameras, stated, views)
    assert not result.check.holds
    assert result.cause.kind == "board"
    assert result.cause.square == pytest.approx(30.3 * print_scale, rel=1e-3)
    assert diagnose(cameras, replace(printed, measured=None), views).cause is None


@pytest.mark.parametrize("order", [(1, 0), (1, 0, 2), (1, 2, 0), (2, 1, 0)])
@pytest.mark.parametrize("alike", [True, False])
def test_swapped_sources_are_distinguished_from_lenses_and_moves(order, alike):
    cameras, rng = rig(len(order)), np.random.default_rng(10)
    if not alike:
        cameras = [
            replace(c, matrix=c.matrix * np.array([[f], [f], [1]]))
            for c, f in zip(cameras, (0.9, 1.0, 1.1), strict=False)
        ]
    result = diagnose(cameras, BOARD, shuffled(shared_views(cameras, 5, rng), order))
    assert result.cause == Cause("order", None, order)
    small = replace(BOARD, square=28.5)
    both = diagnose(cameras, BOARD, shuffled(shared_views(cameras, 5, rng, board=small), order))
    assert (both.cause.kind, both.cause.order) == ("order", order)
    assert both.cause.square == pytest.approx(28.5, rel=1e-3)


@pytest.mark.parametrize("count", [2, 3])
def test_lens_and_a_move_are_named(count):
    cameras, rng = rig(count), np.random.default_rng(11)
    for k in range(8):
        R = turn(*np.radians(rng.uniform(-2, 2, 3)))
        shift = rng.uniform(-5, 5, 3)
        now = [*cameras[:-1], replace(cameras[-1], rotation=R @ cameras[-1].rotation,
                                      translation=R @ cameras[-1].translation + shift)]  # fmt: skip
        result = diagnose(cameras, BOARD, shared_views(now, 5, rng))
        assert result.cause == Cause("moved"), k
        # Of three cameras, one with a large error is identified.
        assert np.flatnonzero(result.check.disagreeing).tolist() in ([], [2] if count == 3 else [])
    if count == 3:
        assert result.check.disagreeing[2]
    lens = replace(cameras[-1], matrix=cameras[-1].matrix * [[1.1], [1.1], [1]])
    views = shared_views([*cameras[:-1], lens], 5, rng)
    result = diagnose(cameras, BOARD, views)
    assert result.cause == Cause("lens")


def test_swapped_cameras_next_to_each_other_share_no_board():
    apart = [replace(LENSED, name=n, translation=np.array([x, 0.0, 0])) for n, x in
             (("left", 60.0), ("right", -60.0))]  # fmt: skip
    rng = np.random.default_rng(12)
    views = [
        {c: view_of(camera, pose, rng) for c, camera in enumerate(apart)}
        for pose in [(turn(0.2 * k, 0.1, 0), np.array([0, 0, 400.0 + 20 * k])) for k in range(4)]
    ]
    result = diagnose(apart, BOARD, shuffled(views, (1, 0)))
    assert np.isnan(result.check.corner_error)  # the rays meet behind the cameras
    assert result.cause == Cause("order", None, (1, 0))


def test_chosen_views_differ_and_hints_state_what_is_missing():
    rng = np.random.default_rng(8)
    views = random_views(30, rng)
    d = np.array([describe_view(v, BOARD, (1280, 720)) for v in views])
    again = np.repeat(d, 3, axis=0)
    chosen = choose_views(again, np.zeros(len(again)), 12)
    assert len(chosen) == 12
    assert len(set((chosen // 3).tolist())) == 12
    assert choose_views(np.zeros((0, 5)), np.zeros(0), 5).size == 0
    assert corner_motion([views[0], views[0], None, views[1]]).tolist() == [0, 0, np.inf, np.inf]
    few = measure_coverage(views[:1], BOARD, (1280, 720), 20)
    assert "take 19 more views" in few.hints
    assert any("tilt" in h for h in few.hints)
    assert measure_coverage(views, BOARD, (1280, 720), 20).fraction > few.fraction
    # Tilted one way and the other the same board has descriptors apart.
    tilted = [view_of(LENSED, (turn(y=a), np.array([0, 0, 400.0])), rng) for a in (-0.5, 0.5)]
    ways = [describe_view(view, BOARD, (1280, 720)) for view in tilted]
    assert ways[0][3] * ways[1][3] < 0
    assert np.abs(ways[0][3] - ways[1][3]) > 0.5


def test_only_the_described_board_is_found():
    board = CharucoBoard(square=27.0, marker=21.0)  # of whole cells, 3 mm wide
    pattern = board.charuco.generateImage((9 * 7, 9 * 5))
    axes = np.diag([1, -1, -1.0]) @ turn(0.4, 0.3, 0.2)
    patch = Patch(0, pattern, np.array([10.0, 5, 400]), axes, 7 * 27.0)
    image = render(LENSED, Scene((patch,)), Optics(blur=0.7), np.random.default_rng(0))
    view = BoardFinder(board).find(image)
    assert len(view.ids) == 24
    true = LENSED.project(patch.to_world(board.corners[:, :2] / 3))
    assert np.sqrt(((view.corners - true) ** 2).sum(axis=1).mean()) < 0.1
    assert BoardFinder(CharucoBoard(dictionary="4X4_100")).find(image) is None
    assert BoardFinder(board).find(np.full((240, 320, 3), 90, np.uint8)) is None


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("legacy", [False, True])
def test_boards_of_other_programs_are_found(tmp_path, inverted, legacy):
    """They are white on black, or start with white with an even number of rows."""
    board = CharucoBoard(4, 6, 54, 40.5, "4X4_1000", inverted=inverted, legacy=legacy)
    save_board(board, tmp_path / "board.json")
    assert load_board(tmp_path) == board
    picture = board.charuco.generateImage((400, 600), marginSize=0)
    image = np.full((720, 640), 255, np.uint8)
    image[60:660, 120:520] = picture
    image = cv2.GaussianBlur(255 - image if inverted else image, (0, 0), 0.8)
    result = BoardFinder(board).find(image)
    assert result.ids.tolist() == list(range(15))
    expected = board.corners[:, :2] / 54 * 100 + [119.5, 59.5]
    assert np.abs(result.corners - expected).max() < 0.1
    other = BoardFinder(replace(board, inverted=not inverted)).find(image)
    assert other is None


def test_board_that_never_rests_gives_enough_views():
    """It always moves, and is often at nearly the same place."""
    rng = np.random.default_rng(9)
    views = random_views(45, rng)
    d = np.array([describe_view(v, BOARD, LENSED.size) for v in views])
    moves = rng.uniform(4, 15, 45)
    assert len(choose_views(d, moves, 60, allow_motion=True)) >= 30
    few = choose_views(d[:1] + rng.normal(0, 1e-3, (45, 5)), moves, 60, allow_motion=True)
    assert len(few) >= 30
    assert len(choose_views(d, moves, 60)) < 25  # cameras are arranged by slow ones alone
