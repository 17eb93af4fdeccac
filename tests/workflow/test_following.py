"""Points beside a body go with it as what is glued on it, and not by fields continued beyond it."""

import numpy as np
import pytest

import defsense_fab as df


def test_points_outside_are_carried_rigidly_by_the_nearest_place(poses):
    on = np.array([[40.0, 3, 10], [60, 10, 2], [80, 1, 1]])
    arm = np.array([[0.0, 0, 7], [0, 7, 0], [7, 0, 0]])
    near = poses.displaced(on)
    for reach in (1e-6, 1.0):
        far = poses.displaced(on + reach * arm)
        np.testing.assert_allclose(np.linalg.norm(far - near, axis=2), 7.0 * reach, rtol=1e-3)
    turned = (poses.displaced(on + arm) - near)[poses.index("bend@1"), 2]
    angle = np.degrees(np.arctan2(-turned[2], turned[0]))
    assert angle == pytest.approx(20.0, abs=0.5)  # of the handle at the tip, about +y


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[40, 0, 20]], r"1 of 1 lie more than 8.49 mm outside of the body, the furthest \(40.0"),
        ([[0, 0, 0], [0.5, 0, 9e3], [0, 0, -50]], r"2 of 3 lie .* \(0.5, 0.0, 9000.0\) by 8.99e"),
    ],
)
def test_points_far_outside_are_refused(poses, points, message):
    with pytest.raises(df.DefsenseError, match=message):
        poses.displaced(points)


def test_no_points_go_nowhere(poses):
    assert poses.displaced(np.zeros((0, 3))).shape == (len(poses.names), 0, 3)
