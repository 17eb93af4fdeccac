"""The factor of a Laplacian against dense algebra, and its fill-in."""

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import splu

from defsense_fab.runtime.surface.sparse_factor import SparseFactor
from defsense_fab.runtime.surface.surface_mesh import laplacian
from tests.runtime.surface import meshes


def laplacian_of_ball(subdivisions):
    vertices, triangles = meshes.ball(subdivisions)
    return csr_array(laplacian(vertices, triangles) + 0.01 * eye_array(len(vertices)))


def test_solution_is_that_of_a_dense_matrix():
    matrix = laplacian_of_ball(3)
    factor = SparseFactor.of(matrix)
    assert np.array_equal(np.sort(factor.order), np.arange(matrix.shape[0]))
    right = np.random.default_rng(1).standard_normal((3, matrix.shape[0]))
    solution = right[:, factor.order].copy()
    factor.solve(solution)
    expected = np.linalg.solve(matrix.toarray(), right.T).T
    assert np.abs(solution - expected[:, factor.order]).max() < 1e-10 * np.abs(expected).max()


def test_order_reduces_fill_in():
    matrix = laplacian_of_ball(4)
    shuffled = np.random.default_rng(0).permutation(matrix.shape[0])
    unordered = splu(matrix[shuffled][:, shuffled].tocsc(), permc_spec="NATURAL")
    assert len(SparseFactor.of(matrix).values) < unordered.L.nnz / 3
