"""Flat tets are removed or unfolded, and rough bodies get few and well shaped tets."""

import numpy as np
import pytest
import trimesh

from defsense_fab.core.mesh import Surface, TetMesh
from defsense_fab.geometry.bodies.meshing import netgen_mesh
from defsense_fab.geometry.bodies.meshing.mesh_improvement import improve_flat_tets
from defsense_fab.geometry.bodies.meshing.mesh_quality import (
    bound_ratio,
    dihedral_angles,
    measure_quality,
)
from defsense_fab.geometry.bodies.meshing.meshers import make_mesh
from defsense_fab.geometry.bodies.meshing.netgen_mesh import NetgenSizes
from defsense_fab.geometry.bodies.meshing.simplification import is_rough
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from tests.support.surfaces import from_trimesh


def least_angle(mesh):
    return np.rad2deg(dihedral_angles(mesh).min())


def boxes(count=4):
    """A cube of 10 mm divided into 5 tets per cell."""
    t = np.linspace(0, 10, count + 1)
    nodes = np.stack(np.meshgrid(t, t, t, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(count + 1, count + 1, count + 1)
    even = [(0, 1, 3, 5), (0, 3, 2, 6), (0, 5, 6, 4), (3, 5, 7, 6), (0, 3, 5, 6)]
    odd = [(1, 0, 2, 4), (1, 3, 2, 7), (1, 5, 7, 4), (2, 7, 6, 4), (1, 2, 4, 7)]
    tets = []
    for cell in np.ndindex(count, count, count):
        a, b, c = cell
        corners = number[a : a + 2, b : b + 2, c : c + 2].transpose(2, 1, 0).ravel()
        tets += [corners[list(k)] for k in (odd if sum(cell) % 2 else even)]
    return make_mesh(nodes, np.array(tets))


def test_well_shaped_mesh_stays_as_it_is():
    mesh = boxes()
    assert improve_flat_tets(mesh, mesh.boundary()) is mesh


def test_flat_tets_in_the_body_are_unfolded():
    mesh = boxes()
    surface = mesh.boundary()
    inner = np.setdiff1d(np.arange(len(mesh.nodes)), np.unique(surface.faces))
    moved = mesh.nodes.copy()
    moved[inner] += np.random.default_rng(0).uniform(-0.8, 0.8, (len(inner), 3))
    flat = TetMesh(moved, mesh.tets)
    assert (flat.volumes > 0).all()
    assert least_angle(flat) < 8
    improved = improve_flat_tets(flat, surface)
    assert least_angle(improved) > 12
    assert improved.volumes.sum() == pytest.approx(1000)


def test_flat_tets_on_the_surface_are_removed():
    """A tet over an edge of the surface as flat as its two triangles flips that edge."""
    mesh = boxes(2)
    surface = mesh.boundary()
    faces = surface.faces
    pair = [f for f in faces if (mesh.nodes[f][:, 2] == 10).all()][:2]
    shared = np.intersect1d(*pair)
    apexes = np.setxor1d(*pair)
    nodes = mesh.nodes.copy()
    nodes[apexes, 2] += 0.05  # the tet over the shared edge is 0.1 mm thick
    tets = np.concatenate([mesh.tets, [[*shared, *apexes]]])
    flat = make_mesh(nodes, tets)
    assert least_angle(flat) < 5
    improved = improve_flat_tets(flat, surface)
    assert len(improved.tets) == len(mesh.tets)
    assert least_angle(improved) > 12


def test_tets_on_sharp_edges_do_not_count():
    """A wedge of ten degrees has to have flat tets."""
    wedge = trimesh.convex.convex_hull(
        [[0, 0, 0], [0, 10, 0], [30, 0, -2.6], [30, 10, -2.6], [30, 0, 2.6], [30, 10, 2.6]]
    )
    mesh = tetrahedralize(from_trimesh(wedge), 5.0).mesh
    assert least_angle(mesh) < 12
    assert bound_ratio(mesh) >= 1


def test_rough_skin_does_not_make_the_tets_smaller():
    ball = trimesh.creation.icosphere(5, 30)
    rng = np.random.default_rng(2)
    bumps = 0.35 * np.sin(ball.vertices @ rng.normal(size=(3, 6)) * 1.2).sum(1)
    rough = Surface(ball.vertices * (1 + bumps / 30)[:, None], np.asarray(ball.faces, np.int64))
    assert is_rough(rough)
    assert not is_rough(from_trimesh(ball))
    result = tetrahedralize(rough, 8.0)
    quality = measure_quality(result.mesh, rough)
    assert quality.tets < 4 * 8.5 * rough.volume / 8.0**3
    assert quality.min_dihedral > 12
    assert abs(quality.volume_change) < 0.01
    assert bound_ratio(result.mesh) >= 1


@pytest.mark.slow
def test_mesh_of_far_too_many_tets_is_replaced(monkeypatch):
    ball = from_trimesh(trimesh.creation.icosphere(3, 30))
    usual = tetrahedralize(ball, 10.0)
    assert usual.tried == ()
    for name in ("EVEN_SIZES", "GRADED_SIZES"):
        monkeypatch.setattr(netgen_mesh, name, NetgenSizes(0.3, 0.3, 0.03))
    fewer = tetrahedralize(ball, 10.0)
    assert len(fewer.tried) == 1
    assert len(fewer.mesh.tets) < 4 * 8.5 * ball.volume / 10.0**3
    assert bound_ratio(fewer.mesh) >= 1
