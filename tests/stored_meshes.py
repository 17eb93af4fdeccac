"""Meshes that tests are run on, so that they are the same on every machine.

`STORE_MESHES=1 pytest ...` keeps what those tests mesh in tests/meshes; without it a body that is
not there is meshed anew. A file holds the surface (vertices, faces), the edge length (mm), and the
mesh (nodes, tets).
"""

import numpy as np

from defsense_fab.core.files import digest
from defsense_fab.core.mesh import Surface, TetMesh
from defsense_fab.geometry.bodies.tetrahedra import tetrahedralise
from defsense_fab.pipeline.artifacts import mesh_store
from tests.places import ROOT

FOLDER = ROOT / "tests" / "meshes"


def fill_cache():
    """Put every stored mesh into the cache of this process."""
    for path in sorted(FOLDER.glob("*.npz")):
        with np.load(path) as data:
            surface = Surface(data["vertices"], data["faces"].astype(np.int64))
            mesh = TetMesh(data["nodes"], data["tets"].astype(np.int64))
            mesh_store.remember(surface, float(data["edge_length"]), mesh)


def storing(remember):
    """`remember` that also keeps the mesh in tests/meshes."""

    def both(surface, edge_length, mesh):
        remember(surface, edge_length, mesh)
        key = digest(edge_length, np.round(surface.vertices, 6).tobytes(), surface.faces.tobytes())
        FOLDER.mkdir(exist_ok=True)
        np.savez_compressed(
            FOLDER / f"{key}.npz",
            vertices=surface.vertices,
            faces=surface.faces.astype(np.int32),
            edge_length=edge_length,
            nodes=mesh.nodes,
            tets=mesh.tets.astype(np.int32),
        )

    return both


def mesh_of(surface, edge_length):
    """The stored mesh, or a new one."""
    found = mesh_store.recall(surface, edge_length)
    if found is None:
        found = tetrahedralise(surface, edge_length)
        mesh_store.remember(surface, edge_length, found)
    return found
