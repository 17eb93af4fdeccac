"""Run the meshers Netgen and fTetWild on a surface in a child process.

Netgen's OpenCascade must not meet that of the CAD libraries, and native code of both meshers may
end the process. The child is `python -m` this module with a folder that holds `TASK`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh, facet_crosses
from ..child_process import OUT_OF_MEMORY, ChildFailure, end_with_parent, run_module

#: Names of the meshers, as stored with a mesh.
NETGEN, FTETWILD = "netgen", "ftetwild"
#: Display name and package of each mesher.
_NAMES = {NETGEN: ("Netgen", "netgen-mesher"), FTETWILD: ("fTetWild", "pytetwild")}
TASK, RESULT = "surface.npz", "mesh.npz"
_UNFINISHED = "unfinished.npz"
_NETGEN_STL, _NETGEN_SIZES = "surface.stl", "sizes.txt"
#: A mesher that takes this many times as long as usual gets advice displayed.
SLOW_RATIO = 3.0


class UnusableMesherError(MeshingError):
    """A mesher is not installed properly: falling back to another one would hide that."""


@dataclass(frozen=True)
class RunMonitor:
    """Time limit and progress of all runs of one meshing method.

    Attributes:
        limit: Time limit of all runs together, s.
        report: Called with progress messages.
        description: What is running.
        usual_duration: Duration on an idle machine, s.
        fallback: What is done if it fails.
        started_at: Start on the monotonic clock, s.
    """

    limit: float
    report: Callable[[str], None]
    description: str
    usual_duration: float
    fallback: str
    started_at: float = field(default_factory=time.monotonic)

    def time_left(self) -> float:
        """Return the rest of the limit, s.

        Raises:
            MeshingError: If no time is left.
        """
        left = self.limit - (time.monotonic() - self.started_at)
        if left <= 0:
            raise MeshingError(
                f"did not end within {round(self.limit, 2):g} s, or did not start",
                code="time-limit-exceeded",
                where="the mesher",
                limit=self.limit,
            )
        return left

    def report_waiting(self) -> None:
        """Report that the run continues."""
        seconds = time.monotonic() - self.started_at
        text = f"{self.description}: {seconds:.0f} s, usually {self.usual_duration:.0f} s"
        if seconds > SLOW_RATIO * self.usual_duration:
            text += (
                f"; stopped after {self.limit:.0f} s, then {self.fallback}; a larger [mesh]"
                " edge_length or a surface of fewer triangles is faster"
            )
        self.report(text)


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
    failure = ChildFailure(MeshingError, "", name)

    def write_task(folder: Path) -> None:
        faces = np.asarray(surface.faces, np.int32)
        arrays: dict[str, Any] = {"vertices": surface.vertices, "faces": faces, "mesher": mesher}
        np.savez(folder / TASK, **arrays, **task)

    with (
        run_module(
            _MODULE,
            write_task,
            RESULT,
            monitor.time_left(),
            failure,
            on_wait=monitor.report_waiting,
        ) as folder,
        np.load(folder / RESULT) as result,
    ):
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
        raise_child_error(result, name)
        return make_mesh(np.asarray(result["nodes"], float), np.asarray(result["tets"], np.int64))


_MODULE = f"{__package__}.meshers"


def raise_child_error(result: Mapping[str, Any], subject: str) -> None:
    """Raise the error in a child's result, if there is one.

    Args:
        result: What the child left.
        subject: What failed.

    Raises:
        MemoryError: If the child ran out of memory.
        MeshingError: For other errors.
    """
    if "error" in result:
        text = str(result["error"])
        if text == OUT_OF_MEMORY:
            raise MemoryError
        raise MeshingError(f"{subject} failed: {text}", code="mesher-failed")


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


def main(folder: str) -> None:
    """Run the mesher of the task in `folder`, and write nodes and tets, or the error, there."""
    end_with_parent()
    os.chdir(folder)  # fTetWild leaves a file there
    with np.load(TASK) as task:
        data = dict(task)
    run = _run_netgen if str(data["mesher"]) == NETGEN else _run_ftetwild
    try:
        result = run(data)
    except MemoryError:
        result = {"error": OUT_OF_MEMORY}
    np.savez(_UNFINISHED, **result)
    Path(_UNFINISHED).replace(RESULT)


def _run_ftetwild(data: Mapping[str, Any]) -> dict[str, Any]:
    """Mesh vertices and faces with edges of `edge_length` mm and an envelope `epsilon`."""
    try:
        import pytetwild
    except ImportError as error:
        return {"missing": str(error)}
    try:
        nodes, tets = pytetwild.tetrahedralize(
            data["vertices"],
            data["faces"],
            edge_length_abs=float(data["edge_length"]),
            epsilon=float(data["epsilon"]),
            num_threads=1,
        )
    except RuntimeError as error:
        return {"error": str(error)}
    return {"nodes": nodes, "tets": tets}


def _run_netgen(data: Mapping[str, Any]) -> dict[str, Any]:
    """Mesh vertices and faces with edges up to `edge_length` mm, and `edges` (k,) mm at `points`.

    With `fill` the given triangles stay, and only their inside is meshed.
    """
    try:
        from netgen.libngpy._meshing import NgException
        from netgen.stl import STLGeometry
    except ImportError as error:
        return {"missing": str(error)}
    vertices, faces = data["vertices"], data["faces"]
    _write_sizes(data["points"], data["edges"])
    max_edge = float(data["edge_length"])
    try:
        if "fill" in data:
            mesh = _fill_surface(vertices, faces, max_edge)
        else:
            _write_stl(vertices, faces)
            geometry = STLGeometry(_NETGEN_STL)
            mesh = geometry.GenerateMesh(maxh=max_edge, meshsizefilename=_NETGEN_SIZES)
        return {
            "nodes": np.array([p.p for p in mesh.Points()]).reshape(-1, 3),
            "tets": np.array(
                [[v.nr - 1 for v in e.vertices] for e in mesh.Elements3D()], np.int64
            ).reshape(-1, 4),
        }
    except (NgException, RuntimeError) as error:
        return {"error": " ".join(str(error).split()) or type(error).__name__}


def _fill_surface(vertices: Float, faces: Int, largest: float) -> Any:
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
    points = [mesh.Add(MeshPoint(Pnt(*map(float, p)))) for p in vertices]
    for corners in faces:
        mesh.Add(Element2D(face, [points[i] for i in corners]))
    mesh.GenerateVolumeMesh(mp=MeshingParameters(maxh=largest))
    return mesh


def _write_stl(vertices: Float, faces: Int) -> None:
    """Write the surface as text, since the binary format has single precision."""
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
    main(sys.argv[1])
