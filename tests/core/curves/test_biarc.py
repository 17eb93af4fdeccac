"""Chains of arcs against the curves they stand for."""

import numpy as np
import pytest

from defsense_fab.core.curves.biarc import arcs
from defsense_fab.core.curves.curve import Hermite, catmull_rom


def circle(arc):
    """Centre and radius through three points, by the perpendicular bisectors."""
    a, m, b = arc
    lines = 2 * np.array([m - a, b - a])
    center = np.linalg.solve(lines, np.array([m @ m - a @ a, b @ b - a @ a]))
    return center, np.linalg.norm(a - center)


@pytest.mark.parametrize("seed", range(5))
def test_arcs_join_smoothly_and_follow_the_curve(seed):
    rng = np.random.default_rng(seed)
    x = np.array([2, 10, 36, 62, 88, 114, 140, 148.0])
    points = np.stack([x, rng.uniform(-10, 10, 8)], axis=1)
    curve = Hermite(points, catmull_rom(points))
    chain = arcs(curve, 0.01)
    assert chain[1:, 0] == pytest.approx(chain[:-1, 2], abs=1e-9)
    assert chain[0, 0] == pytest.approx(points[0])
    assert chain[-1, 2] == pytest.approx(points[-1])
    circles = [circle(a) for a in chain]
    for (c, _), (d, _), at in zip(circles[:-1], circles[1:], chain[:-1, 2], strict=True):
        u, v = at - c, at - d
        cross = u[0] * v[1] - u[1] * v[0]
        assert abs(cross) < 1e-5 * np.linalg.norm(u) * np.linalg.norm(v)
    for p in curve.sample(50):
        near = np.argsort(np.linalg.norm(chain[:, 1] - p, axis=1))[:6]
        off = [abs(np.linalg.norm(p - circles[i][0]) - circles[i][1]) for i in near]
        assert min(off) < 0.012


def test_a_straight_path_is_straight():
    points = np.array([[0, 0], [10, 0], [30, 0.0]])
    chain = arcs(Hermite(points, catmull_rom(points)), 0.01)
    assert np.abs(chain[:, :, 1]).max() < 1e-12
