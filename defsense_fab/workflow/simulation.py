"""Simulate the poses of a device, and work with the simulated states."""

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
from .arguments import array, of_kind, one_of
from .device import Device, table_html

#: Largest distance of points outside of the body, as a share of the diagonal of the body.
MAX_DISTANCE_SHARE = 0.1


@dataclass(frozen=True)
class Picture:
    """A picture; a notebook shows it if it is the last value of a cell.

    Attributes:
        png: Content of a PNG file.
    """

    png: bytes

    @staticmethod
    def from_uri(uri: str) -> Picture:
        """Return the picture in a data URI that contains a PNG file."""
        return Picture(base64.b64decode(uri.partition(",")[2]))

    def save(self, path: str | Path) -> Path:
        """Write a .png file, completely or not at all.

        Args:
            path: The file.

        Returns:
            The file.

        Raises:
            StorageError: The suffix is not .png, or the file cannot be written.
        """
        file = arguments.file_path(path, ".png", StorageError)
        with replace_file(file) as temporary:
            temporary.write_bytes(self.png)
        return file

    def _repr_png_(self) -> bytes:
        return self.png


def displace_points(mesh: TetMesh, points: Float, displacements: Float) -> Float:
    """Return where points on or near a body are in deformed states.

    Points outside of the body move rigidly with the nearest point of its surface, as things that
    are glued to it do. Fields are not extrapolated, as their quadratic polynomials soon exceed all
    simulated values outside of the body.

    Args:
        mesh: Tetrahedra of the body.
        points: Points (p, 3) mm in the rest frame.
        displacements: Displacements (s, n, 3) mm of the nodes of the quadratic mesh.

    Returns:
        The points (s, p, 3) mm in each state.

    Raises:
        DeviceError: A point is further outside than `MAX_DISTANCE_SHARE` of the diagonal.
    """
    distances = SignedDistance(mesh.boundary())
    outside = np.flatnonzero(~distances.inside(points))
    anchors = points.copy()
    anchors[outside] = distances.nearest(points[outside])
    arms = points - anchors
    _refuse_distant(points, np.linalg.norm(arms, axis=1), mesh)
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    moved = anchors + locator.displacement(locator.find(anchors), displacements)
    outside_location = locator.find(anchors[outside])
    deformed = np.eye(3) + locator.gradient(outside_location, displacements)
    rotations = nearest_rotations(deformed.reshape(-1, 3, 3)).reshape(deformed.shape)
    moved[:, outside] += np.einsum("spij,pj->spi", rotations, arms[outside])
    return np.asarray(moved)


def _refuse_distant(points: Float, distance: Float, mesh: TetMesh) -> None:
    limit = MAX_DISTANCE_SHARE * float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))
    count = int((distance > limit).sum())
    if count:
        worst = int(distance.argmax())
        raise DeviceError(
            f"{count} of {len(points)} are more than {limit:.3g} mm outside of the body, where"
            f" nothing was simulated; the point {format_point(points[worst])} is"
            f" {distance[worst]:.3g} mm away",
            code="points-outside",
            where="points",
            action="Give points on or near the body, in mm in its rest frame",
            argument="points",
            count=count,
            limit=limit,
            index=worst,
            distance=float(distance[worst]),
        )


@dataclass(frozen=True, repr=False)
class Simulation:
    """The simulated states of a device, created by `simulate`.

    Attributes:
        device: The device.
        names: Names of the s states, as in "bend@1".
        weights: Amount of each pose in each state, by name of the pose.
        held_out: Whether each state (s,) is held out of the design.
        nodes: Nodes (n, 3) mm in the rest frame.
        cells: Quadratic tetrahedra (m, 10) of these nodes.
        displacements: Displacements (s, n, 3) mm of the nodes.
        strains: Largest principal strain (s, n) at the nodes.
        surface: The triangles of the body at rest.
        warnings: Reasons to doubt the results.
        results: The results of the build.
    """

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
        """Return the index of a state.

        Args:
            state: Name of the state, as in "bend@1".

        Raises:
            DeviceError: There is no such state.
        """
        return self.names.index(one_of(state, "state", self.names, "state"))

    def displaced(self, points: ArrayLike) -> Float:
        """Return where points are in each state.

        Points outside of the body move rigidly with the nearest point of its surface, as things
        that are glued to it do.

        Args:
            points: Points (p, 3) mm in the rest frame.

        Returns:
            The points (s, p, 3) mm in each state.

        Raises:
            DeviceError: The values are not points, or a point is further outside of the body than
                a tenth of its diagonal.
        """
        return displace_points(self.results.mesh, _points(points), self.displacements)

    def picture(self, state: str) -> Picture:
        """Return a picture of the deformed body from two sides, colored by displacement in mm.

        Args:
            state: Name of the state.

        Raises:
            DeviceError: There is no such state.
        """
        from ..geometry.bodies.orientation import viewing_axes
        from ..report.pictures import color_bar
        from ..report.pictures.pose_pictures import draw_error_map

        skin = self.results.mesh.boundary()
        index = self.index(state)
        moved = self.displaced(skin.vertices)[index]
        distance = np.linalg.norm(moved - skin.vertices, axis=1)
        label = f"{state}: displacement, mm"
        scale = color_bar.scale("viridis", label, float(distance.max()))
        shape = Surface(moved, skin.faces)
        return Picture.from_uri(draw_error_map(shape, distance, viewing_axes(self.surface), scale))

    def __repr__(self) -> str:
        states, nodes = len(self.names), len(self.nodes)
        return f"<Simulation of {self.device.name!r}: {states} states, {nodes} nodes>"

    def _repr_html_(self) -> str:
        distances = np.linalg.norm(self.displacements, axis=2).max(axis=1)
        strains = self.strains.max(axis=1)
        rows = {
            name: f"displacement up to {distance:.1f} mm, strain up to {strain:.0%}"
            for name, distance, strain in zip(self.names, distances, strains, strict=True)
        }
        return table_html(f"States of {self.device.name}", rows)


def simulate(device: Device, progress: Progress = silent) -> Simulation:
    """Solve all states of a device, as `defsense build` does.

    Args:
        device: The device.
        progress: Receives each stage's name, completed fraction and a message.

    Raises:
        DefsenseError: A stage failed; SolveError if a pose does not converge.
    """
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


def _points(values: ArrayLike) -> Float:
    points = array(values, "points")
    if points.ndim != 2 or points.shape[1] != 3:
        raise DeviceError(
            f"must have shape (p, 3), in mm, not {points.shape}",
            code="wrong-shape",
            where="points",
            argument="points",
            shape=points.shape,
        )
    if not np.isfinite(points).all():
        raise DeviceError(
            "must be finite, in mm", code="not-finite", where="points", argument="points"
        )
    return points
