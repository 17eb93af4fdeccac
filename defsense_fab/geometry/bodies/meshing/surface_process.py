"""Surfaces simplified, laid afresh and made of a grid: in a process of its own where that is long.

`python -m` this module, with a folder that holds `IN`. Native code that runs for minutes could
neither be stopped nor told of otherwise; small surfaces are quicker than a process begins.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ....core.errors import MeshingError
from ....core.mesh import Surface
from ..child_process import OUT_OF_MEMORY, Failure, end_with_parent, finished
from .mesher_runs import Watch, raise_told
from .simplification import FEW, Simplified, is_fine, simplified
from .surface_remeshing import grid_points, remeshed, voxel_surface

IN, OUT = "surface.npz", "made.npz"
#: Grids of more points than this are long: each takes a winding number and a distance.
_MANY = 200_000


def simplified_in_time(surface: Surface, edge_length: float, watch: Watch) -> Simplified:
    """What `simplified` gives. Raises MeshingError where it does not end in time."""
    if not is_fine(surface, edge_length):
        return Simplified(surface)
    made = _run("simplifying the surface", surface, edge_length, watch)
    same = len(made.surface.faces) == len(surface.faces)
    return Simplified(surface) if same else made


def remeshed_in_time(surface: Surface, edge_length: float, watch: Watch) -> Surface:
    """What `remeshed` gives. Raises MeshingError as it does, and where it does not end in time."""
    if len(surface.faces) <= FEW:
        return remeshed(surface, edge_length)
    return _run("laying triangles afresh", surface, edge_length, watch).surface


def voxel_surface_in_time(surface: Surface, edge_length: float, watch: Watch) -> Surface:
    """What `voxel_surface` gives. Raises MeshingError as it does, and where it does not end in
    time."""
    if len(surface.faces) <= FEW and grid_points(surface, edge_length) <= _MANY:
        return voxel_surface(surface, edge_length)
    return _run("making a grid of distances", surface, edge_length, watch).surface


_WORK: dict[str, Callable[[Surface, float], Simplified]] = {
    "simplifying the surface": simplified,
    "laying triangles afresh": lambda s, edge: Simplified(remeshed(s, edge)),
    "making a grid of distances": lambda s, edge: Simplified(voxel_surface(s, edge)),
}


def _run(work: str, surface: Surface, edge_length: float, watch: Watch) -> Simplified:
    failure = Failure(MeshingError, work, "", "")

    def give(folder: Path) -> None:
        task: dict[str, Any] = {"work": work, "edge_length": edge_length}
        np.savez(folder / IN, vertices=surface.vertices, faces=surface.faces, **task)

    with (
        finished(__name__, give, OUT, watch.left(), failure, on_wait=watch.passed) as folder,
        np.load(folder / OUT) as made,
    ):
        raise_told(made, work)
        new = Surface(made["vertices"], made["faces"])
        return Simplified(new, float(made["tolerance"]), float(made["deviation"]))


def main(folder: str) -> None:
    """Read a surface, the edge length (mm) and what to do; write the surface, its tolerance and its
    deviation (mm), or the error."""
    end_with_parent()
    os.chdir(folder)
    with np.load(IN) as given:
        surface = Surface(given["vertices"], given["faces"])
        work, edge_length = str(given["work"]), float(given["edge_length"])
    found: dict[str, Any]
    try:
        made = _WORK[work](surface, edge_length)
        found = {
            "vertices": made.surface.vertices,
            "faces": made.surface.faces,
            "tolerance": made.tolerance,
            "deviation": made.deviation,
        }
    except (MeshingError, RuntimeError, ValueError) as error:
        found = {"error": " ".join(str(error).split()) or type(error).__name__}
    except MemoryError:
        found = {"error": OUT_OF_MEMORY}
    np.savez("unfinished.npz", **found)
    Path("unfinished.npz").replace(OUT)


if __name__ == "__main__":
    main(sys.argv[1])
