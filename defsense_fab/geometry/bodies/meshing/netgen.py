"""Netgen in a process of its own: `python -m` this module, with a folder that holds `IN`.

Its OpenCascade must not meet the one of the CAD libraries, and its native code may end the process.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.mesh import facet_crosses
from ..child_process import OUT_OF_MEMORY, end_with_parent

IN, OUT = "surface.npz", "mesh.npz"
_STL, _SIZES = "surface.stl", "sizes.txt"


def main(folder: str) -> None:
    """Read vertices, faces, largest edge (mm), and edges (k,) mm wanted at points (k, 3); write
    nodes and tets, or the error, or what is missing of Netgen itself. With `fill` the triangles
    given stay, and only their inside is meshed."""
    end_with_parent()
    os.chdir(folder)
    found: dict[str, Any]
    try:
        from netgen.libngpy._meshing import NgException
        from netgen.stl import STLGeometry
    except ImportError as error:
        np.savez("unfinished.npz", missing=str(error))
        Path("unfinished.npz").replace(OUT)
        return
    with np.load(IN) as given:
        vertices, faces = given["vertices"], given["faces"]
        _write_sizes(given["points"], given["edges"])
        largest, fill = float(given["edge_length"]), "fill" in given
    try:
        if fill:
            mesh = _filled(vertices, faces, largest)
        else:
            _write_stl(vertices, faces)
            mesh = STLGeometry(_STL).GenerateMesh(maxh=largest, meshsizefilename=_SIZES)
        found = {
            "nodes": np.array([p.p for p in mesh.Points()]).reshape(-1, 3),
            "tets": np.array(
                [[v.nr - 1 for v in e.vertices] for e in mesh.Elements3D()], np.int64
            ).reshape(-1, 4),
        }
    except (NgException, RuntimeError) as error:
        found = {"error": " ".join(str(error).split()) or type(error).__name__}
    except MemoryError:
        found = {"error": OUT_OF_MEMORY}
    np.savez("unfinished.npz", **found)
    Path("unfinished.npz").replace(OUT)


def _filled(vertices: Float, faces: Int, largest: float) -> Any:
    """Netgen's mesh with these triangles as its surface."""
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
    points = [mesh.Add(MeshPoint(Pnt(*map(float, p)))) for p in vertices]
    for corners in faces:
        mesh.Add(Element2D(face, [points[i] for i in corners]))
    mesh.GenerateVolumeMesh(mp=MeshingParameters(maxh=largest))
    return mesh


def _write_stl(vertices: Float, faces: Int) -> None:
    """As text: the binary format has single precision."""
    corners = vertices[faces]
    normals = facet_crosses(vertices, faces)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(lengths > 0, lengths, 1.0)
    facet = (
        "facet normal %.9g %.9g %.9g\nouter loop\n"
        + "vertex %.12g %.12g %.12g\n" * 3
        + "endloop\nendfacet\n"
    )
    rows = np.concatenate([normals, corners.reshape(-1, 9)], axis=1)
    with Path(_STL).open("w", encoding="ascii") as file:
        file.write("solid body\n")
        file.writelines(facet % tuple(row) for row in rows)
        file.write("endsolid body\n")


def _write_sizes(points: Float, edges: Float) -> None:
    """The points with the edges wanted there, and no lines."""
    rows = "".join(
        "%.9g %.9g %.9g %.9g\n" % (*p, h)  # noqa: UP031 - as in the STL
        for p, h in zip(points, edges, strict=True)
    )
    Path(_SIZES).write_text(f"{len(points)}\n{rows}0\n", encoding="ascii")


if __name__ == "__main__":
    main(sys.argv[1])
