"""Meshes are kept by body and edge length, and a cache that fails does no harm."""

from dataclasses import replace

import numpy as np
import pytest
from defsense_fab.geometry.bodies.meshing import mesh_store

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing.tetrahedra import NETGEN, MeshedSurface, Tetrahedra


@pytest.fixture
def made(bar_mesh):
    laid = MeshedSurface(100, 30_000, 0.4, 0.2)
    return Tetrahedra(bar_mesh, NETGEN, "Netgen on triangles", laid, ("Netgen: failed",))


def test_a_mesh_comes_back_for_the_same_body_only(bar, made, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    assert mesh_store.recall(bar, 10.0, 60.0) is None
    mesh_store.remember(bar, 10.0, made)
    back = mesh_store.recall(bar, 10.0, 60.0)
    assert back.mesh.digest == made.mesh.digest
    assert replace(back, mesh=made.mesh) == made
    same = Surface(bar.vertices + 1e-9, bar.faces)
    assert mesh_store.recall(same, 10.0, 60.0).mesh.digest == made.mesh.digest
    assert mesh_store.recall(bar, 9.0, 60.0) is None
    assert mesh_store.recall(Surface(bar.vertices * 1.001, bar.faces), 10.0, 60.0) is None


def test_a_broken_or_forbidden_cache_is_no_cache(bar, made, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "file" / "cache"))
    (tmp_path / "file").write_text("not a folder")
    mesh_store.remember(bar, 10.0, made)
    assert mesh_store.recall(bar, 10.0, 60.0) is None
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "good"))
    mesh_store.remember(bar, 10.0, made)
    (file,) = (tmp_path / "good").iterdir()
    file.write_bytes(file.read_bytes()[:100])
    assert mesh_store.recall(bar, 10.0, 60.0) is None


def test_the_oldest_go(bar, made, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    monkeypatch.setattr(mesh_store, "KEPT", 2)
    for edge_length in np.arange(1.0, 5.0):
        mesh_store.remember(bar, float(edge_length), made)
    assert len(list(tmp_path.glob("*"))) == 2
    assert mesh_store.recall(bar, 4.0, 60.0) is not None


def test_a_mesh_for_want_of_time_is_not_taken_where_there_is_more(bar, made, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    mesh_store.remember(bar, 10.0, replace(made, stopped=True, time_limit=60.0))
    assert mesh_store.recall(bar, 10.0, 61.0) is None
    assert mesh_store.recall(bar, 10.0, 60.0) is not None
    assert mesh_store.recall(bar, 10.0, 5.0) is not None
    mesh_store.remember(bar, 10.0, replace(made, time_limit=60.0))
    assert mesh_store.recall(bar, 10.0, 61.0) is not None
