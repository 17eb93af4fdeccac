"""Test where points of a body and next to it are in deformed states."""

import numpy as np
import pytest

import defsense_fab as df
from tests.support.errors import raises


def test_points_outside_move_rigidly_with_the_nearest_point(simulation):
    anchors = np.array([[40.0, 3, 10], [60, 10, 2], [80, 1, 1]])
    arms = np.array([[0.0, 0, 7], [0, 7, 0], [7, 0, 0]])
    moved_anchors = simulation.displaced(anchors)
    for scale in (1e-6, 1.0):
        moved = simulation.displaced(anchors + scale * arms)
        lengths = np.linalg.norm(moved - moved_anchors, axis=2)
        np.testing.assert_allclose(lengths, 7.0 * scale, rtol=1e-3)
    bend = simulation.index("bend@1")
    arm = (simulation.displaced(anchors + arms) - moved_anchors)[bend, 2]
    angle = np.degrees(np.arctan2(-arm[2], arm[0]))
    assert angle == pytest.approx(20.0, abs=0.5)  # of the handle at the tip, about +y


@pytest.mark.parametrize(
    ("points", "count", "index", "distance"),
    [
        ([[40, 0, 20]], 1, 0, 10.0),
        ([[0, 0, 0], [0.5, 0, 9e3], [0, 0, -50]], 2, 1, 8990.0),
    ],
)
def test_distant_points_are_refused(simulation, points, count, index, distance):
    with raises(df.DefsenseError, "points-outside", count=count, index=index) as caught:
        simulation.displaced(points)
    assert caught.value.data["limit"] == pytest.approx(8.49, abs=0.01)  # a tenth of the diagonal
    assert caught.value.data["distance"] == pytest.approx(distance, rel=1e-3)


def test_no_points_give_an_empty_array(simulation):
    assert simulation.displaced(np.zeros((0, 3))).shape == (len(simulation.names), 0, 3)


def test_picture_of_a_state_is_a_png(simulation):
    assert simulation.picture("bend@1").png.startswith(b"\x89PNG")
