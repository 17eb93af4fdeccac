"""Tags as printers make them, and hands in the way."""

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_kinds import simulate_passing_finger, print_patch
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Patch, Scene
from tests.errors import raises
from tests.twin.views import camera, tag

UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
FLAT = Patch(7, tag(), np.zeros(3), UPRIGHT, 30.0)


def test_spread_ink_is_wider_by_what_was_told():
    inked = print_patch(FLAT, 0.2, 0.0)
    assert inked.size == pytest.approx(30.4)
    widened = inked.corners - FLAT.corners
    assert np.abs(widened @ UPRIGHT[:, :2]) == pytest.approx(np.full((4, 2), 0.2))
    quiet = Optics(blur=0.0, read=0.0, shot=0.0, vignetting=0.0)
    pictures = [
        Renderer(camera((0, -150, 0)), quiet, np.random.default_rng(0)).shoot(Scene((p,)))
        for p in (FLAT, inked)
    ]
    edges = (np.diff(FLAT.pattern.astype(int), axis=1) != 0).sum()
    edges += (np.diff(FLAT.pattern.astype(int), axis=0) != 0).sum()
    edges += 4 * FLAT.pattern.shape[0]  # to the margin
    lost = (pictures[0].image.astype(float) - pictures[1].image).sum() / (210 - 25) / 0.965
    scale = np.linalg.norm(pictures[0].corners[0, 1] - pictures[0].corners[0, 0]) / 30
    assert lost == pytest.approx(edges * FLAT.cell * 0.2 * scale**2, rel=0.1)
    with raises(CaptureError, "ink-too-wide"):
        print_patch(FLAT, 6.0, 0.0)


def test_curled_paper_keeps_its_corners_and_bows_between_them():
    curled = print_patch(FLAT, 0.0, 0.004)
    assert curled.corners == pytest.approx(FLAT.corners)
    n = FLAT.pattern.shape[0]
    top = np.array([[n / 2, 0.0]])
    away = (curled.at(top) - FLAT.at(top)) @ UPRIGHT[:, 2]
    assert away == pytest.approx([-0.004 * 15**2 / 2])
    seen = [
        Renderer(camera((0, -150, 60)), Optics(), np.random.default_rng(0)).shoot(Scene((p,))).image
        for p in (FLAT, curled)
    ]
    assert (seen[0] != seen[1]).any()


def test_a_hand_passes_before_the_body_now_and_then():
    bounds = np.array([[0.0, -15, -15], [150, 15, 15]])
    towards = np.array([0.6, 0.0, 0.8])
    passing = simulate_passing_finger(np.random.default_rng(1), bounds, towards)
    times = np.arange(0, 60, 0.05)
    there = np.array([bool(passing(t)) for t in times])
    assert 0.1 < there.mean() < 0.3
    assert (np.diff(there.astype(int)) == 1).sum() == 10
    for t in times[there]:
        (ball,) = passing(t)
        # In front of every corner of the body, as the cameras see it.
        assert ball.center @ towards - ball.radius > (bounds[1] @ towards)
        assert passing(t)[0].center == pytest.approx(ball.center)


def test_before_the_beginning_no_hand_is_there():
    bounds = np.array([[-10.0, -10, -10], [10, 10, 10]])
    passing = simulate_passing_finger(np.random.default_rng(1), bounds, np.array([0.0, 0, 1]))
    assert passing(-0.01) == passing(0.0) == ()
