"""Write the files of calibration parts: the fit coupon, and the bending specimen with its jigs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import FabricationError
from ...core.progress import Progress, silent
from ...core.response import JIG_RADII_MM
from ...core.storage.files import check_folder
from .print_files import Printer, PrintFiles, PrintPart, cord_diameter, write_prints

if TYPE_CHECKING:
    from ...geometry.specimen.specimen import Specimen

COUPON_FILE, SPECIMEN_FILE = "coupon.json", "specimen.json"
#: Explanation for processes that cast their parts.
NO_MOULD = (
    "casts parts in printed molds, and the coupon has no mold: the clearance of a printed coupon"
    " does not hold for cast grooves. Cast the smallest part of the device first, insert cord into"
    " its groove and a pin into its socket, and set [fabrication] clearance accordingly"
)
CLEARANCES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)  # on the diameter, mm
#: Distance of the outer cords from bottom and top in the paper, mm.
OFFSET = 2.0
_ROUNDING_MM = 1e-6
#: Directions that point up on the bed: jigs are on their side, halves on their outer side.
_UP = {"specimen-right": (0, -1, 0)}


def write_coupon(
    folder: Path,
    *,
    clearances: Sequence[float] = CLEARANCES,
    cord: str = "rubber-2mm",
    process: str = "fdm-tpu",
) -> PrintFiles:
    """Write STL and STEP files of the coupon's plate and peg, and `coupon.json`.

    Args:
        folder: Folder for the files.
        clearances: Clearances on the diameter, mm.
        cord: A row of `cords.csv`, or the cord's diameter in mm.
        process: A row of `printers.csv`.

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
            code="bad-clearances",
            where="coupon",
            action="Give different clearances in mm",
        )
    diameter, printer = cord_diameter(cord), Printer.from_name(process)
    if printer.kind == "cast":
        raise FabricationError(
            f"{process} {NO_MOULD}", code="process-casts", where="coupon", process=process
        )
    ordered = sorted(clearances)
    printer.check_sizes(coupon_sizes(diameter, ordered))
    check_folder(folder)
    solids = make_coupon(diameter, ordered)
    parts = {name: PrintPart.from_solid(name, solid, (0, 0, 1)) for name, solid in solids.items()}
    data = {
        "cord": cord,
        "process": process,
        "clearances": ordered,
        "grooves": [diameter + c for c in ordered],
        "sockets": [PEG_DIAMETER_MM + c for c in ordered],
        "peg": PEG_DIAMETER_MM,
    }
    return write_prints(folder, parts, data, COUPON_FILE)


def write_specimen(
    folder: Path,
    *,
    length: float = 150.0,
    thickness: float = 15.0,
    width: float = 20.0,
    offset: float | None = None,
    radii: Sequence[float] = JIG_RADII_MM,
    cord: str = "rubber-2mm",
    process: str = "fdm-tpu",
    progress: Progress = silent,
) -> PrintFiles:
    """Write STL and STEP files of the specimen and its jigs, and `specimen.json`.

    There are the specimen's halves, a jig for each radius and a flat one, as they are on the bed.
    `specimen.json` contains the strain of each cord on each jig.

    Args:
        folder: Folder for the files.
        length: Length of the specimen, mm.
        thickness: Thickness of the specimen, mm.
        width: Width of the specimen, mm.
        offset: Distance of the outer cords from bottom and top, mm. By default 2 mm, as in the
            paper, or as much more as leaves two lines of skin by the process.
        radii: Radii of the jigs, mm.
        cord: A row of `cords.csv`, or the cord's diameter in mm.
        process: A row of `printers.csv`.
        progress: Called with the progress.

    Returns:
        The files.

    Raises:
        FabricationError: A part is not possible, or too large for the bed.
        StorageError: A file cannot be written.
    """
    from ...geometry.specimen.jig import make_jig
    from ...geometry.specimen.specimen import Specimen, make_halves

    diameter, printer = cord_diameter(cord), Printer.from_name(process)
    _check_radii(radii)
    # The cords fill their channels and are glued along their whole length: two lines around them
    # suffice, and the paper's specimen has no more.
    channel, min_skin = diameter + printer.clearance, printer.inner_wall
    safe_offset = float(np.ceil(10 * (min_skin + channel / 2 - _ROUNDING_MM)) / 10)
    if offset is None:
        offset = max(OFFSET, safe_offset)
    specimen = Specimen(length, thickness, width, offset, channel, printer.clearance)
    check_folder(folder)
    solids: dict[str, Any] = {}
    for n, radius in enumerate([None, *sorted(radii)]):
        name = "jig-flat" if radius is None else f"jig-{radius:g}"
        progress("jigs", n / (len(radii) + 1), name)
        solids[name] = make_jig(specimen, radius)
    progress("jigs", 1.0, "done")
    solids = make_halves(specimen) | solids
    parts = {
        name: PrintPart.from_solid(name, solid, _UP.get(name, (0, 1, 0)))
        for name, solid in solids.items()
    }
    printer.check_sizes({name: part.size for name, part in parts.items()})
    warnings = []
    skin = offset - channel / 2
    if skin < min_skin - _ROUNDING_MM:
        warnings.append(
            f"the skin over the outer channels is {skin:.2f} mm thick, less than two lines of"
            f" {process} ({min_skin:.2f} mm), and may break; an offset of {safe_offset:.1f} mm is"
            " enough"
        )
    data = _describe(specimen, sorted(radii), warnings) | {"cord": cord, "process": process}
    return write_prints(folder, parts, data, SPECIMEN_FILE)


def _check_radii(radii: Sequence[float]) -> None:
    are_positive = all(np.isfinite(r) and r > 0 for r in radii)
    if not radii or not are_positive or len({f"{r:g}" for r in radii}) < len(radii):
        raise FabricationError(
            f"the radii {', '.join(f'{r:g}' for r in radii) or 'none'} are not valid",
            code="bad-radii",
            where="jigs",
            action="Give different radii above zero, in mm",
        )


def _describe(specimen: Specimen, radii: Sequence[float], warnings: list[str]) -> dict[str, Any]:
    """Return the content of `specimen.json`."""
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
