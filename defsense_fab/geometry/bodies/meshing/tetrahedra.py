"""A body's surface to tetrahedra, by one way after the other until a mesh is sound."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....core.device.device import MeshSpec
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh
from ..child_process import OUT_OF_MEMORY
from . import ftetwild, netgen
from .mesh_quality import checked, facet_gaps, fit_boundary
from .mesher_runs import UnusableMesherError, Watch, run
from .simplification import FEW, Simplified, deviation, is_creased, is_fine
from .surface_process import remeshed_in_time, simplified_in_time, voxel_surface_in_time

# The ways from a surface to tets, and in which order they are tried.
#
# Netgen on the surface as it is keeps sharp edges, but gives up on bumps finer than the tets, and
# takes long where there are many triangles. Triangles laid afresh suit any organic surface, soon, but
# cut sharp edges. fTetWild (Hu et al. 2020) meshes what the others cannot, but never twice the same.

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


@dataclass(frozen=True)
class Tetrahedra:
    """A mesh; the `mesher` and the `way` that made it; the `surface` that was meshed, None where it
    was the body's own; sentences on the ways `tried` before, and whether one was `stopped` for
    want of time or memory, of which another machine might have more; the `time_limit` (s) of all
    ways then, the usual one where it was not told."""

    mesh: TetMesh
    mesher: str
    way: str = ""
    surface: MeshedSurface | None = None
    tried: tuple[str, ...] = ()
    stopped: bool = False
    time_limit: float = MeshSpec.time_limit

    @property
    def repeatable(self) -> bool:
        """Whether the same surface gives the same mesh again."""
        return self.mesher == NETGEN and not self.stopped

    def outgrown(self, time_limit: float) -> bool:
        """Whether a better way was stopped that this longer limit (s) gives more time."""
        return self.stopped and time_limit > self.time_limit


def tetrahedralize(
    surface: Surface,
    edge_length: float,
    on_step: Callable[[str], None] | None = None,
    time_limit: float = MeshSpec.time_limit,
) -> Tetrahedra:
    """Tets of about `edge_length` mm inside `surface`, smaller where its curvature asks for it, by
    the first of the `ways` whose mesh is sound.

    Raises MeshingError where the edge length does not fit the body, Netgen is not installed as it
    should be, or all ways fail or take more than `time_limit` s.
    """
    _check_size(surface, edge_length)
    tell = on_step or (lambda _: None)
    tell(f"{len(surface.faces):,} triangles are looked at")
    until = time.monotonic() + time_limit
    tried: list[str] = []
    stopped = False
    plan = ways(surface, edge_length)
    for k, way in enumerate(plan):
        limit = min(way.share * time_limit, until - time.monotonic())
        if limit <= 0:
            tried.append(f"no time was left for {', '.join(w.says for w in plan[k:])}")
            break
        otherwise = f"{plan[k + 1].says} is tried" if k + 1 < len(plan) else "nothing else"
        watch = Watch(limit, tell, way.says, way.usual, otherwise)
        tell(f"{way.says}, usually {way.usual:.0f} s" + _after(tried))
        begun = time.monotonic()
        try:
            mesh, meshed = way.make(watch)
            mesh = checked(mesh, surface, edge_length)
        except UnusableMesherError:
            raise
        except (MeshingError, RuntimeError, ValueError, MemoryError) as error:
            # Native libraries raise whatever they do; the next way does without them.
            stopped |= time.monotonic() - begun >= limit
            stopped |= isinstance(error, MemoryError) or getattr(error, "is_machine_limit", False)
            why = OUT_OF_MEMORY if isinstance(error, MemoryError) else str(error)
            tried.append(f"{way.says}: {' '.join(why.split()).partition(';')[0]}")
        else:
            told = tuple(tried)
            return Tetrahedra(mesh, way.mesher, way.says, meshed, told, stopped, time_limit)
    raise MeshingError(
        _advice(tried, time.monotonic() >= until, edge_length, time_limit),
        code="no-mesh",
        tried=tuple(tried),
        limit=time_limit,
        out_of_time=time.monotonic() >= until,
    )


def _after(tried: list[str]) -> str:
    return f"; before that, {tried[-1]}" if tried else ""


def _advice(tried: list[str], late: bool, edge_length: float, time_limit: float) -> str:
    do = f"use a [mesh] edge_length other than {edge_length:g} mm in device.toml"
    if late:
        do = (
            f"raise [mesh] time_limit ({time_limit:g} s) or edge_length ({edge_length:g} mm) in"
            " device.toml"
        )
    return (
        f"no way led from the body's surface to tets ({'. '.join(tried)}); {do}, or mend the"
        " surface in a mesh editor: remesh it, and remove triangles that cut each other"
    )


def _check_size(surface: Surface, edge_length: float) -> None:
    size = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    if edge_length < 1e-4 * size or 8.5 * surface.volume / edge_length**3 > 2e6:
        raise MeshingError(
            f"device.toml: mesh.edge_length: {edge_length:g} mm gives more than 2e6 tets; use"
            f" {(8.5 * surface.volume / 1e5) ** (1 / 3):.2g} mm or more",
            code="edge-too-short",
            edge_length=edge_length,
        )
    if edge_length > size:
        raise MeshingError(
            f"device.toml: mesh.edge_length: {edge_length:g} mm is more than the body's size of"
            f" {size:.3g} mm; use a fifth of the thickness",
            code="edge-too-long",
            edge_length=edge_length,
        )
