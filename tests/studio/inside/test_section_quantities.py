"""Numbers and texts of the quantities that a section shows."""

from __future__ import annotations

import re

import numpy as np
import pytest

from defsense_fab.studio.inside.section_quantities import (
    ALONG_DIRECTION,
    NEXT_CORD,
    VARIANCE_OF_LARGEST,
    PointValues,
    point_text,
    range_text,
)


def test_stretches_are_shown_as_percent_strain_and_variances_unchanged():
    shown = ALONG_DIRECTION.to_shown(np.array([1.0, 1.25, 0.9]))
    np.testing.assert_allclose(shown, [0, 25, -10])
    assert ALONG_DIRECTION.unit == "percent strain"
    assert ALONG_DIRECTION.scale(0.055).high == pytest.approx(6.0)
    variance = VARIANCE_OF_LARGEST.to_shown(np.array([0.004]))
    np.testing.assert_array_equal(variance, [0.004])
    assert NEXT_CORD.unit == "mm"
    assert "\u22121.0 to +2.5 %" in range_text(ALONG_DIRECTION, np.array([-1.0, 2.5]))
    assert not re.search(r"\d", range_text(NEXT_CORD, np.array([np.nan])))


def test_point_text_has_both_positions_if_the_point_moves():
    rest = np.array([1.0, 2.0, 3.0])
    values = PointValues(rest, np.array([1.0, 2.0, 4.0]), {"largest": 1.05}, 0.0001)
    text = point_text(values)
    assert "(1.0, 2.0, 3.0) mm" in text
    assert "(1.0, 2.0, 4.0) mm" in text
    assert "+5.0 %" in text
    assert "1.0 %" in text
