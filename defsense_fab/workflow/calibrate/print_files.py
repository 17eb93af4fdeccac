"""Calibration parts on their way to a printer: as they lie on its bed, checked, and written."""

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

_DEVIATION = 0.01  # mm, of facets from the solid
_THICKEST = 20.0  # mm, of a cord


@dataclass(frozen=True)
class Print:
    """A part's facets as it lies on the bed, and its TopoDS_Solid where it was modelled."""

    surface: Surface
    solid: Any

    @classmethod
    def of(cls, name: str, solid: Any, up: Sequence[float]) -> Print:
        """With `up` (3,), an axis of the solid or its opposite, pointing up."""
        from ...geometry.kernels import occ, triangle_kernel

        surface = triangle_kernel.to_printable_surface(
            triangle_kernel.to_manifold(occ.tessellate(solid, _DEVIATION), name), name
        )
        z = np.asarray(up, float)
        x = np.array([1.0, 0, 0]) if abs(z[0]) < 0.5 else np.array([0, 1.0, 0])
        vertices = surface.vertices @ np.stack([x, np.cross(z, x), z]).T
        low, high = vertices.min(0), vertices.max(0)
        middle = np.append((low + high)[:2] / 2, low[2])
        return cls(Surface(vertices - middle, surface.faces), solid)

    @property
    def size(self) -> list[float]:
        return [float(n) for n in np.ptp(self.surface.bounds, axis=0)]


@dataclass(frozen=True)
class Printer:
    """A row of `printers.csv`, mm; of `kind` "print", or "cast" where it prints moulds."""

    name: str
    clearance: float
    wall: float
    bed: tuple[float, float, float]
    kind: str = "print"

    @property
    def inner_wall(self) -> float:
        """Two of the three lines of a wall: between channels and what is glued or closed."""
        return 2 * self.wall / 3

    @classmethod
    def named(cls, name: str) -> Printer:
        row = _row("printers.csv", "process", name)
        bed = (float(row["bed_x"]), float(row["bed_y"]), float(row["bed_z"]))
        return cls(name, float(row["clearance"]), float(row["wall"]), bed, row["kind"])

    def check(self, sizes: Mapping[str, Sequence[float]]) -> None:
        """Raises FabricationError for a part of these sizes (3,), mm, that the bed does not
        hold."""
        bed = self.bed
        for name, (x, y, z) in sizes.items():
            if z > bed[2] or not ((x <= bed[0] and y <= bed[1]) or (y <= bed[0] and x <= bed[1])):
                raise FabricationError(
                    f"{name} measures {x:.0f} x {y:.0f} x {z:.0f} mm and does not fit the bed of"
                    f" {self.name} ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm); make it smaller"
                )


@dataclass(frozen=True)
class PrintFiles:
    """What the JSON file among the parts holds, and where they are."""

    data: dict[str, Any]
    folder: Path


def cord_diameter(name: str) -> float:
    """Of a row of `cords.csv`, or of a cord that is given by its diameter itself, mm."""
    with suppress(ValueError):
        if 0 < (given := float(name)) < _THICKEST:
            return given
    return float(_row("cords.csv", "cord", name)["diameter"])


def write_prints(
    folder: Path, prints: Mapping[str, Print], data: dict[str, Any], file: str
) -> PrintFiles:
    """STL and STEP of every part, and last `data` with a list of them."""
    from ...geometry.kernels import occ
    from ...geometry.printing.export import write_stl

    parts = [
        {"name": n, "stl": f"{n}.stl", "step": f"{n}.step", "size": one.size}
        for n, one in prints.items()
    ]
    data = {"schema": 1, "unit": "mm", **data, "parts": parts}
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, one in prints.items():
            write_stl(one.surface, folder / f"{name}.stl")
            occ.write_step(one.solid, folder / f"{name}.step", name)
        write_json(folder / file, data)
    return PrintFiles(data, folder)


def _row(file: str, what: str, name: str) -> dict[str, str]:
    rows = read_rows(file)
    if name not in rows:
        raise FabricationError(f"unknown {what} {name!r}; there are {', '.join(rows)}")
    return rows[name]
