"""Mesh a surface with Netgen in the sizes that give as many tets as its edge length implies."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh
from .child_work import RunMonitor
from .mesh_quality import fit_boundary, measure_facet_gaps
from .meshers import NETGEN, run_mesher

#: Netgen's smallest edge where the surface is curved, for a mean edge of 1.
MIN_EDGE = 0.3


@dataclass(frozen=True)
class NetgenSizes:
    """Sizes that Netgen gets for a mean edge of 1.

    Attributes:
        max_edge: Largest edge.
        grading: Growth from short to long edges, from 0 (even) to 1.
        max_gap: Distance of facets from the surface above which edges get shorter there.
    """

    max_edge: float
    grading: float
    max_gap: float


#: Even tets; and sizes for bodies of which these are more than `MAX_EVEN_RATIO` times those that
#: the edge length asks for: many short edges on small rounds, or sides of a little more than a
#: whole number of edges.
EVEN_SIZES, GRADED_SIZES = NetgenSizes(0.8, 0.3, 0.03), NetgenSizes(0.9, 0.5, 0.06)
MAX_EVEN_RATIO = 1.25


def count_tets(surface: Surface, edge_length: float) -> float:
    """Return about how many tets of an edge length (mm) fill a surface."""
    return 8.5 * abs(surface.volume) / edge_length**3


def mesh_with_netgen(
    given: Surface, surface: Surface, edge_length: float, monitor: RunMonitor
) -> TetMesh:
    """Mesh a surface with Netgen, which places its own triangles on it.

    Args:
        given: The surface that Netgen gets.
        surface: The body's surface, which the mesh is fitted to.
        edge_length: Mean edge of the tets, mm.
        monitor: Limits and progress of the child process.

    Raises:
        MeshingError: If Netgen makes no mesh.
    """
    sizes = EVEN_SIZES
    mesh = _run_sized(given, edge_length, sizes, monitor)
    if len(mesh.tets) > MAX_EVEN_RATIO * count_tets(surface, edge_length):
        with suppress(MeshingError):
            graded = _run_sized(given, edge_length, GRADED_SIZES, monitor)
            if len(graded.tets) < len(mesh.tets):
                mesh, sizes = graded, GRADED_SIZES
    middles, gaps = measure_facet_gaps(mesh, given)
    max_gap = sizes.max_gap * edge_length
    is_wide = gaps > max_gap
    if is_wide.any():  # where facets cut corners, edges as short as that takes
        shrink = np.maximum(np.sqrt(max_gap / gaps[is_wide]), MIN_EDGE)
        shorter = shrink * sizes.max_edge * edge_length
        mesh = _run_sized(given, edge_length, sizes, monitor, (middles[is_wide], shorter))
    return fit_boundary(mesh, surface)


def _run_sized(
    given: Surface,
    edge_length: float,
    sizes: NetgenSizes,
    monitor: RunMonitor,
    shorter: tuple[Float, Float] = (np.zeros((0, 3)), np.zeros(0)),
) -> TetMesh:
    """Run Netgen with its own triangles, and with `shorter` edges (k,) mm at points (k, 3)."""
    points, edges = shorter
    task = {"edge_length": sizes.max_edge * edge_length, "grading": sizes.grading}
    return run_mesher(NETGEN, given, task | {"points": points, "edges": edges}, monitor)
