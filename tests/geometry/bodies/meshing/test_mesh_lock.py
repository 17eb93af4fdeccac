"""Meshes that cannot be reproduced are stored with the device."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing import mesh_lock
from defsense_fab.geometry.bodies.meshing.tetrahedra import (
    FTETWILD,
    NETGEN,
    MeshedSurface,
    Tetrahedra,
)
from tests.support.errors import raises


def test_written_meshes_are_read_back(bar, bar_mesh, tmp_path):
    assert mesh_lock.read_meshes(tmp_path) == {}
    assert mesh_lock.file_digest(tmp_path) is None
    key, finer = mesh_lock.mesh_key(bar, 10.0), mesh_lock.mesh_key(bar, 5.0)
    assert key != finer
    assert mesh_lock.mesh_key(Surface(bar.vertices + 1e-9, bar.faces), 10.0) == key
    assert mesh_lock.mesh_key(Surface(bar.vertices * 1.001, bar.faces), 10.0) != key
    surface = MeshedSurface(100, 30_000, 0.4, 0.2)
    slow = Tetrahedra(bar_mesh, NETGEN, "Netgen on triangles", surface, ("Netgen: too long",), True)
    mesh_lock.write_meshes(tmp_path, {key: Tetrahedra(bar_mesh, FTETWILD), finer: slow})
    first = mesh_lock.file_digest(tmp_path)
    meshes = mesh_lock.read_meshes(tmp_path)
    assert meshes.keys() == {key, finer}
    assert meshes[key].mesh.digest == meshes[finer].mesh.digest == bar_mesh.digest
    assert replace(meshes[finer], mesh=bar_mesh) == slow  # with all facts on its meshing
    assert meshes[key].mesher == FTETWILD
    mesh_lock.write_meshes(tmp_path, meshes)
    assert mesh_lock.file_digest(tmp_path) == first
    assert [p.name for p in tmp_path.iterdir()] == ["device.mesh"]


@pytest.mark.parametrize("damage", [b"nothing", b""])
def test_damaged_file_is_reported_and_unchanged(bar, bar_mesh, tmp_path, damage):
    path = tmp_path / "device.mesh"
    path.write_bytes(damage)
    with raises(StorageError, "file-damaged", path=path):
        mesh_lock.read_meshes(tmp_path)
    assert path.read_bytes() == damage
    np.savez(tmp_path / "x.npz", nodes=bar_mesh.nodes)
    (tmp_path / "x.npz").replace(path)
    with raises(StorageError, "file-damaged", path=path):
        mesh_lock.read_meshes(tmp_path)


def test_older_files_contain_meshes_of_ftetwild(bar_mesh, tmp_path):
    with (tmp_path / "device.mesh").open("wb") as file:
        np.savez(file, **{"k/nodes": bar_mesh.nodes, "k/tets": bar_mesh.tets})
    assert mesh_lock.read_meshes(tmp_path)["k"].mesher == FTETWILD
