"""Meshes are cached by body and edge length; a failing cache does no harm."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing import mesh_store
from defsense_fab.geometry.bodies.meshing.meshers import NETGEN
from defsense_fab.geometry.bodies.meshing.tetrahedra import MeshedSurface, Tetrahedra


@pytest.fixture
def tetrahedra(bar_mesh):
    surface = MeshedSurface(100, 30_000, 0.4, 0.2)
    return Tetrahedra(bar_mesh, NETGEN, "Netgen on triangles", surface, ("Netgen: failed",))


def test_mesh_is_cached_for_the_same_body_only(bar, tetrahedra, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    assert mesh_store.load_cached_mesh(bar, 10.0, 60.0) is None
    mesh_store.cache_mesh(bar, 10.0, tetrahedra)
    cached = mesh_store.load_cached_mesh(bar, 10.0, 60.0)
    assert cached.mesh.digest == tetrahedra.mesh.digest
    assert replace(cached, mesh=tetrahedra.mesh) == tetrahedra
    same = Surface(bar.vertices + 1e-9, bar.faces)
    assert mesh_store.load_cached_mesh(same, 10.0, 60.0).mesh.digest == tetrahedra.mesh.digest
    assert mesh_store.load_cached_mesh(bar, 9.0, 60.0) is None
    assert mesh_store.load_cached_mesh(Surface(bar.vertices * 1.001, bar.faces), 10.0, 60.0) is None


def test_damaged_or_unwritable_cache_is_ignored(bar, tetrahedra, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "file" / "cache"))
    (tmp_path / "file").write_text("not a folder")
    mesh_store.cache_mesh(bar, 10.0, tetrahedra)
    assert mesh_store.load_cached_mesh(bar, 10.0, 60.0) is None
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "good"))
    mesh_store.cache_mesh(bar, 10.0, tetrahedra)
    (file,) = (tmp_path / "good").iterdir()
    file.write_bytes(file.read_bytes()[:100])
    assert mesh_store.load_cached_mesh(bar, 10.0, 60.0) is None


def test_oldest_meshes_are_deleted(bar, tetrahedra, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    monkeypatch.setattr(mesh_store, "MAX_MESHES", 2)
    for edge_length in np.arange(1.0, 5.0):
        mesh_store.cache_mesh(bar, float(edge_length), tetrahedra)
    assert len(list(tmp_path.glob("*"))) == 2
    assert mesh_store.load_cached_mesh(bar, 4.0, 60.0) is not None


def test_mesh_of_a_shorter_time_limit_is_not_reused(bar, tetrahedra, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    mesh_store.cache_mesh(bar, 10.0, replace(tetrahedra, stopped=True, time_limit=60.0))
    assert mesh_store.load_cached_mesh(bar, 10.0, 61.0) is None
    assert mesh_store.load_cached_mesh(bar, 10.0, 60.0) is not None
    assert mesh_store.load_cached_mesh(bar, 10.0, 5.0) is not None
    mesh_store.cache_mesh(bar, 10.0, replace(tetrahedra, time_limit=60.0))
    assert mesh_store.load_cached_mesh(bar, 10.0, 61.0) is not None
