"""The poses of a device as displacement fields."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Bool, Float, Int, format_point
from ..core.errors import DeviceError, StorageError
from ..core.mesh import Surface, TetMesh
from ..core.progress import Progress, silent
from ..core.storage.files import replace_file
from ..geometry.kernels.surface_queries import SignedDistance
from ..mechanics.elements.point_location import PointLocator
from ..mechanics.elements.tet10 import QuadraticMesh
from ..runtime.surface.rotation import nearest_rotations
from ..store.build import Build
from . import arguments
from .arguments import array, of_kind
from .device import Device, table_html

# Pictures that notebooks show and that can be saved.


@dataclass(frozen=True)
class Picture:
    """A picture as the bytes of a `png` file: the last value of a notebook's cell is shown."""

    png: bytes

    @staticmethod
    def of_uri(uri: str) -> Picture:
        """Of a data URI with a PNG in it."""
        return Picture(base64.b64decode(uri.partition(",")[2]))

    def save(self, path: str | Path) -> Path:
        """Write the .png file, whole or not at all. Raises StorageError, for other suffixes too."""
        file = arguments.path(path, "path", StorageError)
        if file.suffix.lower() != ".png":
            raise StorageError(f"{file}: a picture is a .png file; let its name end so")
        with replace_file(file) as temporary:
            temporary.write_bytes(self.png)
        return file

    def _repr_png_(self) -> bytes:
        return self.png


# Where points on a body go when it deforms, and those a little outside of it, as what is glued on.
#
# Fields are known inside the body alone: continued beyond it, their quadratic polynomials soon leave
# everything that was simulated.

REACH = 0.1  # of the body's diagonal, by which points may be outside


def followed(mesh: TetMesh, points: Float, displacements: Float) -> Float:
    """Points (p, 3) mm of the rest frame in each state, (s, p, 3) mm, with the displacements
    (s, n, 3) mm of the quadratic mesh's nodes; outside of the body they are carried rigidly by the
    place of it that is nearest. Raises DeviceError for points further outside than REACH."""
    skin = SignedDistance(mesh.boundary())
    outside = np.flatnonzero(~skin.inside(points))
    on = points.copy()
    on[outside] = skin.nearest(points[outside])
    arms = points - on
    _refuse_far(points, np.linalg.norm(arms, axis=1), mesh)
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    moved = on + locator.displacement(locator.find(on), displacements)
    there = locator.find(on[outside])
    deformed = np.eye(3) + locator.gradient(there, displacements)
    turns = nearest_rotations(deformed.reshape(-1, 3, 3)).reshape(deformed.shape)
    moved[:, outside] += np.einsum("spij,pj->spi", turns, arms[outside])
    return np.asarray(moved)


def _refuse_far(points: Float, distance: Float, mesh: TetMesh) -> None:
    limit = REACH * float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))
    far = int((distance > limit).sum())
    if far:
        worst = int(distance.argmax())
        raise DeviceError(
            f"points: {far} of {len(points)} lie more than {limit:.3g} mm outside of the body, the"
            f" furthest {format_point(points[worst])} by {distance[worst]:.3g} mm, where nothing was"
            " simulated; give points in mm in the body's rest frame, on it or near it"
        )


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
    results: Build

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
        return followed(self.results.mesh, _checked(points), self.displacements)

    def picture(self, state: str) -> Picture:
        """The deformed body from two sides, coloured by how far it moves, mm. Raises DeviceError
        for a state that there is not."""
        from ..geometry.bodies.orientation import viewing_axes
        from ..report.pictures.poses import color_bar
        from ..report.pictures.poses.errors import error_map

        skin = self.results.mesh.boundary()
        at = self.index(state)
        moved = self.displaced(skin.vertices)[at]
        far = np.linalg.norm(moved - skin.vertices, axis=1)
        scale = color_bar.scale("viridis", f"{state}: displacement, mm", float(far.max()))
        shape = Surface(moved, skin.faces)
        return Picture.of_uri(error_map(shape, far, viewing_axes(self.surface), scale))

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
    results = device.results("simulate", progress)
    fields, mesh = results.fields, results.quadratic_mesh
    return Simulation(
        device=device,
        names=fields.names,
        weights=fields.weights,
        held_out=fields.held_out,
        nodes=mesh.nodes,
        cells=np.asarray(mesh.cells, np.int64),
        displacements=fields.displacements,
        strains=fields.strains,
        surface=results.surface,
        warnings=results.field_index.warnings,
        results=results,
    )


def _checked(points: ArrayLike) -> Float:
    at = array(points, "points")
    if at.ndim != 2 or at.shape[1] != 3:
        raise DeviceError(f"points: must have shape (p, 3), in mm, not {at.shape}")
    if not np.isfinite(at).all():
        raise DeviceError("points: must be finite, in mm")
    return at
