"""Run the meshers Netgen and fTetWild on a surface in a child process.

Netgen's OpenCascade must not meet that of the CAD libraries, and native code of both meshers may
end the process. The child is `python -m` this module.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh
from .child_work import RunMonitor, run_work, serve_work

#: Names of the meshers, as stored with a mesh.
NETGEN, FTETWILD = "netgen", "ftetwild"
#: Display name and package of each mesher.
_NAMES = {NETGEN: ("Netgen", "netgen-mesher"), FTETWILD: ("fTetWild", "pytetwild")}
_NETGEN_STL, _NETGEN_SIZES = "surface.stl", "sizes.txt"


class UnusableMesherError(MeshingError):
    """A mesher is not installed properly: falling back to another one would hide that."""


def run_mesher(
    mesher: str, surface: Surface, task: Mapping[str, Any], monitor: RunMonitor
) -> TetMesh:
    """Fill a surface with tets.

    Args:
        mesher: `NETGEN` or `FTETWILD`.
        surface: Closed surface, mm.
        task: Parameters of the mesher: see `_run_netgen` and `_run_ftetwild`.
        monitor: Time limit and progress.

    Returns:
        The mesh.

    Raises:
        UnusableMesherError: If the mesher cannot be imported.
        MeshingError: If it fails or takes too long.
        MemoryError: If it runs out of memory.
    """
    name, package = _NAMES[mesher]
    faces = np.asarray(surface.faces, np.int32)
    arrays = {"vertices": surface.vertices, "faces": faces, "mesher": mesher}
    result = run_work(f"{__package__}.meshers", name, arrays | dict(task), monitor)
    if "missing" in result:
        raise UnusableMesherError(
            f"cannot be imported ({result['missing']}), so that the mesh would differ from that"
            " of other machines",
            code="mesher-missing",
            where=name,
            action=f"Install {package} and its requirements, or mesh the body on another"
            " system: docs/platforms.md",
            mesher=name,
            reason=str(result["missing"]),
        )
    return make_mesh(np.asarray(result["nodes"], float), np.asarray(result["tets"], np.int64))


def make_mesh(nodes: Float, tets: Any) -> TetMesh:
    """Return a mesh of nodes (n, 3) and tets (m, 4), all oriented, without those of no volume.

    Raises:
        MeshingError: If there are no tets.
    """
    if len(tets) == 0:
        raise MeshingError(
            "no tets were made: the triangles cross each other or leave a gap", code="no-tets"
        )
    x = nodes[tets]
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    tets = np.where((volume < 0)[:, None], tets[:, [0, 2, 1, 3]], tets)
    tets = tets[np.abs(volume) > 1e-9 * np.abs(volume).mean()]
    used, index = np.unique(tets, return_inverse=True)
    return TetMesh(nodes[used], index.reshape(-1, 4).astype(np.int64))


def _run(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return nodes and tets, or why the mesher cannot be imported."""
    run = _run_netgen if str(data["mesher"]) == NETGEN else _run_ftetwild
    try:
        nodes, tets = run(data)
    except ImportError as error:
        return {"missing": str(error)}
    return {"nodes": nodes, "tets": tets}


def _run_ftetwild(data: Mapping[str, Any]) -> tuple[Float, Int]:
    """Mesh vertices and faces with edges of `edge_length` mm and an envelope `epsilon`."""
    import pytetwild

    nodes, tets = pytetwild.tetrahedralize(
        data["vertices"],
        data["faces"],
        edge_length_abs=float(data["edge_length"]),
        epsilon=float(data["epsilon"]),
        num_threads=1,
    )
    return nodes, tets


def _run_netgen(data: Mapping[str, Any]) -> tuple[Float, Int]:
    """Mesh vertices and faces with edges up to `edge_length` mm, and `edges` (k,) mm at `points`.

    Edges grow from short to long ones at the rate `grading`. With `fill` the given triangles stay,
    and only their inside is meshed.
    """
    from netgen.libngpy._meshing import NgException
    from netgen.stl import STLGeometry

    surface = Surface(data["vertices"], data["faces"])
    max_edge = float(data["edge_length"])
    try:
        if "fill" in data:
            mesh = _fill_surface(surface, max_edge)
        else:
            _write_stl(surface)
            _write_sizes(data["points"], data["edges"])
            geometry = STLGeometry(_NETGEN_STL)
            mesh = geometry.GenerateMesh(
                maxh=max_edge, grading=float(data["grading"]), meshsizefilename=_NETGEN_SIZES
            )
        nodes = [p.p for p in mesh.Points()]
        tets = [[v.nr - 1 for v in e.vertices] for e in mesh.Elements3D()]
    except NgException as error:
        raise RuntimeError(str(error) or type(error).__name__) from None
    return np.array(nodes).reshape(-1, 3), np.array(tets, np.int64).reshape(-1, 4)


def _fill_surface(surface: Surface, largest: float) -> Any:
    """Return Netgen's mesh with these triangles as its surface."""
    from netgen.meshing import (
        Element2D,
        FaceDescriptor,
        Mesh,
        MeshingParameters,
        MeshPoint,
        Pnt,
    )

    mesh = Mesh(dim=3)
    face = mesh.Add(FaceDescriptor(bc=1, domin=1, domout=0, surfnr=1))
    points = [mesh.Add(MeshPoint(Pnt(*map(float, p)))) for p in surface.vertices]
    for corners in surface.faces:
        mesh.Add(Element2D(face, [points[i] for i in corners]))
    mesh.GenerateVolumeMesh(mp=MeshingParameters(maxh=largest))
    return mesh


def _write_stl(surface: Surface) -> None:
    """Write the surface as text, since the binary format has single precision."""
    corners = surface.vertices[surface.faces].reshape(-1, 9)
    facet = (
        "facet normal %.9g %.9g %.9g\nouter loop\n"
        + "vertex %.12g %.12g %.12g\n" * 3
        + "endloop\nendfacet\n"
    )
    rows = np.concatenate([surface.normals, corners], axis=1)
    with Path(_NETGEN_STL).open("w", encoding="ascii") as file:
        file.write("solid body\n")
        file.writelines(facet % tuple(row) for row in rows)
        file.write("endsolid body\n")


def _write_sizes(points: Float, edges: Float) -> None:
    """Write the requested edge lengths at points, and no lines."""
    rows = "".join(
        "%.9g %.9g %.9g %.9g\n" % (*p, h)  # noqa: UP031 - as in the STL
        for p, h in zip(points, edges, strict=True)
    )
    Path(_NETGEN_SIZES).write_text(f"{len(points)}\n{rows}0\n", encoding="ascii")


if __name__ == "__main__":
    serve_work(sys.argv[1], _run)
