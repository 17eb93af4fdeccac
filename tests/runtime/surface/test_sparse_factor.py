"""The factor against dense algebra, and the elimination order."""

import numpy as np
from scipy.sparse import csr_array, eye_array

from defsense_fab.runtime.surface.sparse_factor import SparseFactor, elimination_order
from defsense_fab.runtime.surface.surface_mesh import laplacian
from tests.runtime.surface import meshes


def test_solution_is_that_of_a_dense_matrix():
    vertices, triangles = meshes.ball()
    matrix = csr_array(laplacian(vertices, triangles) + 0.01 * eye_array(len(vertices)))
    order = elimination_order(vertices, matrix.indptr.astype(int), matrix.indices.astype(int))
    assert np.array_equal(np.sort(order), np.arange(len(vertices)))
    factor = SparseFactor.of(matrix, order)
    right = np.random.default_rng(1).standard_normal((3, len(vertices)))
    found = right[:, factor.order].copy()
    factor.solve(found)
    expected = np.linalg.solve(matrix.toarray(), right.T).T
    assert np.abs(found - expected[:, factor.order]).max() < 1e-10 * np.abs(expected).max()


def test_dissection_reduces_fill_in():
    vertices, triangles = meshes.ball(4)
    matrix = csr_array(laplacian(vertices, triangles) + 0.01 * eye_array(len(vertices)))
    order = elimination_order(vertices, matrix.indptr.astype(int), matrix.indices.astype(int))
    shuffled = np.random.default_rng(0).permutation(len(vertices))
    entries = [len(SparseFactor.of(matrix, o).values) for o in (order, shuffled)]
    assert entries[0] < entries[1] / 3
