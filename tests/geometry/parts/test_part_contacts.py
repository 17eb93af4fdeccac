"""Where channels pass through the faces of joints."""

import numpy as np
import pytest

from defsense_fab.geometry.parts.parts import make_parts
from tests.geometry.parts.test_parts import RULES, crossing
from tests.support.surfaces import distance

pytestmark = pytest.mark.slow


def test_channels_cross_the_faces_of_the_parts_that_they_pass_between(bar, bar_solid):
    """A channel passes between two parts where the walls of both are at its radius."""
    part_set = make_parts(bar, crossing(), RULES, solid=bar_solid)
    radius, crossed = RULES.channel / 2, 0
    surfaces = [part.surface for part in part_set.parts]
    for channel in part_set.channels:
        points = channel.inside
        walls = np.array([distance(surface, points) for surface in surfaces])
        for contact in part_set.contacts:
            heights = np.abs((points - contact.plane.origin) @ contact.plane.normal)
            found = contact.crossings(points, 2 * radius)
            if heights.max() < 1e-3:
                assert not found
                continue
            is_between = (walls[[contact.lower, contact.upper]] < 1.2 * radius).all(axis=0)
            places = points[is_between & (heights < 0.5)]
            assert bool(found) == bool(len(places)), (channel.name, contact.lower, contact.upper)
            for point, sine in found:
                assert 0 < sine <= 1
                assert np.linalg.norm(places - point, axis=1).min() < 1.0
                crossed += 1
    assert crossed >= 3
