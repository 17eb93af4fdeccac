"""Fine surfaces are simplified within the tolerance; CAD and coarse ones are unchanged."""

import numpy as np
import pytest
import trimesh

from defsense_fab.core.errors import MeshingError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing.child_work import RunMonitor
from defsense_fab.geometry.bodies.meshing.mesh_quality import measure_quality
from defsense_fab.geometry.bodies.meshing.meshers import NETGEN
from defsense_fab.geometry.bodies.meshing.simplification import (
    is_creased,
    is_fine,
    simplify_surface,
)
from defsense_fab.geometry.bodies.meshing.surface_remeshing import (
    remesh_in_time,
    remesh_on_grid,
    remesh_surface,
    simplify_in_time,
)
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from tests.support.errors import raises
from tests.support.surfaces import from_trimesh


def closed(simplified):
    """Whether every edge belongs to two triangles, once in each direction."""
    return trimesh.Trimesh(simplified.vertices, simplified.faces, process=False).is_watertight


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
    simplified = from_trimesh(trimesh.creation.icosphere(5))
    v = (
        simplified.vertices
        * [50, 16, 16]
        * (1 + 0.01 * np.sin(12 * simplified.vertices).sum(1, keepdims=True))
    )
    v[:, 2] += v[:, 0] ** 2 / 120
    return Surface(v, simplified.faces)


def test_fine_surface_is_simplified_within_the_tolerance(bean):
    assert is_fine(bean, 6.0)
    simplified = simplify_surface(bean, 6.0)
    assert len(simplified.surface.faces) < 0.6 * len(bean.faces)
    assert closed(simplified.surface)
    assert 0 < simplified.deviation <= simplified.tolerance == pytest.approx(0.3)
    assert furthest(simplified.surface, bean) <= 1.05 * simplified.deviation


@pytest.mark.slow
def test_mesh_of_a_fine_body_is_remeshed_and_repeatable(bean):
    simplified = tetrahedralize(bean, 6.0)
    assert simplified.way == "Netgen on remeshed triangles"
    assert simplified.mesher == NETGEN
    assert simplified.repeatable
    assert simplified.surface.of == len(bean.faces)
    assert simplified.surface.deviation <= simplified.surface.tolerance
    measured = measure_quality(simplified.mesh, bean)
    assert measured.min_dihedral > 5
    assert abs(measured.volume_change) < 2e-3
    assert furthest(simplified.mesh.boundary(), bean) < 0.2 * 6.0
    assert tetrahedralize(bean, 6.0).mesh.digest == simplified.mesh.digest


def test_remeshed_triangles_are_even_and_lie_on_the_surface(bean):
    remeshed = remesh_surface(bean, 6.0)
    assert closed(remeshed)
    corners = remeshed.vertices[remeshed.faces]
    sides = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert np.median(area / (sides**2).mean(1) * 2 / np.sqrt(3)) > 0.8  # 1: equilateral
    assert sides.max() < 2.2 * 6.0
    assert away(remeshed.vertices, bean).max() < 1e-4


def test_coarse_surface_is_split_without_gaps():
    ball = from_trimesh(trimesh.creation.icosphere(1, 30))
    remeshed = remesh_surface(ball, 8.0)
    assert closed(remeshed)
    assert len(remeshed.faces) > 5 * len(ball.faces)
    assert remeshed.volume == pytest.approx(ball.volume, rel=0.02)
    assert away(remeshed.vertices, ball).max() < 1e-4


def test_surfaces_with_sharp_edges_are_not_fine():
    box = trimesh.creation.box((40, 30, 20))
    assert is_creased(from_trimesh(box))
    fine = from_trimesh(box.subdivide_to_size(0.6).process(validate=True))
    assert len(fine.faces) > 20_000
    assert is_creased(fine)
    assert not is_fine(fine, 8.0)
    assert simplify_surface(fine, 8.0).surface is fine


def test_noise_is_not_a_sharp_edge(bean):
    rng = np.random.default_rng(3)
    rough = Surface(bean.vertices + rng.normal(scale=0.05, size=bean.vertices.shape), bean.faces)
    assert not is_creased(rough)
    assert is_fine(rough, 6.0)


def test_grid_of_distances_closes_a_surface_with_holes(bean):
    holed = Surface(bean.vertices, bean.faces[300:])
    simplified = remesh_on_grid(holed, 6.0)
    assert closed(simplified)
    assert simplified.volume == pytest.approx(bean.volume, rel=0.02)


def test_long_work_runs_in_a_child_process_and_is_stopped_in_time(bean):
    messages = []
    watch = RunMonitor(60.0, messages.append, "remeshing", 1.0, "nothing")
    remeshed = remesh_in_time(bean, 6.0, watch)
    here = remesh_surface(bean, 6.0)
    assert (remeshed.vertices == here.vertices).all()
    assert (remeshed.faces == here.faces).all()
    with raises(MeshingError, "time-limit-exceeded"):
        simplify_in_time(
            bean, 6.0, RunMonitor(0.05, messages.append, "simplifying", 1.0, "nothing")
        )
