"""Meshes that cannot be made again stay beside the device."""

from dataclasses import replace

import numpy as np
import pytest
from defsense_fab.geometry.bodies.meshing import mesh_lock

from defsense_fab.core.errors import StorageError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing.tetrahedra import (
    FTETWILD,
    NETGEN,
    MeshedSurface,
    Tetrahedra,
)


def test_what_is_written_is_read(bar, bar_mesh, tmp_path):
    assert mesh_lock.read(tmp_path) == {}
    assert mesh_lock.content(tmp_path) is None
    key, finer = mesh_lock.key(bar, 10.0), mesh_lock.key(bar, 5.0)
    assert key != finer
    assert mesh_lock.key(Surface(bar.vertices + 1e-9, bar.faces), 10.0) == key
    assert mesh_lock.key(Surface(bar.vertices * 1.001, bar.faces), 10.0) != key
    laid = MeshedSurface(100, 30_000, 0.4, 0.2)
    late = Tetrahedra(bar_mesh, NETGEN, "Netgen on triangles", laid, ("Netgen: too long",), True)
    mesh_lock.write(tmp_path, {key: Tetrahedra(bar_mesh, FTETWILD), finer: late})
    first = mesh_lock.content(tmp_path)
    found = mesh_lock.read(tmp_path)
    assert found.keys() == {key, finer}
    assert found[key].mesh.digest == found[finer].mesh.digest == bar_mesh.digest
    assert replace(found[finer], mesh=bar_mesh) == late  # what made it, as it was told then
    assert found[key].mesher == FTETWILD
    mesh_lock.write(tmp_path, found)
    assert mesh_lock.content(tmp_path) == first
    assert [p.name for p in tmp_path.iterdir()] == ["device.mesh"]


@pytest.mark.parametrize("damage", [b"nothing", b""])
def test_a_damaged_file_is_told_and_stays(bar, bar_mesh, tmp_path, damage):
    path = tmp_path / "device.mesh"
    path.write_bytes(damage)
    with pytest.raises(StorageError, match=r"device\.mesh: cannot be read .* restore it"):
        mesh_lock.read(tmp_path)
    assert path.read_bytes() == damage
    np.savez(tmp_path / "x.npz", nodes=bar_mesh.nodes)
    (tmp_path / "x.npz").replace(path)
    with pytest.raises(StorageError, match="cannot be read"):
        mesh_lock.read(tmp_path)


def test_files_from_before_hold_meshes_of_ftetwild(bar_mesh, tmp_path):
    with (tmp_path / "device.mesh").open("wb") as file:
        np.savez(file, **{"k/nodes": bar_mesh.nodes, "k/tets": bar_mesh.tets})
    assert mesh_lock.read(tmp_path)["k"].mesher == FTETWILD
