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
from .mesh_quality import checked
from .mesher_runs import UnusableMesherError, Watch
from .ways import NETGEN, MeshedSurface, ways


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


def tetrahedralise(
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
