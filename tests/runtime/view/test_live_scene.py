"""Colors show the sign of a strain and the width of an interval."""

import numpy as np

from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.view.live_scene import BODY_COLORS, cord_color, marker_colors


def test_cords_are_blue_where_shorter_red_where_longer_grey_where_lost():
    assert cord_color(0.0, -0.1, 0.2) == (225, 225, 225)
    r, _, b = cord_color(0.2, -0.1, 0.2)
    assert r > 2 * b
    r, _, b = cord_color(-0.1, -0.1, 0.2)
    assert b > 2 * r
    assert cord_color(0.4, -0.1, 0.2) == cord_color(0.2, -0.1, 0.2)
    assert cord_color(float("nan"), -0.1, 0.2) == (90, 90, 90)


def test_markers_turn_red_as_their_intervals_widen():
    sure, wide, unknown = marker_colors(np.array([0.5, 3.0, np.nan]), 1.0)
    assert sure[1] > sure[0]
    assert wide[0] > wide[1]
    assert (unknown == wide).all()


def test_every_quality_has_a_color():
    assert set(BODY_COLORS) == set(Quality)
