"""As-rigid-as-possible surfaces against libigl, with soft and missing markers."""

import igl
import numpy as np
import pytest

from defsense_fab.runtime.surface.elastic_net import ElasticNet
from defsense_fab.runtime.surface.surface_mesh import Attachment
from defsense_fab.runtime.surface.surface_solvers import ArapSolver, TimeBudget
from tests.runtime.surface import meshes


def solver_of(vertices, triangles, markers, fixed=None, still=1e-10, most=20_000):
    is_fixed = np.zeros(len(vertices), bool) if fixed is None else fixed
    net = ElasticNet.of(vertices, triangles, is_fixed)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    attachment = Attachment.of(markers, net.rest, net.triangles)
    return ArapSolver(net, attachment, size, still, most), net


def libigl(vertices, triangles, which, places):
    """Solve with libigl, whose single precision leaves errors of 1e-7 to 2e-5 of the size."""
    data = igl.ARAPData()
    data.energy = igl.ARAP_ENERGY_TYPE_SPOKES
    data.max_iter = 200
    igl.arap_precomputation(vertices, triangles, 3, which.astype(np.int32), data)
    return igl.arap_solve(places, data, vertices.copy())


def polished(vertices, triangles, which, x, rounds=50):
    """Iterate further from x in double precision, by singular values and a dense Laplacian."""
    laplacian = -igl.cotmatrix(vertices, triangles).toarray()
    weights = -laplacian * (1 - np.eye(len(vertices)))
    free = np.setdiff1d(np.arange(len(vertices)), which)
    inverse = np.linalg.inv(laplacian[np.ix_(free, free)])
    edges = vertices[:, None] - vertices
    for _ in range(rounds):
        covariance = (weights[..., None] * (x[:, None] - x)).swapaxes(1, 2) @ edges
        u, _, v = np.linalg.svd(covariance)
        u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
        pulls = 0.5 * weights[..., None] * (edges @ (u @ v).swapaxes(1, 2))
        right = pulls.sum(axis=1) - pulls.sum(axis=0)
        x = x.copy()
        x[free] = inverse @ (right[free] - laplacian[np.ix_(free, which)] @ x[which])
    return x


@pytest.mark.parametrize(
    ("vertices", "triangles"),
    [meshes.bar((8, 2, 2)), meshes.ball(2), meshes.ring(24, 10)],
    ids=["bar", "ball", "ring"],
)
def test_shape_and_energy_are_those_of_libigl(vertices, triangles):
    which = np.unique(
        [np.abs(vertices - p).sum(axis=1).argmin() for p in meshes.spread(vertices, triangles, 24)]
    )
    places = meshes.bent(vertices, 0.4, 0.5, np.ptp(vertices[:, 0]))[which]
    solver, net = solver_of(vertices, triangles, vertices[which])
    x, rotations = solver.solve(places, np.zeros(len(which)), TimeBudget(None))
    theirs = libigl(vertices, triangles, which, places)
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    assert np.abs(theirs - vertices).max() > 0.05 * size  # it has moved
    exact = polished(vertices, triangles, which, theirs)
    assert np.abs(x - theirs[net.order]).max() < 3e-5 * size
    assert np.abs(x - exact[net.order]).max() < 1e-6 * size
    energies = [net.energy(y, net.rotations(y)) for y in (theirs[net.order], exact[net.order])]
    assert net.energy(x, rotations) == pytest.approx(energies[0], rel=1e-5)
    assert net.energy(x, rotations) == pytest.approx(energies[1], rel=1e-9)


def test_hard_markers_are_reached_and_fixed_vertices_stay():
    vertices, triangles = meshes.bar()
    markers, base = meshes.spread(vertices, triangles, 15), vertices[:, 0] < 1.0
    markers = markers[markers[:, 0] > 12.0]
    solver, net = solver_of(vertices, triangles, markers, base)
    places = meshes.bent(markers, 0.5, 0.6)
    x, _ = solver.solve(places, np.zeros(len(markers)), TimeBudget(None))
    found = Attachment.of(markers, net.rest, net.triangles).on_surface(x)
    assert np.abs(found - places).max() < 1e-6
    assert np.array_equal(x[net.fixed], net.rest[net.fixed])


def test_rigid_motion_is_exact_also_for_markers_off_the_surface():
    vertices, triangles = meshes.ball()
    markers = 1.05 * meshes.spread(vertices, triangles, 12)
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    solver, net = solver_of(vertices, triangles, markers)
    x, _ = solver.solve(markers @ turn.T + [5.0, 6.0, 7.0], np.zeros(12), TimeBudget(None))
    assert np.abs(x - (net.rest @ turn.T + [5.0, 6.0, 7.0])).max() < 1e-5


def test_markers_count_by_their_deviation():
    vertices, triangles = meshes.bar((10, 3, 3))
    markers, base = meshes.spread(vertices, triangles, 10), vertices[:, 0] < 1.0
    markers = markers[markers[:, 0] > 20.0]
    solver, _ = solver_of(vertices, triangles, markers, base, 1e-8)
    pulled = markers.copy()
    pulled[0, 2] += 10.0

    def height(sd):
        solver.reset()
        deviations = np.full(len(markers), 0.1)
        deviations[0] = sd
        x, _ = solver.solve(pulled, deviations, TimeBudget(None))
        return float(solver._attachment.on_surface(x)[0, 2] - markers[0, 2])

    assert height(0.0) == pytest.approx(10.0, abs=1e-3)
    assert 0.1 < height(10.0) < 9.0
    assert height(np.inf) == pytest.approx(0.0, abs=1e-4)
