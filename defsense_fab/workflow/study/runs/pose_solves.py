"""The solve of one pose as bytes there and back: what a worker of a cluster does for a build.

Pickled, as Dask sends everything: the scheduler and its workers are trusted.
"""

from __future__ import annotations

import pickle
import zlib

import numpy as np

from ....core.mesh import TetMesh
from ....mechanics.elements.material import Material
from ....mechanics.elements.tet10 import QuadraticMesh
from ....mechanics.solver.batch import Job, solve_all
from ....mechanics.solver.load_stepping import Equilibrium


def packed(mesh: QuadraticMesh, material: Material, job: Job) -> bytes:
    """All that a worker needs to solve a job: the mesh's corners and tets, from which the same
    quadratic mesh follows, the material, and the job's conditions."""
    tets = mesh.cells[:, :4]
    corners = mesh.nodes[: int(tets.max()) + 1]
    small = tets.astype(np.int32), tets.dtype.str
    return zlib.compress(pickle.dumps((corners, *small, material, job), protocol=5), 1)


def solved(data: bytes) -> bytes:
    """The equilibria of a packed job, packed. Raises DefsenseErrors of the solver."""
    corners, tets, kind, material, job = pickle.loads(zlib.decompress(data))  # noqa: S301
    mesh = QuadraticMesh.from_linear(TetMesh(corners, tets.astype(kind)))
    return zlib.compress(pickle.dumps(solve_all(mesh, material, [job])[0], protocol=5), 1)


def unpacked(data: bytes) -> list[Equilibrium]:
    """What `solved` gave."""
    found: list[Equilibrium] = pickle.loads(zlib.decompress(data))  # noqa: S301
    return found
