"""The reported displacement of a repair is not too small."""

import numpy as np
import pytest

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.repair.remesh import measure_displacement
from tests.conftest import box_surface
from tests.support.defective_bodies import creature, sampled_distance
from tests.support.surfaces import join

BOX = box_surface([0, 0, 0], [40, 20, 10])


@pytest.mark.parametrize("by", [0.02, 1.5])
def test_displacement_equals_the_depth_of_a_dent_or_bump(by):
    body = Surface(*creature(3))
    size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
    k = int(body.vertices[:, 1].argmax())
    for sign in (-1, 1):
        moved = body.vertices.copy()
        moved[k] += sign * by * np.array([0, 1.0, 0])
        other = Surface(moved, body.faces)
        a, b = (body.vertices, body.faces), (moved, body.faces)
        distance = max(sampled_distance(b, a), sampled_distance(a, b))
        assert measure_displacement(body, other, size) == pytest.approx(distance, rel=0.05)
        assert 0.8 * by < distance < 1.001 * by
    assert measure_displacement(body, body, size) == 0


def test_buried_triangles_do_not_count_but_inside_out_ones_do():
    inner = box_surface([10, 5, 2], [20, 10, 6])
    assert measure_displacement(join(BOX, inner), BOX, 50.0) == 0
    lobe = box_surface([50, 5, 2], [60, 10, 6])
    before = join(BOX, Surface(lobe.vertices, lobe.faces[:, ::-1]))
    assert measure_displacement(before, BOX, 50.0) == pytest.approx(20, rel=0.01)
