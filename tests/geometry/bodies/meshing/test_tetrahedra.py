"""Meshes of bodies: repeatable and true to the surface."""

import os
import subprocess
import sys
import time
from dataclasses import replace

import build123d as bd
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.core.device.device import MeshSpec
from defsense_fab.core.errors import MeshingError
from defsense_fab.core.machine.child_process import OUT_OF_MEMORY
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.mesh_files import read_mesh
from defsense_fab.geometry.bodies.meshing import mesh_quality, tetrahedra
from defsense_fab.geometry.bodies.meshing.child_work import RunMonitor, raise_child_error
from defsense_fab.geometry.bodies.meshing.mesh_quality import (
    bound_ratio,
    fit_boundary,
    measure_facet_gaps,
    measure_quality,
)
from defsense_fab.geometry.bodies.meshing.meshers import make_mesh, run_mesher
from defsense_fab.geometry.bodies.meshing.netgen_mesh import count_tets
from defsense_fab.geometry.bodies.meshing.tetrahedra import (
    FTETWILD,
    NETGEN,
    plan_methods,
    tetrahedralize,
)
from defsense_fab.geometry.kernels import occ
from tests.support.errors import raises
from tests.support.places import DEVICES
from tests.support.surfaces import from_trimesh

pytestmark = pytest.mark.slow


def ball(radius, rounds=4):
    """A sphere of 20 * 4^rounds facets, whose corners lie on it."""
    return from_trimesh(trimesh.creation.icosphere(rounds, radius))


@pytest.fixture(scope="module")
def blob():
    return read_mesh(DEVICES / "blob" / "blob.stl", 1.0, (1.0, 1e4))[0]


@pytest.fixture(scope="module")
def first(blob):
    return tetrahedralize(blob, 12.0)


def test_a_body_gives_the_same_mesh_every_time(blob, first, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    second = tetrahedralize(blob, 12.0)
    assert first.repeatable
    assert second.mesh.digest == first.mesh.digest


_DIGEST = """
from tests.geometry.bodies.meshing.test_tetrahedra import DEVICES, read_mesh, tetrahedralize
blob = read_mesh(DEVICES / "blob" / "blob.stl", 1.0, (1.0, 1e4))[0]
print(tetrahedralize(blob, 12.0).mesh.digest)
"""


def test_another_processor_makes_the_same_mesh(first):
    result = subprocess.run(
        [sys.executable, "-c", _DIGEST],
        env={**os.environ, "OPENBLAS_CORETYPE": "Nehalem", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.split() == [first.mesh.digest]


@pytest.mark.parametrize("how", ["killed", "reported"])
def test_mesh_after_a_lack_of_memory_is_not_repeatable(monkeypatch, how):
    """Another machine has more, and would make another mesh."""

    def short(monitor):
        if how == "reported":
            raise_child_error({"error": OUT_OF_MEMORY}, "Netgen")
        error = MeshingError("was killed", code="process-ended-early", where="Netgen")
        error.is_machine_limit = True
        raise error

    first, *others = plan_methods(ball(10.0, 2), 4.0)
    methods = [replace(first, make=short), *others]
    monkeypatch.setattr(tetrahedra, "plan_methods", lambda *_: methods)
    measured = tetrahedralize(ball(10.0, 2), 4.0)
    assert len(measured.tried) == 1
    assert not measured.repeatable


def test_a_curved_body_keeps_its_volume_and_shape(blob):
    result = tetrahedralize(blob, 7.0)
    measured = measure_quality(result.mesh, blob)
    assert abs(measured.volume_change) < 0.004
    assert measured.boundary_deviation < 0.1 * 7.0
    assert measured.min_dihedral > 10


@pytest.mark.parametrize("edge_length", [4.0, 7.0])
def test_edges_have_the_requested_length(bar, edge_length):
    mesh = tetrahedralize(bar, edge_length).mesh
    ends = mesh.tets[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    pairs = np.unique(np.sort(ends, axis=1), axis=0)
    edges = np.linalg.norm(np.diff(mesh.nodes[pairs], axis=1)[:, 0], axis=1)
    assert edges.mean() == pytest.approx(edge_length, rel=0.15)
    assert mesh.volumes.sum() == pytest.approx(bar.volume, rel=1e-9)
    assert mesh.boundary().volume == pytest.approx(bar.volume, rel=1e-9)


@pytest.mark.parametrize("kind", ["small rounds", "sides of 6.25 edges"])
def test_even_tets_that_would_be_far_too_many_are_graded(bar, kind):
    edge_length, surface = 6.0, bar
    if kind == "small rounds":
        cube = bd.fillet(bd.Box(60, 60, 60).edges(), 5).solid()
        edge_length, surface = 10.0, occ.tessellate(cube.wrapped, 0.05)
    result = tetrahedralize(surface, edge_length)
    assert result.tried == ()
    assert 0.6 < len(result.mesh.tets) / count_tets(surface, edge_length) < 1.3
    assert bound_ratio(result.mesh) >= 2
    assert abs(measure_quality(result.mesh, surface).volume_change) < 2e-3


@pytest.mark.parametrize(
    ("edge_length", "code"),
    [(0.05, "edge-too-short"), (500, "edge-too-long"), (150.001, "edge-too-long")],
)
def test_edge_length_that_does_not_fit_is_refused(bar, edge_length, code):
    with raises(MeshingError, code, edge_length=edge_length, key="mesh.edge_length"):
        tetrahedralize(bar, edge_length)


def test_the_boundary_of_a_coarse_ball_is_fitted():
    """Netgen's nodes lie on the sphere: the volume is short by what theory says of chords, until
    the facets are fitted."""
    surface = ball(20.0)
    task = {"edge_length": 8.0, "grading": 0.3, "points": np.zeros((0, 3)), "edges": []}
    raw = run_mesher(NETGEN, surface, task, RunMonitor(60.0, print, "Netgen", 1.0, "nothing"))
    fitted = fit_boundary(raw, surface)
    assert raw.volumes.sum() / surface.volume < 0.97
    assert fitted.volumes.sum() == pytest.approx(surface.volume, rel=5e-3)
    _, before = measure_facet_gaps(raw, surface)
    _, after = measure_facet_gaps(fitted, surface)
    assert np.sqrt((after**2).mean()) < 0.7 * np.sqrt((before**2).mean())
    inside = np.setdiff1d(np.arange(len(raw.nodes)), raw.boundary().faces)
    np.testing.assert_allclose(fitted.nodes[inside], raw.nodes[inside], rtol=0, atol=1e-9)


def test_second_run_of_a_method_has_the_remaining_time(bar):
    task = {"edge_length": 20.0, "grading": 0.3, "points": np.zeros((0, 3)), "edges": []}
    watch = RunMonitor(60.0, print, "Netgen", 1.0, "nothing", time.monotonic() - 61.0)
    with raises(MeshingError, "time-limit-exceeded", limit=60.0):
        run_mesher(NETGEN, bar, task, watch)


def test_flat_faces_stay_flat(bar, bar_mesh):
    np.testing.assert_allclose(fit_boundary(bar_mesh, bar).nodes, bar_mesh.nodes, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_no_tet_turns_over_while_the_boundary_is_fitted(seed):
    """Also where the surface is far off and crumpled."""
    rng = np.random.default_rng(seed)
    surface = ball(10.0, 2)
    crumpled = Surface(
        surface.vertices * rng.uniform(0.5, 1.6, (len(surface.vertices), 1)), surface.faces
    )
    middle = np.append(surface.vertices, np.zeros((1, 3)), axis=0)
    tets = np.column_stack([surface.faces, np.full(len(surface.faces), len(middle) - 1)])
    mesh = fit_boundary(make_mesh(middle, tets), crumpled)
    assert mesh.volumes.min() > 0


def only(monkeypatch, mesher):
    """Leave the methods of one mesher; the others fail."""

    def planned(surface, edge_length):
        def fails(_):
            raise MeshingError("nothing was made", code="no-tets", action="Repair it")

        return [
            w if w.mesher == mesher else replace(w, make=fails)
            for w in plan_methods(surface, edge_length)
        ]

    monkeypatch.setattr(tetrahedra, "plan_methods", planned)


def test_ftetwild_is_used_if_netgen_fails(bar, monkeypatch):
    only(monkeypatch, FTETWILD)
    lines = []
    result = tetrahedralize(bar, 14.0, lines.append)
    assert result.mesher == FTETWILD
    assert not result.repeatable
    assert len(result.tried) == 1
    assert any(result.tried[0] in line for line in lines)
    assert result.mesh.volumes.sum() == pytest.approx(bar.volume, rel=5e-3)


def test_failure_of_all_methods_reports_each(blob, monkeypatch):
    only(monkeypatch, "none")
    with raises(MeshingError, "no-mesh") as caught:
        tetrahedralize(blob, 9.0)
    tried = caught.value.data["tried"]
    assert len(tried) == len(plan_methods(blob, 9.0))
    for method, reason in zip(plan_methods(blob, 9.0), tried, strict=True):
        assert method.name in reason
        assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("error", [RuntimeError("bad\nfacet"), ValueError("x"), MemoryError()])
def test_errors_of_libraries_lead_to_the_next_method(bar, monkeypatch, error):
    planned = plan_methods(bar, 14.0)

    def fail(monitor):
        raise error

    first = replace(planned[0], make=fail)
    monkeypatch.setattr(tetrahedra, "plan_methods", lambda *_: [first, *planned])
    result = tetrahedralize(bar, 14.0)
    assert result.mesher == planned[0].mesher
    assert len(result.tried) == 1
    assert "\n" not in result.tried[0]


def test_mesh_after_a_stopped_method_is_not_repeatable(bar, monkeypatch):
    """How far a mesher comes within a time depends on the machine."""

    def planned(surface, edge_length):
        first = plan_methods(surface, edge_length)[0]
        return [replace(first, share=1e-9), first]

    monkeypatch.setattr(tetrahedra, "plan_methods", planned)
    result = tetrahedralize(bar, 14.0)
    assert result.stopped
    assert not result.repeatable
    assert result.is_outgrown(MeshSpec.time_limit + 1)
    assert not result.is_outgrown(MeshSpec.time_limit)
    assert len(result.tried) == 1


def test_netgen_that_cannot_be_imported_is_reported(bar, monkeypatch, tmp_path):
    """Not replaced: the mesh would be another one than elsewhere."""
    (tmp_path / "netgen").mkdir()
    (tmp_path / "netgen" / "__init__.py").write_text("raise ImportError('libGLU.so.1 is missing')")
    monkeypatch.syspath_prepend(tmp_path)
    with raises(MeshingError, "mesher-missing", mesher="Netgen", reason="libGLU.so.1 is missing"):
        tetrahedralize(bar, 14.0)


def test_ftetwild_that_is_not_installed_is_reported(bar, monkeypatch, tmp_path):
    """As on Macs with Intel."""
    (tmp_path / "pytetwild.py").write_text("raise ImportError('no wheel')")
    monkeypatch.syspath_prepend(tmp_path)
    watch = RunMonitor(60.0, lambda _: None, "fTetWild", 1.0, "nothing")
    task = {"edge_length": 14.0, "epsilon": 1e-3}
    with raises(MeshingError, "mesher-missing", mesher="fTetWild", reason="no wheel"):
        run_mesher(FTETWILD, bar, task, watch)


def test_unsound_mesh_is_refused(bar, monkeypatch):
    result = tetrahedralize(bar, 12.0)
    assert result.mesher == NETGEN
    monkeypatch.setattr(mesh_quality, "MIN_DIHEDRAL_DEG", 60.0)
    with raises(MeshingError, "tet-too-flat"):
        mesh_quality.check_mesh(result.mesh, bar, 12.0)
