"""The reported displacement of a repair is not too small."""

import numpy as np
import pytest

from defsense_fab.geometry.bodies.repair.remesh import measure_displacement
from tests.conftest import box_surface
from tests.support.defective_bodies import creature, sampled_distance

BOX = box_surface([0, 0, 0], [40, 20, 10])


@pytest.mark.parametrize("by", [0.02, 1.5])
def test_displacement_equals_the_depth_of_a_dent_or_bump(by):
    v, f = creature(3)
    size = float(np.linalg.norm(np.ptp(v, axis=0)))
    k = int(v[:, 1].argmax())
    for sign in (-1, 1):
        other = v.copy()
        other[k] += sign * by * np.array([0, 1.0, 0])
        distance = max(sampled_distance((other, f), (v, f)), sampled_distance((v, f), (other, f)))
        assert measure_displacement((v, f), (other, f), size) == pytest.approx(distance, rel=0.05)
        assert 0.8 * by < distance < 1.001 * by
    assert measure_displacement((v, f), (v, f), size) == 0


def test_buried_triangles_do_not_count_but_inside_out_ones_do():
    size = 50.0
    inner = box_surface([10, 5, 2], [20, 10, 6])
    before = (
        np.concatenate([BOX.vertices, inner.vertices]),
        np.concatenate([BOX.faces, inner.faces + 8]),
    )
    assert measure_displacement(before, (BOX.vertices, BOX.faces), size) == 0
    lobe = box_surface([50, 5, 2], [60, 10, 6])
    before = (
        np.concatenate([BOX.vertices, lobe.vertices]),
        np.concatenate([BOX.faces, lobe.faces[:, ::-1] + 8]),
    )
    assert measure_displacement(before, (BOX.vertices, BOX.faces), size) == pytest.approx(
        20, rel=0.01
    )
