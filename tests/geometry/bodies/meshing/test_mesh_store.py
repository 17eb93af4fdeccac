"""Meshes are cached by body and edge length, and stored with the device."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing import mesh_store
from defsense_fab.geometry.bodies.meshing.meshers import FTETWILD, NETGEN
from defsense_fab.geometry.bodies.meshing.tetrahedra import MeshedSurface, Tetrahedra
from tests.support.errors import raises


@pytest.fixture
def tetrahedra(bar_mesh):
    surface = MeshedSurface(100, 30_000, 0.4, 0.2)
    return Tetrahedra(bar_mesh, NETGEN, "Netgen on triangles", surface, ("Netgen: failed",))


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache of meshes."""
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    return tmp_path


def test_mesh_is_cached_for_the_same_body_only(bar, tetrahedra, cache):
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


def test_oldest_meshes_are_deleted(bar, tetrahedra, cache, monkeypatch):
    monkeypatch.setattr(mesh_store, "MAX_MESHES", 2)
    for edge_length in np.arange(1.0, 5.0):
        mesh_store.cache_mesh(bar, float(edge_length), tetrahedra)
    assert len(list(cache.glob("*"))) == 2
    assert mesh_store.load_cached_mesh(bar, 4.0, 60.0) is not None


def test_mesh_of_a_shorter_time_limit_is_not_reused(bar, tetrahedra, cache):
    mesh_store.cache_mesh(bar, 10.0, replace(tetrahedra, stopped=True, time_limit=60.0))
    assert mesh_store.load_cached_mesh(bar, 10.0, 61.0) is None
    assert mesh_store.load_cached_mesh(bar, 10.0, 60.0) is not None
    assert mesh_store.load_cached_mesh(bar, 10.0, 5.0) is not None
    mesh_store.cache_mesh(bar, 10.0, replace(tetrahedra, time_limit=60.0))
    assert mesh_store.load_cached_mesh(bar, 10.0, 61.0) is not None


def test_meshes_of_a_device_are_read_back(bar, bar_mesh, tetrahedra, tmp_path):
    assert mesh_store.read_meshes(tmp_path) == {}
    assert mesh_store.file_digest(tmp_path) is None
    key, finer = mesh_store.mesh_key(bar, 10.0), mesh_store.mesh_key(bar, 5.0)
    assert key != finer
    assert mesh_store.mesh_key(Surface(bar.vertices + 1e-9, bar.faces), 10.0) == key
    assert mesh_store.mesh_key(Surface(bar.vertices * 1.001, bar.faces), 10.0) != key
    slow = replace(tetrahedra, stopped=True)
    mesh_store.write_meshes(tmp_path, {key: Tetrahedra(bar_mesh, FTETWILD), finer: slow})
    first = mesh_store.file_digest(tmp_path)
    meshes = mesh_store.read_meshes(tmp_path)
    assert meshes.keys() == {key, finer}
    assert meshes[key].mesh.digest == meshes[finer].mesh.digest == bar_mesh.digest
    assert replace(meshes[finer], mesh=bar_mesh) == slow
    assert meshes[key].mesher == FTETWILD
    mesh_store.write_meshes(tmp_path, meshes)
    assert mesh_store.file_digest(tmp_path) == first
    assert [p.name for p in tmp_path.iterdir()] == ["device.mesh"]


@pytest.mark.parametrize("damage", [b"nothing", b""])
def test_damaged_device_mesh_is_reported_and_unchanged(bar_mesh, tmp_path, damage):
    path = tmp_path / "device.mesh"
    path.write_bytes(damage)
    with raises(StorageError, "file-damaged", path=path):
        mesh_store.read_meshes(tmp_path)
    assert path.read_bytes() == damage
    np.savez(tmp_path / "x.npz", nodes=bar_mesh.nodes)
    (tmp_path / "x.npz").replace(path)
    with raises(StorageError, "file-damaged", path=path):
        mesh_store.read_meshes(tmp_path)
