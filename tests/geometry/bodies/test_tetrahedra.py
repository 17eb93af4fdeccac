"""Meshes of bodies: the same every time, true to the surface, and kept where they cannot be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.core.errors import MeshingError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies import tetrahedra
from defsense_fab.geometry.bodies.boundary_fit import facet_gaps, fit_boundary
from defsense_fab.geometry.bodies.mesh_repair import read_mesh
from defsense_fab.geometry.bodies.tetrahedra import FTETWILD, NETGEN, quality, tetrahedralise
from tests.places import DEVICES


def ball(radius, rounds=4):
    """A sphere of 20 * 4^rounds facets, whose corners lie on it."""
    import trimesh

    made = trimesh.creation.icosphere(rounds, radius)
    return Surface(np.array(made.vertices), np.array(made.faces, np.int64))


@pytest.fixture(scope="module")
def blob():
    return read_mesh(DEVICES / "blob" / "blob.stl", 1.0, (1.0, 1e4))[0]


def test_a_body_gives_the_same_mesh_every_time(blob, tmp_path, monkeypatch):
    first = tetrahedralise(blob, 9.0)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    second = tetrahedralise(blob, 9.0)
    assert first.repeatable
    assert second.mesh.digest == first.mesh.digest


def test_a_curved_body_keeps_its_volume_and_shape(blob):
    made = tetrahedralise(blob, 7.0)
    found = quality(made.mesh, blob)
    assert abs(found.volume_change) < 0.004
    assert found.boundary_deviation < 0.1 * 7.0
    assert found.min_dihedral > 10


@pytest.mark.parametrize("edge_length", [4.0, 7.0])
def test_edges_are_as_long_as_they_should_be(bar, edge_length):
    mesh = tetrahedralise(bar, edge_length).mesh
    ends = mesh.tets[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    pairs = np.unique(np.sort(ends, axis=1), axis=0)
    edges = np.linalg.norm(np.diff(mesh.nodes[pairs], axis=1)[:, 0], axis=1)
    assert edges.mean() == pytest.approx(edge_length, rel=0.15)
    assert mesh.volumes.sum() == pytest.approx(bar.volume, rel=1e-9)


def test_the_boundary_of_a_coarse_ball_is_fitted():
    """Netgen's nodes lie on the sphere: the volume is short by what theory says of chords, until
    the facets are fitted."""
    surface = ball(20.0)
    task = {"edge_length": 8.0, "points": np.zeros((0, 3)), "edges": []}
    nodes, tets = tetrahedra._run(tetrahedra.netgen, "Netgen", surface, task, 60.0)
    raw = tetrahedra._tidy(nodes, tets)
    fitted = fit_boundary(raw, surface)
    assert raw.volumes.sum() / surface.volume < 0.97
    assert fitted.volumes.sum() == pytest.approx(surface.volume, rel=5e-3)
    _, before = facet_gaps(raw, surface)
    _, after = facet_gaps(fitted, surface)
    assert np.sqrt((after**2).mean()) < 0.7 * np.sqrt((before**2).mean())
    inside = np.setdiff1d(np.arange(len(raw.nodes)), raw.boundary().faces)
    np.testing.assert_array_equal(fitted.nodes[inside], raw.nodes[inside])


def test_flat_faces_stay_flat(bar, bar_mesh):
    np.testing.assert_allclose(fit_boundary(bar_mesh, bar).nodes, bar_mesh.nodes, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_no_tet_turns_over_while_the_boundary_is_fitted(seed):
    """Also where the surface is far off and crumpled."""
    rng = np.random.default_rng(seed)
    surface = ball(10.0, 2)
    far = Surface(
        surface.vertices * rng.uniform(0.5, 1.6, (len(surface.vertices), 1)), surface.faces
    )
    middle = np.append(surface.vertices, np.zeros((1, 3)), axis=0)
    tets = np.column_stack([surface.faces, np.full(len(surface.faces), len(middle) - 1)])
    mesh = fit_boundary(tetrahedra._tidy(middle, tets), far)
    assert mesh.volumes.min() > 0


@pytest.mark.slow
def test_what_netgen_cannot_mesh_goes_to_ftetwild(bar, monkeypatch):
    def fails(*_):
        raise MeshingError("Netgen failed: nothing was made")

    monkeypatch.setattr(tetrahedra, "_by_netgen", fails)
    said = []
    made = tetrahedralise(bar, 14.0, said.append)
    assert made.mesher == FTETWILD
    assert not made.repeatable
    assert "Netgen failed" in said[-1]
    assert made.why == "Netgen failed: nothing was made"
    assert made.mesh.volumes.sum() == pytest.approx(bar.volume, rel=5e-3)


def test_a_netgen_that_cannot_be_imported_is_told(bar, monkeypatch, tmp_path):
    """Not replaced: the mesh would be another one than elsewhere."""
    (tmp_path / "netgen").mkdir()
    (tmp_path / "netgen" / "__init__.py").write_text("raise ImportError('libGLU.so.1 is missing')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MeshingError, match=r"cannot be imported \(libGLU.so.1 is missing\)"):
        tetrahedralise(bar, 14.0)


def test_a_mesh_that_is_not_sound_is_refused(bar, monkeypatch):
    monkeypatch.setattr(tetrahedra, "_SHARPEST", 60.0)
    with pytest.raises(MeshingError, match=r"has an angle of .* degrees"):
        tetrahedra._by_netgen(bar, 12.0, 60.0)
    monkeypatch.undo()
    assert tetrahedralise(bar, 12.0).mesher == NETGEN
