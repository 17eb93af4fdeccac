"""Crossing triangles are distinguished from those that touch."""

import itertools

import numpy as np
import pytest

from defsense_fab.geometry.bodies.repair.crossings import find_crossing_pairs
from tests.support.defective_bodies import creature


def by_vtk(v, f):
    """Pairs of triangles without a common corner that meet (Guigue & Devillers 2003)."""
    from vtk import vtkTriangle

    low, high = v[f].min(1), v[f].max(1)
    found = set()
    for i, j in itertools.combinations(range(len(f)), 2):
        is_apart = (low[i] > high[j]).any() or (low[j] > high[i]).any()
        if not is_apart and not set(f[i]) & set(f[j]):
            corners = [p.tolist() for p in (*v[f[i]], *v[f[j]])]
            if vtkTriangle.TrianglesIntersect(*corners):
                found.add((i, j))
    return found


@pytest.mark.parametrize("shake", [0.5, 5.0])
def test_crossing_pairs_equal_those_of_vtk(shake):
    v, f = creature(2)
    v = v + np.random.default_rng(3).normal(size=v.shape) * shake
    pairs = find_crossing_pairs(v, f)
    found = {tuple(sorted(p)) for p in pairs.tolist() if not set(f[p[0]]) & set(f[p[1]])}
    expected = by_vtk(v, f)
    assert found == expected
    assert bool(expected) == (shake > 1)


def test_triangles_with_a_common_corner_cross_where_an_edge_goes_through():
    v = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [2, 1, 1], [2, 1, -1], [2, 1, 0.5]], float)
    assert find_crossing_pairs(v, np.array([[0, 1, 2], [0, 3, 4]])).tolist() in ([[0, 1]], [[1, 0]])
    assert not len(find_crossing_pairs(v, np.array([[0, 1, 2], [0, 3, 5]])))
    assert not len(find_crossing_pairs(v, np.array([[0, 1, 2], [0, 1, 4]])))  # a common edge
