"""Labels, panels and scales are arranged without overlap."""

import itertools

import numpy as np
import pytest

from defsense_fab.report.pictures import color_bar, labels
from defsense_fab.report.pictures.body_views import Panel, arrange_panels


def crosses(a, b, c, d):
    """Return whether the segments ab and cd cross."""

    def side(p, q, r):
        return np.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) != side(a, b, d) and side(c, d, a) != side(c, d, b)


@pytest.mark.parametrize("seed", range(8))
def test_labels_are_next_to_the_drawing_and_their_lines_do_not_cross(seed):
    rng = np.random.default_rng(seed)
    size, height = (500.0, 300.0), 28.0
    anchors = rng.uniform(0, 1, (int(rng.integers(1, 17)), 2)) * size * [1, 0.3]  # crowded
    placed = labels.places(anchors, size, height)
    assert ((placed.ends[:, 0] < 0) == placed.left).all()
    assert ((placed.ends[:, 0] > size[0]) == ~placed.left).all()
    for is_left in (True, False):
        y = np.sort(placed.ends[placed.left == is_left, 1])
        assert (np.diff(y) > height - 1e-6).all()
    for i, j in itertools.combinations(range(len(anchors)), 2):
        if placed.left[i] == placed.left[j]:
            assert not crosses(anchors[i], placed.ends[i], anchors[j], placed.ends[j])


def test_labels_with_room_keep_their_preferred_places():
    preferred = np.array([10.0, 60, 65, 70, 200])
    middles = labels.spread(preferred, 20.0)
    assert middles == pytest.approx([10, 45, 65, 85, 200])  # three labels around their middle
    tall = np.array([20.0, 20, 40, 20, 20])
    limited = labels.spread(preferred, tall, (5.0, 180.0))
    assert limited == pytest.approx([15, 35, 65, 95, 170])


def test_the_spot_of_a_region_is_inside_it():
    region = np.zeros((60, 80), bool)
    region[10:50, 10:14] = region[46:50, 10:70] = True  # an L, whose middle is outside
    x, y = labels.spot(region)
    assert region[int(y), int(x)]
    assert labels.spot(np.zeros((5, 5), bool)) is None


@pytest.mark.parametrize(
    "sizes",
    [
        [(150, 90), (150, 30), (150, 30)],
        [(60, 220), (45, 210), (40, 210)],
        [(150, 80), (150, 12), (150, 70)],
        [(80, 80), (80, 80)],
        [(300, 4)],
    ],
)
def test_panels_fill_their_picture_and_keep_apart(sizes):
    rim = (60.0, 4.0, 4.0, 90.0)
    panels = [Panel(np.array(s, float), rim, 260.0) for s in sizes]
    plan = arrange_panels(panels, 1100, 760)
    assert plan.size[0] <= 1100 + 1e-6
    assert plan.size[1] <= 760 + 1e-6
    assert max(plan.size[0] / 1100, plan.size[1] / 760) > 0.99
    boxes = list(zip(plan.corners, plan.rooms, strict=True))
    for corner, room in boxes:
        assert (corner >= -1e-6).all()
        assert (corner + room <= np.array(plan.size) + 1e-6).all()
    for (a, wide), (b, other) in itertools.combinations(boxes, 2):
        assert (a + wide <= b + 1e-6).any() or (b + other <= a + 1e-6).any()


@pytest.mark.parametrize(
    ("largest", "top", "step"),
    [
        (6.41, 8, 2),
        (0.502, 0.6, 0.2),
        (10, 10, 2),
        (33, 40, 10),
        (1.1e-4, 1.25e-4, 2.5e-5),
        (0, 1, 0.5),
    ],
)
def test_scales_end_and_step_at_round_numbers(largest, top, step):
    scale = color_bar.scale("viridis", "strain", largest)
    assert (scale.top, scale.step) == pytest.approx((top, step))
