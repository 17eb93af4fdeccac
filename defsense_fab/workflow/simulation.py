"""The poses of a device as displacement fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Bool, Float, Int
from ..core.errors import DeviceError
from ..core.mesh import Surface
from ..core.progress import Progress, silent
from ..mechanics.elements.tet10 import QuadraticMesh
from ..store.body import load_surface
from ..store.fields import load_fields, load_index
from ..store.mesh import load_mesh
from .device import Device, table_html
from .following import followed
from .given import array, of_kind
from .picture import Picture


@dataclass(frozen=True, repr=False)
class Simulation:
    """All s states of a `device`: their `names`, how much of each pose they have (`weights`), which
    are `held_out` (s,) of the design; displacements (s, n, 3) mm of the n `nodes` (n, 3) mm in the
    rest frame, and the largest principal `strains` (s, n). `cells` (m, 10) are quadratic tetrahedra
    of these nodes, `surface` the body's own triangles at rest, `warnings` what is doubtful."""

    device: Device
    names: tuple[str, ...]
    weights: tuple[Mapping[str, float], ...]
    held_out: Bool
    nodes: Float
    cells: Int
    displacements: Float
    strains: Float
    surface: Surface
    warnings: tuple[str, ...]

    def index(self, state: str) -> int:
        """The number of a state by its name, as in "bend@1". Raises DeviceError."""
        of_kind(state, "state", str)
        if state not in self.names:
            raise DeviceError(f"no state is called {state!r}; there are {', '.join(self.names)}")
        return self.names.index(state)

    def displaced(self, points: ArrayLike) -> Float:
        """Where points (p, 3) mm of the rest frame are in each state, (s, p, 3) mm. Points outside
        of the body are carried rigidly by the place of it that is nearest, as what is glued on it.
        Raises DeviceError for what is no points, and for points further outside than a tenth of the
        body's diagonal, where nothing is known."""
        return followed(load_mesh(self._build), _checked(points), self.displacements)

    def picture(self, state: str) -> Picture:
        """The deformed body from two sides, coloured by how far it moves, mm. Raises DeviceError
        for a state that there is not."""
        from ..geometry.bodies.orientation import viewing_axes
        from ..report.pictures.poses import color_bar
        from ..report.pictures.poses.errors import error_map

        skin = load_mesh(self._build).boundary()
        at = self.index(state)
        moved = self.displaced(skin.vertices)[at]
        far = np.linalg.norm(moved - skin.vertices, axis=1)
        scale = color_bar.scale("viridis", f"{state}: displacement, mm", float(far.max()))
        shape = Surface(moved, skin.faces)
        return Picture.of_uri(error_map(shape, far, viewing_axes(self.surface), scale))

    @property
    def _build(self) -> Path:
        return self.device.workspace.folder / "build"

    def __repr__(self) -> str:
        states, nodes = len(self.names), len(self.nodes)
        return f"<Simulation of {self.device.name!r}: {states} states, {nodes} nodes>"

    def _repr_html_(self) -> str:
        far = np.linalg.norm(self.displacements, axis=2).max(axis=1)
        strain = self.strains.max(axis=1)
        rows = {
            n: f"moves by up to {d:.1f} mm, strains by up to {e:.0%}"
            for n, d, e in zip(self.names, far, strain, strict=True)
        }
        return table_html(f"States of {self.device.name}", rows)


def simulate(device: Device, progress: Progress = silent) -> Simulation:
    """Solve every state of a device, as `defsense build` does. Raises a DefsenseError: DeviceError
    for what is no device, BodyError, MeshingError, SolveError for a pose that the body cannot
    take."""
    of_kind(device, "device", Device)
    folder = device.workspace.built(device.record, "simulate", progress)
    fields = load_fields(folder)
    mesh = QuadraticMesh.from_linear(load_mesh(folder))
    return Simulation(
        device, fields.names, fields.weights, fields.held_out, mesh.nodes,
        np.asarray(mesh.cells, np.int64), fields.displacements, fields.strains,
        load_surface(folder), load_index(folder).warnings,
    )  # fmt: skip


def _checked(points: ArrayLike) -> Float:
    at = array(points, "points")
    if at.ndim != 2 or at.shape[1] != 3:
        raise DeviceError(f"points: must have shape (p, 3), in mm, not {at.shape}")
    if not np.isfinite(at).all():
        raise DeviceError("points: must be finite, in mm")
    return at
