"""Fine surfaces become simple within what is told; CAD and coarse ones are left alone."""

import numpy as np
import pytest
import trimesh

from defsense_fab.core.errors import MeshingError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing.mesh_quality import measure_quality
from defsense_fab.geometry.bodies.meshing.meshers import NETGEN, RunMonitor
from defsense_fab.geometry.bodies.meshing.simplification import (
    find_triangle_pairs,
    is_creased,
    is_fine,
    simplify_surface,
)
from defsense_fab.geometry.bodies.meshing.surface_process import (
    remesh_in_time,
    simplify_in_time,
)
from defsense_fab.geometry.bodies.meshing.surface_remeshing import (
    _split_edges,
    remesh_on_grid,
    remesh_surface,
)
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from tests.support.errors import raises


def surface(mesh):
    return Surface(np.array(mesh.vertices), np.array(mesh.faces, np.int64))


def closed(made):
    """Whether every edge belongs to two triangles, once in each direction."""
    return trimesh.Trimesh(made.vertices, made.faces, process=False).is_watertight


def away(points, other):
    """Distances (mm) from points to a surface, by VTK."""
    import pyvista

    cloud = pyvista.PolyData(points)
    body = pyvista.PolyData.from_regular_faces(other.vertices, other.faces)
    return np.abs(cloud.compute_implicit_distance(body)["implicit_distance"])


def furthest(a, b):
    """From points spread over one surface to the other."""
    return away(a.scatter(3000, np.random.default_rng(0)), b).max()


@pytest.fixture(scope="module")
def bean():
    """A bent, bumpy body of 20,480 triangles, 100 mm long."""
    made = surface(trimesh.creation.icosphere(5))
    v = made.vertices * [50, 16, 16] * (1 + 0.01 * np.sin(12 * made.vertices).sum(1, keepdims=True))
    v[:, 2] += v[:, 0] ** 2 / 120
    return Surface(v, made.faces)


def test_a_fine_surface_is_simplified_within_what_is_told(bean):
    assert is_fine(bean, 6.0)
    made = simplify_surface(bean, 6.0)
    assert len(made.surface.faces) < 0.6 * len(bean.faces)
    assert closed(made.surface)
    assert 0 < made.deviation <= made.tolerance == pytest.approx(0.3)
    assert furthest(made.surface, bean) <= 1.05 * made.deviation


@pytest.mark.slow
def test_the_mesh_of_a_fine_body_has_laid_triangles_and_is_repeatable(bean):
    made = tetrahedralize(bean, 6.0)
    assert made.way == "Netgen on remeshed triangles"
    assert made.mesher == NETGEN
    assert made.repeatable
    assert made.surface.of == len(bean.faces)
    assert made.surface.deviation <= made.surface.tolerance
    found = measure_quality(made.mesh, bean)
    assert found.min_dihedral > 5
    assert abs(found.volume_change) < 2e-3
    assert furthest(made.mesh.boundary(), bean) < 0.2 * 6.0
    assert tetrahedralize(bean, 6.0).mesh.digest == made.mesh.digest


def test_triangles_laid_afresh_are_even_and_lie_on_the_surface(bean):
    laid = remesh_surface(bean, 6.0)
    assert closed(laid)
    corners = laid.vertices[laid.faces]
    sides = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert np.median(area / (sides**2).mean(1) * 2 / np.sqrt(3)) > 0.8  # 1: equilateral
    assert sides.max() < 2.2 * 6.0
    assert away(laid.vertices, bean).max() < 1e-4


def test_a_coarse_surface_is_split_edges_without_gaps():
    ball = surface(trimesh.creation.icosphere(1, 30))
    v, f = _split_edges(ball.vertices, ball.faces, 5.0)
    made = Surface(v, f)
    assert closed(made)
    assert made.volume == pytest.approx(ball.volume)
    corners = v[f]
    assert np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max() <= 5.0


def test_sharp_edges_and_long_triangles_are_no_fine_surface():
    box = trimesh.creation.box((40, 30, 20))
    assert is_creased(surface(box))
    fine = surface(box.subdivide_to_size(0.6).process(validate=True))
    assert len(fine.faces) > 20_000
    assert is_creased(fine)
    assert not is_fine(fine, 8.0)
    assert simplify_surface(fine, 8.0).surface is fine


def test_noise_is_no_sharp_edge(bean):
    rng = np.random.default_rng(3)
    rough = Surface(bean.vertices + rng.normal(scale=0.05, size=bean.vertices.shape), bean.faces)
    assert not is_creased(rough)
    assert is_fine(rough, 6.0)


def test_a_grid_of_distances_gives_a_closed_surface_of_a_holed_one(bean):
    holed = Surface(bean.vertices, bean.faces[300:])
    made = remesh_on_grid(holed, 6.0)
    assert closed(made)
    assert made.volume == pytest.approx(bean.volume, rel=0.02)


def test_what_is_long_runs_in_a_process_of_its_own_and_is_stopped_in_time(bean):
    told = []
    watch = RunMonitor(60.0, told.append, "laid afresh", 1.0, "nothing")
    laid = remesh_in_time(bean, 6.0, watch)
    here = remesh_surface(bean, 6.0)
    assert (laid.vertices == here.vertices).all()
    assert (laid.faces == here.faces).all()
    with raises(MeshingError, "time-limit-exceeded"):
        simplify_in_time(bean, 6.0, RunMonitor(0.05, told.append, "own", 1.0, "nothing"))


def test_pairs_name_both_triangles():
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    a, b, left, right = find_triangle_pairs(faces)
    assert (a[0], b[0], left[0], right[0]) == (1, 2, 0, 1)
    assert len(a) == 1
