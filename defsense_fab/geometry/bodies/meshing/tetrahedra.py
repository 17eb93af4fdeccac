"""Fill a body's surface with tetrahedra, trying one method after the other until a mesh is sound.

Netgen on the surface as it is keeps sharp edges, but fails on bumps finer than the tets, and takes
long with many triangles. Remeshed triangles suit any organic surface and are fast, but cut sharp
edges. fTetWild (Hu et al. 2020) meshes what the others cannot, but never twice the same.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ....core.device.device import MeshSpec
from ....core.errors import MeshingError
from ....core.machine.child_process import OUT_OF_MEMORY
from ....core.mesh import Surface, TetMesh
from ....core.schema.types import exact
from .child_work import RunMonitor
from .mesh_improvement import improve_flat_tets
from .mesh_quality import bound_ratio, check_mesh, fit_boundary
from .meshers import FTETWILD, NETGEN, UnusableMesherError, run_mesher
from .netgen_mesh import count_tets, mesh_with_netgen
from .simplification import (
    MIN_FINE_TRIANGLES,
    SimplifiedSurface,
    is_creased,
    is_fine,
    is_rough,
    measure_deviation,
)
from .surface_remeshing import remesh_in_time, remesh_on_grid_in_time, simplify_in_time

#: Allowed distance of a remeshed surface, and of one from a grid, from the body, in edges of the
#: tets.
REMESHED_TOLERANCE_EDGES, GRID_TOLERANCE_EDGES = 0.35, 0.6
#: Edges of remeshed triangles, in edges of the tets: if they cross each other, the next is used.
EDGE_FACTORS = (1.0, 0.75, 0.55)
#: Meshes of more tets than this times those that the edge length asks for are replaced if possible.
MAX_TETS_RATIO = 4.0
#: fTetWild's envelope in edges, its largest share of the body's size, and the coarser envelope.
ENVELOPE_EDGES, MAX_ENVELOPE, COARSE_ENVELOPE_EDGES = 0.02, 1e-3, 0.06


@dataclass(frozen=True)
class MeshedSurface:
    """The surface that was meshed instead of the body's.

    Attributes:
        triangles: Its number of triangles.
        of: Number of triangles of the body's surface.
        tolerance: Distance from the body's surface that was allowed, mm.
        deviation: Distance as measured, mm.
    """

    triangles: int
    of: int
    tolerance: float
    deviation: float


Outcome = tuple[TetMesh, MeshedSurface | None]


@dataclass(frozen=True)
class MeshingMethod:
    """One method from a surface to tets.

    Attributes:
        name: Display name.
        mesher: Mesher that it runs.
        share: Share of the time limit that it may take.
        usual_duration: Duration on an idle machine, s.
        make: Makes the mesh under a monitor.
    """

    name: str
    mesher: str
    share: float
    usual_duration: float
    make: Callable[[RunMonitor], Outcome]


def plan_methods(surface: Surface, edge_length: float) -> list[MeshingMethod]:
    """Return all methods, the best first.

    Repeatable methods come first, unless the body has sharp edges that only fTetWild keeps. Folds
    of the skin that are no edges of the body are left to remeshing.

    Args:
        surface: Surface of the body.
        edge_length: Edge length of the tets, mm.
    """
    triangles = len(surface.faces)
    tets = count_tets(surface, edge_length)
    fine_surface = is_fine(surface, edge_length)
    surface_name = "the simplified surface" if fine_surface else "the surface"
    simplified = _LazySimplification(surface, edge_length, fine_surface)
    count = min(triangles, MIN_FINE_TRIANGLES) if fine_surface else triangles
    direct = MeshingMethod(
        f"Netgen on {surface_name}",
        NETGEN,
        0.1,
        2 + tets / 1000 + count / 4000,
        lambda monitor: (
            mesh_with_netgen(simplified.surface(monitor), surface, edge_length, monitor),
            simplified.record,
        ),
    )
    remeshed = [_remeshing_method(surface, edge_length, k, tets) for k in EDGE_FACTORS]
    grid = MeshingMethod(
        "Netgen on the surface of a grid of distances",
        NETGEN,
        0.1,
        5 + tets / 1000,
        lambda monitor: _fill_remeshed(
            remesh_on_grid_in_time(surface, edge_length, monitor),
            surface,
            edge_length,
            1.0,
            GRID_TOLERANCE_EDGES,
            monitor,
        ),
    )
    size = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    usual_duration = 10 + count / 150
    fine, coarse = (
        MeshingMethod(
            f"fTetWild on {surface_name}{text}",
            FTETWILD,
            share,
            usual_duration,
            _ftetwild_step(simplified, edge_length, epsilon),
        )
        for text, share, epsilon in (
            ("", 0.5, min(MAX_ENVELOPE, ENVELOPE_EDGES * edge_length / size)),
            (" with a coarse envelope", 1.0, COARSE_ENVELOPE_EDGES * edge_length / size),
        )
    )
    if fine_surface:
        return [*remeshed, direct, grid, fine, coarse]
    if is_creased(surface):
        return [direct, fine, *remeshed, grid, coarse]
    if is_rough(surface):
        return [*remeshed, grid, direct, fine, coarse]
    return [direct, *remeshed, grid, fine, coarse]


def _remeshing_method(
    surface: Surface, edge_length: float, factor: float, tets: float
) -> MeshingMethod:
    suffix = "" if factor == 1.0 else f", edges of {factor:g}"
    return MeshingMethod(
        f"Netgen on remeshed triangles{suffix}",
        NETGEN,
        0.1,
        3 + tets / factor**3 / 1000,
        lambda monitor: _fill_remeshed(
            surface, surface, edge_length, factor, REMESHED_TOLERANCE_EDGES, monitor
        ),
    )


def _fill_remeshed(
    given: Surface,
    surface: Surface,
    edge_length: float,
    factor: float,
    tolerance_edges: float,
    monitor: RunMonitor,
) -> Outcome:
    """Remesh the surface `given`, fill it with tets, and fit them to the body's surface."""
    remeshed = remesh_in_time(given, factor * edge_length, monitor)
    distance, tolerance = measure_deviation(remeshed, surface), tolerance_edges * edge_length
    if distance > tolerance:
        raise MeshingError(
            f"the triangles are {distance:.2g} mm off the surface, and {tolerance:.2g} mm is"
            f" allowed",
            code="surface-too-far",
            distance=distance,
        )
    mesh = run_mesher(NETGEN, remeshed, {"edge_length": edge_length, "fill": True}, monitor)
    if len(mesh.boundary().faces) != len(remeshed.faces):
        raise MeshingError(
            "the mesher changed triangles, which cross each other", code="surface-crosses-itself"
        )
    return fit_boundary(mesh, surface), MeshedSurface(
        len(remeshed.faces), len(surface.faces), tolerance, distance
    )


def _ftetwild_step(
    simplified: _LazySimplification, edge_length: float, epsilon: float
) -> Callable[[RunMonitor], Outcome]:
    task = {"edge_length": edge_length, "epsilon": epsilon}
    return lambda monitor: (
        run_mesher(FTETWILD, simplified.surface(monitor), task, monitor),
        simplified.record,
    )


class _LazySimplification:
    """A surface that is simplified when it is first requested, if it is fine."""

    def __init__(self, surface: Surface, edge_length: float, fine: bool) -> None:
        self._original, self._edge_length = surface, edge_length
        self._simplified = None if fine else SimplifiedSurface(surface)

    def surface(self, monitor: RunMonitor) -> Surface:
        """Return the simplified surface.

        If simplifying takes too long, raise MeshingError; later calls return the body's own
        surface.
        """
        if self._simplified is None:
            self._simplified = SimplifiedSurface(self._original)
            self._simplified = simplify_in_time(self._original, self._edge_length, monitor)
        return self._simplified.surface

    @property
    def record(self) -> MeshedSurface | None:
        """The record of the simplified surface, or None if the body's own was meshed."""
        s, original = self._simplified, self._original
        if s is None or s.surface is original:
            return None
        return MeshedSurface(len(s.surface.faces), len(original.faces), s.tolerance, s.deviation)


@dataclass(frozen=True)
class Tetrahedra:
    """A mesh and how it was made.

    Attributes:
        mesh: The mesh.
        mesher: Mesher that made it.
        way: Display name of the method.
        surface: The surface that was meshed, or None if it was the body's.
        tried: Sentences on methods that failed before.
        stopped: Whether a method was stopped for lack of time or memory, of which another machine
            might have more.
        time_limit: Time limit of all methods then, s; the default if it is unknown.
    """

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

    def is_outgrown(self, time_limit: float) -> bool:
        """Return whether a better method was stopped to which a longer limit (s) gives more
        time.
        """
        return self.stopped and time_limit > self.time_limit


def tetrahedralize(
    surface: Surface,
    edge_length: float,
    on_step: Callable[[str], None] | None = None,
    time_limit: float = MeshSpec.time_limit,
) -> Tetrahedra:
    """Fill a surface with tets by the first method whose mesh is sound.

    Args:
        surface: Closed surface, mm.
        edge_length: Mean edge length of the tets, mm; shorter where the curvature requires it.
        on_step: Called with progress messages.
        time_limit: Time limit of all methods, s.

    Returns:
        The mesh.

    Raises:
        MeshingError: If the edge length does not fit the body, a mesher is not installed properly,
            or all methods fail or take too long.
    """
    check_edge_length(surface, edge_length)
    report = on_step or (lambda _: None)
    report(f"{len(surface.faces):,} triangles are checked")
    deadline = time.monotonic() + time_limit
    tried: list[str] = []
    stopped = False
    best: tuple[float, Tetrahedra] | None = None
    plan = plan_methods(surface, edge_length)
    for k, method in enumerate(plan):
        if best is not None and not _is_alternative(method, surface):
            break
        limit = min(method.share * time_limit, deadline - time.monotonic())
        if limit <= 0:
            tried.append(f"no time was left for {', '.join(m.name for m in plan[k:])}")
            stopped = True
            break
        fallback = f"{plan[k + 1].name} comes next" if k + 1 < len(plan) else "nothing else"
        monitor = RunMonitor(limit, report, method.name, method.usual_duration, fallback)
        report(f"{method.name}, usually {method.usual_duration:.0f} s" + _describe_last(tried))
        started_at = time.monotonic()
        try:
            mesh, meshed = method.make(monitor)
            mesh = check_mesh(improve_flat_tets(mesh, surface), surface, edge_length)
        except UnusableMesherError:
            raise
        except (MeshingError, RuntimeError, ValueError, MemoryError) as error:
            # Native libraries raise errors of any class; the next method does without them.
            stopped |= time.monotonic() - started_at >= limit
            stopped |= isinstance(error, MemoryError) or getattr(error, "is_machine_limit", False)
            reason = OUT_OF_MEMORY if isinstance(error, MemoryError) else str(error)
            tried.append(f"{method.name}: {' '.join(reason.split()).partition(';')[0]}")
        else:
            score = _score(mesh, surface, edge_length)
            if best is None or score > best[0]:
                made = Tetrahedra(mesh, method.mesher, method.name, meshed, (), False, time_limit)
                best = score, made
            if score >= 1:
                break
            tried.append(f"{method.name}: it made flat tets, or too many ({len(mesh.tets):,})")
    if best is not None:
        return replace(best[1], tried=tuple(tried), stopped=stopped)
    is_out_of_time = time.monotonic() >= deadline
    raise MeshingError(
        f"no method filled the body's surface with tets ({'. '.join(tried)})",
        code="no-mesh",
        action=_advice(is_out_of_time, edge_length, time_limit),
        tried=tuple(tried),
        limit=time_limit,
        out_of_time=is_out_of_time,
    )


def _score(mesh: TetMesh, surface: Surface, edge_length: float) -> float:
    """Return how near a mesh comes to the bounds on its angles and its number of tets, up to 1."""
    max_tets = MAX_TETS_RATIO * count_tets(surface, edge_length)
    return min(bound_ratio(mesh), 1.0) * min(max_tets / len(mesh.tets), 1.0)


def _is_alternative(method: MeshingMethod, surface: Surface) -> bool:
    """Return whether a method may replace a sound mesh that has flat or too many tets: it makes
    the same mesh each time, and no edges of the body are cut.
    """
    return method.mesher == NETGEN and not is_creased(surface)


def _describe_last(tried: list[str]) -> str:
    return f"; before that, {tried[-1]}" if tried else ""


def _advice(is_out_of_time: bool, edge_length: float, time_limit: float) -> str:
    """Return the action for a body that no method could mesh."""
    change = f"Use a [mesh] edge_length other than {edge_length:g} mm in device.toml"
    if is_out_of_time:
        change = (
            f"Raise [mesh] time_limit ({time_limit:g} s) or edge_length ({edge_length:g} mm) in"
            " device.toml"
        )
    return (
        f"{change}, or repair the surface in a mesh editor: remesh it, and remove triangles that"
        " cross each other"
    )


def check_edge_length(surface: Surface, edge_length: float) -> None:
    """Check that an edge length fits a body.

    Args:
        surface: Surface of the body, mm.
        edge_length: Edge length of the tets, mm.

    Raises:
        MeshingError: It gives too many tets (`edge-too-short`), or it is longer than the body
            (`edge-too-long`).
    """
    extents = np.ptp(surface.bounds, axis=0)
    if edge_length < 1e-4 * np.linalg.norm(extents) or count_tets(surface, edge_length) > 2e6:
        raise MeshingError(
            f"{exact(edge_length)} mm gives more than 2 million tetrahedra",
            code="edge-too-short",
            where="device.toml: mesh.edge_length",
            action=f"Use {(8.5 * surface.volume / 1e5) ** (1 / 3):.2g} mm or more",
            edge_length=edge_length,
            key="mesh.edge_length",
        )
    if edge_length > extents.max():
        size = " × ".join(f"{x:.4g}" for x in extents)
        raise MeshingError(
            f"{exact(edge_length)} mm is longer than the body, which is {size} mm",
            code="edge-too-long",
            where="device.toml: mesh.edge_length",
            action="Use about a fifth of its thickness",
            edge_length=edge_length,
            size=tuple(extents.tolist()),
            key="mesh.edge_length",
        )
