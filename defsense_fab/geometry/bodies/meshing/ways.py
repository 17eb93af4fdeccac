"""The ways from a surface to tets, and in which order they are tried.

Netgen on the surface as it is keeps sharp edges, but gives up on bumps finer than the tets, and
takes long where there are many triangles. Triangles laid afresh suit any organic surface, soon, but
cut sharp edges. fTetWild (Hu et al. 2020) meshes what the others cannot, but never twice the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh
from . import ftetwild, netgen
from .boundary_fit import facet_gaps, fit_boundary
from .mesher_runs import Watch, run
from .simplification import FEW, Simplified, deviation, is_creased, is_fine
from .surface_runs import remeshed_in_time, simplified_in_time, voxel_surface_in_time

NETGEN, FTETWILD = "netgen", "ftetwild"
#: Netgen's largest edge for edges of 1 on average; its smallest where the surface is curved.
_LARGEST, _SMALLEST = 0.8, 0.3
#: How far facets may be off the surface before edges get shorter there, in edges.
_GAP = 0.03
#: How far a surface laid afresh, and one of a grid, may be from the body, in edges of the tets.
_REMESHED, _GRID = 0.35, 0.6
#: Sizes of triangles laid afresh, in edges of the tets: where they cut each other, the next.
_FINER = (1.0, 0.75, 0.55)
#: fTetWild's envelope in edges, and its largest part of the body's size; the coarser one.
_ENVELOPE, _MOST, _COARSE = 0.02, 1e-3, 0.06


@dataclass(frozen=True)
class MeshedSurface:
    """The surface that was meshed instead of the body's: its number of `triangles`, `of` how many;
    the `tolerance` that it had to keep and its `deviation` as measured afterwards, mm."""

    triangles: int
    of: int
    tolerance: float
    deviation: float


Outcome = tuple[TetMesh, MeshedSurface | None]


@dataclass(frozen=True)
class Way:
    """`says` what it is; `mesher` runs in it; it may take this `share` of the time limit, and takes
    about `usual` s."""

    says: str
    mesher: str
    share: float
    usual: float
    make: Callable[[Watch], Outcome]


def ways(surface: Surface, edge_length: float) -> list[Way]:
    """All of them, the best first: what repeats itself comes before what does not, unless the body
    has sharp edges that only the latter keeps."""
    triangles = len(surface.faces)
    tets = 8.5 * abs(surface.volume) / edge_length**3
    fine_surface = is_fine(surface, edge_length)
    which = "the simplified surface" if fine_surface else "the surface"
    fewer = _Simpler(surface, edge_length)
    count = min(triangles, FEW) if fine_surface else triangles
    own = Way(
        f"Netgen on {which}", NETGEN, 0.1, 2 + tets / 1000 + count / 4000,
        lambda w: (_on_surface(fewer.surface(w), surface, edge_length, w), fewer.told),
    )  # fmt: skip
    afresh = [_afresh(surface, edge_length, k, tets) for k in _FINER]
    grid = Way(
        "Netgen on the surface of a grid of distances", NETGEN, 0.1, 5 + tets / 1000,
        lambda w: _filled(
            voxel_surface_in_time(surface, edge_length, w), surface, edge_length, 1.0, _GRID, w
        ),
    )  # fmt: skip
    size = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    usual = 10 + count / 150
    fine, coarse = (
        Way(f"fTetWild on {which}{text}", FTETWILD, share, usual,
            _by_ftetwild(fewer, edge_length, epsilon))
        for text, share, epsilon in (
            ("", 0.5, min(_MOST, _ENVELOPE * edge_length / size)),
            (" with a coarse envelope", 1.0, _COARSE * edge_length / size),
        )
    )  # fmt: skip
    if fine_surface:
        return [*afresh, own, grid, fine, coarse]
    if is_creased(surface):
        return [own, fine, *afresh, grid, coarse]
    return [own, *afresh, grid, fine, coarse]


def _on_surface(given: Surface, surface: Surface, edge_length: float, watch: Watch) -> TetMesh:
    """Netgen lays triangles over the surface `given`; they are fitted to the body's `surface`."""
    task = {"edge_length": _LARGEST * edge_length, "points": np.zeros((0, 3)), "edges": []}
    mesh = run(netgen, given, task, watch)
    middles, gaps = facet_gaps(mesh, given)
    wide = gaps > _GAP * edge_length
    if wide.any():  # where facets cut corners, edges as short as that takes
        shrink = np.maximum(np.sqrt(_GAP * edge_length / gaps[wide]), _SMALLEST)
        task |= {"points": middles[wide], "edges": shrink * _LARGEST * edge_length}
        mesh = run(netgen, given, task, watch)
    return fit_boundary(mesh, surface)


def _afresh(surface: Surface, edge_length: float, factor: float, tets: float) -> Way:
    finer = "" if factor == 1.0 else f", edges of {factor:g}"
    return Way(
        f"Netgen on triangles laid afresh{finer}", NETGEN, 0.1, 3 + tets / factor**3 / 1000,
        lambda w: _filled(surface, surface, edge_length, factor, _REMESHED, w),
    )  # fmt: skip


def _filled(
    given: Surface, surface: Surface, edge_length: float, factor: float, most: float, watch: Watch
) -> Outcome:
    """Triangles laid over the surface `given`, filled with tets, and fitted to the body's."""
    laid = remeshed_in_time(given, factor * edge_length, watch)
    off, tolerance = deviation(laid, surface), most * edge_length
    if off > tolerance:
        raise MeshingError(
            f"the triangles are {off:.2g} mm off the surface, of {tolerance:.2g} mm allowed",
            code="surface-too-far",
            distance=off,
        )
    nothing = {"points": np.zeros((0, 3)), "edges": []}
    task = {"edge_length": edge_length, "fill": True} | nothing
    mesh = fit_boundary(run(netgen, laid, task, watch), surface)
    return mesh, MeshedSurface(len(laid.faces), len(surface.faces), tolerance, off)


def _by_ftetwild(fewer: _Simpler, edge_length: float, epsilon: float) -> Callable[[Watch], Outcome]:
    task = {"edge_length": edge_length, "epsilon": epsilon}
    return lambda w: (run(ftetwild, fewer.surface(w), task, w), fewer.told)


class _Simpler:
    """A surface simplified when it is first asked for."""

    def __init__(self, surface: Surface, edge_length: float) -> None:
        self._given, self._edge_length = surface, edge_length
        self._made: Simplified | None = None

    def surface(self, watch: Watch) -> Surface:
        """The body's own where it is simple enough. Raises MeshingError where simplifying it does
        not end in time; it is the body's own from then on."""
        if self._made is None:
            self._made = Simplified(self._given)
            self._made = simplified_in_time(self._given, self._edge_length, watch)
        return self._made.surface

    @property
    def told(self) -> MeshedSurface | None:
        """What is to be said of it, once it was asked for."""
        if self._made is None or self._made.surface is self._given:
            return None
        few, many = len(self._made.surface.faces), len(self._given.faces)
        return MeshedSurface(few, many, self._made.tolerance, self._made.deviation)
