"""Files of calibration parts for a printer: parts oriented on its bed, checked, and written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...core.storage.files import storage_errors, write_json
from ...core.storage.package_data import read_rows

_FACET_DEVIATION_MM = 0.01  # of facets from the solid
_MAX_CORD_DIAMETER_MM = 20.0


@dataclass(frozen=True)
class PrintPart:
    """A part to print.

    Attributes:
        surface: Its facets, as it is on the bed, mm.
        solid: Its TopoDS_Solid, as it was modeled.
    """

    surface: Surface
    solid: Any

    @classmethod
    def from_solid(cls, name: str, solid: Any, up: Sequence[float]) -> PrintPart:
        """Create a part from a solid.

        Args:
            name: Name of the part, for errors.
            solid: A TopoDS_Solid.
            up: Direction (3,) of the solid that points up on the bed: an axis or its opposite.
        """
        from ...geometry.kernels import occ, triangle_kernel

        surface = triangle_kernel.to_printable_surface(
            triangle_kernel.to_manifold(occ.tessellate(solid, _FACET_DEVIATION_MM), name), name
        )
        z = np.asarray(up, float)
        x = np.array([1.0, 0, 0]) if abs(z[0]) < 0.5 else np.array([0, 1.0, 0])
        vertices = surface.vertices @ np.stack([x, np.cross(z, x), z]).T
        low, high = vertices.min(0), vertices.max(0)
        middle = np.append((low + high)[:2] / 2, low[2])
        return cls(Surface(vertices - middle, surface.faces), solid)

    @property
    def size(self) -> list[float]:
        """Size of the bounding box (3,), mm."""
        return [float(n) for n in np.ptp(self.surface.bounds, axis=0)]


@dataclass(frozen=True)
class Printer:
    """A row of `printers.csv`.

    Attributes:
        name: Name of the process.
        clearance: Clearance of a cord in its channel, on the diameter, mm.
        wall: Smallest wall thickness, mm.
        bed: Size of the print bed, mm.
        kind: "print", or "cast" where it prints molds.
    """

    name: str
    clearance: float
    wall: float
    bed: tuple[float, float, float]
    kind: str = "print"

    @property
    def inner_wall(self) -> float:
        """Thickness of two of a wall's three lines, mm: next to channels that are glued."""
        return 2 * self.wall / 3

    @classmethod
    def from_name(cls, name: str) -> Printer:
        """Return the printer of a process.

        Raises:
            FabricationError: The process is unknown.
        """
        row = _find_row("printers.csv", "process", name)
        bed = (float(row["bed_x"]), float(row["bed_y"]), float(row["bed_z"]))
        return cls(name, float(row["clearance"]), float(row["wall"]), bed, row["kind"])

    def check_sizes(self, sizes: Mapping[str, Sequence[float]]) -> None:
        """Check that parts fit the bed.

        Args:
            sizes: Size of each part (3,), mm.

        Raises:
            FabricationError: A part does not fit.
        """
        bed = self.bed
        for name, (x, y, z) in sizes.items():
            if z > bed[2] or not ((x <= bed[0] and y <= bed[1]) or (y <= bed[0] and x <= bed[1])):
                raise FabricationError(
                    f"measures {x:.0f} x {y:.0f} x {z:.0f} mm and does not fit the bed of"
                    f" {self.name} ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm)",
                    code="part-too-large",
                    where=name,
                    action="Make it smaller, or choose another process",
                    part=name,
                )


@dataclass(frozen=True)
class PrintFiles:
    """Files that were written.

    Attributes:
        data: Content of the JSON file among them.
        folder: Their folder.
    """

    data: dict[str, Any]
    folder: Path


def cord_diameter(name: str) -> float:
    """Return the diameter of a cord, mm.

    Args:
        name: A row of `cords.csv`, or the diameter itself in mm.

    Raises:
        FabricationError: The cord is unknown.
    """
    with suppress(ValueError):
        if 0 < (diameter := float(name)) < _MAX_CORD_DIAMETER_MM:
            return diameter
    return float(_find_row("cords.csv", "cord", name)["diameter"])


def write_prints(
    folder: Path, parts: Mapping[str, PrintPart], data: dict[str, Any], file: str
) -> PrintFiles:
    """Write an STL and a STEP file of every part, and last a JSON file.

    Args:
        folder: Folder for the files.
        parts: The parts by name.
        data: Content of the JSON file, to which a list of the parts is added.
        file: Name of the JSON file.

    Returns:
        The files.

    Raises:
        StorageError: A file cannot be written.
    """
    from ...geometry.kernels import occ
    from ...geometry.printing.export import write_stl

    records = [
        {"name": name, "stl": f"{name}.stl", "step": f"{name}.step", "size": part.size}
        for name, part in parts.items()
    ]
    data = {"schema": 1, "unit": "mm", **data, "parts": records}
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, part in parts.items():
            write_stl(part.surface, folder / f"{name}.stl")
            occ.write_step(part.solid, folder / f"{name}.step", name)
        write_json(folder / file, data)
    return PrintFiles(data, folder)


def _find_row(file: str, noun: str, name: str) -> dict[str, str]:
    rows = read_rows(file)
    if name not in rows:
        raise FabricationError(
            f"unknown {noun} {name!r}",
            code=f"unknown-{noun}",
            action=f"Choose one of {', '.join(rows)}",
            name=name,
        )
    return rows[name]
