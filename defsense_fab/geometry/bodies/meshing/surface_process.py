"""Simplify or remesh surfaces, in a child process if that takes long.

Native code that runs for minutes could neither be stopped nor report progress. Small surfaces take
less time than starting a process. The child is `python -m` this module with a folder that holds
`TASK`.
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
from ..child_process import OUT_OF_MEMORY, ChildFailure, end_with_parent, run_module
from .meshers import RunMonitor, raise_child_error
from .simplification import MIN_FINE_TRIANGLES, SimplifiedSurface, is_fine, simplify_surface
from .surface_remeshing import count_grid_points, remesh_on_grid, remesh_surface

TASK, RESULT = "surface.npz", "result.npz"
#: Kinds of work, as named in messages.
SIMPLIFY = "simplifying the surface"
REMESH = "remeshing the surface"
GRID = "building a grid of distances"
#: Larger grids take long: each point takes a winding number and a distance.
MAX_QUICK_POINTS = 200_000


def simplify_in_time(
    surface: Surface, edge_length: float, monitor: RunMonitor
) -> SimplifiedSurface:
    """Return the result of `simplify_surface`.

    Raises:
        MeshingError: If it takes longer than the monitor allows.
    """
    if not is_fine(surface, edge_length):
        return SimplifiedSurface(surface)
    simplified = _run(SIMPLIFY, surface, edge_length, monitor)
    is_unchanged = len(simplified.surface.faces) == len(surface.faces)
    return SimplifiedSurface(surface) if is_unchanged else simplified


def remesh_in_time(surface: Surface, edge_length: float, monitor: RunMonitor) -> Surface:
    """Return the result of `remesh_surface`.

    Raises:
        MeshingError: As `remesh_surface`, or if it takes longer than the monitor allows.
    """
    if len(surface.faces) <= MIN_FINE_TRIANGLES:
        return remesh_surface(surface, edge_length)
    return _run(REMESH, surface, edge_length, monitor).surface


def remesh_on_grid_in_time(surface: Surface, edge_length: float, monitor: RunMonitor) -> Surface:
    """Return the result of `remesh_on_grid`.

    Raises:
        MeshingError: As `remesh_on_grid`, or if it takes longer than the monitor allows.
    """
    if (
        len(surface.faces) <= MIN_FINE_TRIANGLES
        and count_grid_points(surface, edge_length) <= MAX_QUICK_POINTS
    ):
        return remesh_on_grid(surface, edge_length)
    return _run(GRID, surface, edge_length, monitor).surface


_WORK: dict[str, Callable[[Surface, float], SimplifiedSurface]] = {
    SIMPLIFY: simplify_surface,
    REMESH: lambda s, edge: SimplifiedSurface(remesh_surface(s, edge)),
    GRID: lambda s, edge: SimplifiedSurface(remesh_on_grid(s, edge)),
}


def _run(work: str, surface: Surface, edge_length: float, monitor: RunMonitor) -> SimplifiedSurface:
    failure = ChildFailure(MeshingError, "", work)

    def write_task(folder: Path) -> None:
        task: dict[str, Any] = {"work": work, "edge_length": edge_length}
        np.savez(folder / TASK, vertices=surface.vertices, faces=surface.faces, **task)

    with (
        run_module(
            __name__,
            write_task,
            RESULT,
            monitor.time_left(),
            failure,
            on_wait=monitor.report_waiting,
        ) as folder,
        np.load(folder / RESULT) as result,
    ):
        raise_child_error(result, work)
        new_surface = Surface(result["vertices"], result["faces"])
        return SimplifiedSurface(
            new_surface, float(result["tolerance"]), float(result["deviation"])
        )


def main(folder: str) -> None:
    """Do the work of the task in `folder`, and write the surface or the error there."""
    end_with_parent()
    os.chdir(folder)
    with np.load(TASK) as task:
        surface = Surface(task["vertices"], task["faces"])
        work, edge_length = str(task["work"]), float(task["edge_length"])
    result: dict[str, Any]
    try:
        simplified = _WORK[work](surface, edge_length)
        result = {
            "vertices": simplified.surface.vertices,
            "faces": simplified.surface.faces,
            "tolerance": simplified.tolerance,
            "deviation": simplified.deviation,
        }
    except (MeshingError, RuntimeError, ValueError) as error:
        result = {"error": " ".join(str(error).split()) or type(error).__name__}
    except MemoryError:
        result = {"error": OUT_OF_MEMORY}
    np.savez("unfinished.npz", **result)
    Path("unfinished.npz").replace(RESULT)


if __name__ == "__main__":
    main(sys.argv[1])
