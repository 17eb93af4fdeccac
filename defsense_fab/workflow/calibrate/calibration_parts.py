"""Write the files of calibration parts: the fit coupon, and the bending specimen with its jigs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...core.progress import Progress, silent
from ...core.response import CORD_OFFSET_MM
from ...core.storage.files import check_folder, storage_errors, write_json
from ...core.storage.package_data import read_rows
from .options import CLEARANCES_MM, PrintOptions, SpecimenOptions

if TYPE_CHECKING:
    from ...geometry.specimen.specimen import Specimen

COUPON_FILE, SPECIMEN_FILE = "coupon.json", "specimen.json"
#: Explanation for processes that cast their parts.
NO_MOULD = (
    "casts parts in printed moulds, and the coupon has no mould: the clearance of a printed coupon"
    " does not hold for cast grooves. Cast the smallest part of the device first, insert cord into"
    " its groove and a pin into its socket, and set [fabrication] clearance accordingly"
)
_DEFAULT_SPECIMEN, _DEFAULT_PRINTING = SpecimenOptions(), PrintOptions()
_ROUNDING_MM = 1e-6
_FACET_DEVIATION_MM = 0.01  # of facets from the solid
_MAX_CORD_DIAMETER_MM = 20.0
#: Directions that point up on the bed: jigs are on their side, halves on their outer side.
_UP, _SIDE_UP = {"specimen-right": (0, -1, 0)}, (0, 1, 0)


def write_coupon(
    folder: Path,
    clearances: Sequence[float] = CLEARANCES_MM,
    printing: PrintOptions = _DEFAULT_PRINTING,
) -> PrintFiles:
    """Write STL and STEP files of the coupon's plate and peg, and `coupon.json`.

    Args:
        folder: Folder for the files.
        clearances: Clearances on the diameter, mm.
        printing: The cord and the process.

    Returns:
        The files.

    Raises:
        FabricationError: Clearances are not valid, the process casts its parts, or the bed is too
            small for the plate.
        StorageError: A file cannot be written.
    """
    from ...geometry.specimen.coupon import PEG_DIAMETER_MM, coupon_sizes, make_coupon

    if not all(np.isfinite(c) for c in clearances) or len(set(clearances)) < len(clearances):
        raise FabricationError(
            f"the clearances {', '.join(f'{c:g}' for c in clearances)} are not valid",
            code="clearances-invalid",
            where="coupon",
            action="Give different clearances in mm",
        )
    diameter, printer = cord_diameter(printing.cord), Printer.from_name(printing.process)
    if printer.kind == "cast":
        raise FabricationError(
            f"{printer.name} {NO_MOULD}",
            code="process-casts",
            where="coupon",
            process=printer.name,
        )
    ordered = sorted(clearances)
    printer.check_sizes(coupon_sizes(diameter, ordered))
    check_folder(folder)
    solids = make_coupon(diameter, ordered)
    parts = {name: PrintPart.from_solid(name, solid, (0, 0, 1)) for name, solid in solids.items()}
    data = {
        "cord": printing.cord,
        "process": printing.process,
        "clearances": ordered,
        "grooves": [diameter + c for c in ordered],
        "sockets": [PEG_DIAMETER_MM + c for c in ordered],
        "peg": PEG_DIAMETER_MM,
    }
    return write_prints(folder, parts, data, COUPON_FILE)


def write_specimen(
    folder: Path,
    options: SpecimenOptions = _DEFAULT_SPECIMEN,
    printing: PrintOptions = _DEFAULT_PRINTING,
    progress: Progress = silent,
) -> PrintFiles:
    """Write STL and STEP files of the specimen and its jigs, and `specimen.json`.

    There are the specimen's halves, a jig for each radius and a flat one, as they are on the bed.
    `specimen.json` contains the strain of each cord on each jig.

    Args:
        folder: Folder for the files.
        options: Sizes of the specimen and the jigs.
        printing: The cord and the process.
        progress: Called with the progress.

    Returns:
        The files.

    Raises:
        FabricationError: A part is not possible, or too large for the bed.
        StorageError: A file cannot be written.
    """
    from ...geometry.specimen.specimen import Specimen, make_halves

    diameter, printer = cord_diameter(printing.cord), Printer.from_name(printing.process)
    radii, offset = options.radii, options.offset
    check_radii(radii)
    channel = diameter + printer.clearance
    offset, warnings = choose_offset(offset, channel, printer)
    specimen = Specimen(
        options.length, options.thickness, options.width, offset, channel, printer.clearance
    )
    check_folder(folder)
    jigs = make_jigs(specimen, sorted(radii), progress)
    parts = {
        name: PrintPart.from_solid(name, solid, _UP.get(name, _SIDE_UP))
        for name, solid in make_halves(specimen).items()
    } | jigs
    printer.check_sizes({name: part.size for name, part in parts.items()})
    data = describe_specimen(specimen, sorted(radii), warnings) | {
        "cord": printing.cord,
        "process": printing.process,
    }
    return write_prints(folder, parts, data, SPECIMEN_FILE)


def choose_offset(offset: float | None, height: float, printer: Printer) -> tuple[float, list[str]]:
    """Return the distance of the outer cords or traces from bottom and top.

    Args:
        offset: The requested distance, mm; None for one that is safe.
        height: Height of the channels or traces, mm.
        printer: The printer of the specimen.

    Returns:
        The distance (mm), and a warning if it leaves too little skin.
    """
    # Cords fill their channels and are glued along their whole length: two lines around them
    # suffice, and the paper's specimen has no more.
    min_skin = printer.inner_wall
    safe = float(np.ceil(10 * (min_skin + height / 2 - _ROUNDING_MM)) / 10)
    if offset is None:
        return max(CORD_OFFSET_MM, safe), []
    skin = offset - height / 2
    if skin >= min_skin - _ROUNDING_MM:
        return offset, []
    return offset, [
        f"the skin over the outer cords is {skin:.2f} mm thick, less than two lines of"
        f" {printer.name} ({min_skin:.2f} mm), and may break; an offset of {safe:.1f} mm is enough"
    ]


def make_jigs(
    specimen: Specimen, radii: Sequence[float], progress: Progress
) -> dict[str, PrintPart]:
    """Return the flat jig and those of the radii (mm) by name."""
    from ...geometry.specimen.jig import make_jig

    jigs = {}
    for n, radius in enumerate([None, *radii]):
        name = "jig-flat" if radius is None else f"jig-{radius:g}"
        progress("jigs", n / (len(radii) + 1), name)
        jigs[name] = PrintPart.from_solid(name, make_jig(specimen, radius), _SIDE_UP)
    progress("jigs", 1.0, "done")
    return jigs


def check_radii(radii: Sequence[float]) -> None:
    """Check that the radii (mm) of jigs are positive and different.

    Raises:
        FabricationError: They are not.
    """
    are_positive = all(np.isfinite(r) and r > 0 for r in radii)
    if not radii or not are_positive or len({f"{r:g}" for r in radii}) < len(radii):
        raise FabricationError(
            f"the radii {', '.join(f'{r:g}' for r in radii) or 'none'} are not valid",
            code="radii-invalid",
            where="jigs",
            action="Give different radii above zero, in mm",
        )


def describe_specimen(
    specimen: Specimen, radii: Sequence[float], warnings: list[str]
) -> dict[str, Any]:
    """Return the content of `specimen.json`.

    Args:
        specimen: The specimen.
        radii: Radii of the jigs' surfaces, mm.
        warnings: Warnings about the sizes.
    """
    jigs: list[dict[str, Any]] = [
        {"name": "jig-flat", "radius": None, "neutral_radius": None, "strains": [0.0] * 3}
    ]
    for r in radii:
        strains = [specimen.strain(r, z) for z in specimen.heights]
        neutral = r + specimen.thickness / 2
        jigs.append(
            {"name": f"jig-{r:g}", "radius": r, "neutral_radius": neutral, "strains": strains}
        )
    return {
        "length": specimen.length,
        "thickness": specimen.thickness,
        "width": specimen.width,
        "offset": specimen.offset,
        "channel_diameter": specimen.channel_diameter,
        "channels": dict(zip(("inner", "neutral", "outer"), specimen.heights, strict=True)),
        "jigs": jigs,
        "warnings": warnings,
    }


@dataclass(frozen=True)
class PrintPart:
    """A part to print.

    Attributes:
        surface: Its facets, as it is on the bed, mm.
        solid: Its TopoDS_Solid, as it was modeled; None if it has only facets.
    """

    surface: Surface
    solid: Any = None

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
        kind: "print", or "cast" where it prints moulds.
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
    """Write an STL and a STEP file of every part with a solid, and last a JSON file.

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

    records = []
    for name, part in parts.items():
        step = {} if part.solid is None else {"step": f"{name}.step"}
        records.append({"name": name, "stl": f"{name}.stl", **step, "size": part.size})
    data = {"schema": 1, "unit": "mm", **data, "parts": records}
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, part in parts.items():
            write_stl(part.surface, folder / f"{name}.stl")
            if part.solid is not None:
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
