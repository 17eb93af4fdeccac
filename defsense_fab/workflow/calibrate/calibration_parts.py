"""Files of the bending specimen and its jigs, and the strains that they give."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import FabricationError
from ...core.progress import Progress, silent
from ...core.response import JIG_RADII_MM
from ...core.storage.files import check_folder
from .print_files import Print, Printer, PrintFiles, cord_diameter, write_prints

if TYPE_CHECKING:
    from ...geometry.specimen.specimen import Specimen

FILE = "specimen.json"
_ROUNDING = 1e-6  # mm

#: Of the outer cords from bottom and top, mm: the paper's.
OFFSET = 2.0
#: What points up on the bed: jigs lie on their side, halves on their outer one.
UP = {"specimen-right": (0, -1, 0)}


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
    """Write STL (as they lie on the bed) and STEP files of the specimen's halves, a jig for each
    radius and a flat one, and `specimen.json` with the strain of each cord on each of them. All mm.
    Without an `offset` the outer cords lie 2 mm from bottom and top, as in the paper, or as much
    more as leaves the process its two lines of skin.

    Raises FabricationError for parts that cannot be or that the process's bed does not hold,
    and StorageError for a folder that takes no files.
    """
    from ...geometry.specimen.specimen import Specimen, halves, jig

    diameter, printer = cord_diameter(cord), Printer.named(process)
    clearance = printer.clearance
    good = all(np.isfinite(r) and r > 0 for r in radii)
    if not radii or not good or len({f"{r:g}" for r in radii}) < len(radii):
        raise FabricationError("jigs: give different radii above zero, in mm")
    # The cords fill their channels and are glued to them all along: two lines suffice around them,
    # and the paper's specimen has no more.
    channel, least = diameter + clearance, printer.inner_wall
    enough = float(np.ceil(10 * (least + channel / 2 - _ROUNDING)) / 10)
    if offset is None:
        offset = max(OFFSET, enough)
    spec = Specimen(length, thickness, width, offset, channel, clearance)
    check_folder(folder)
    solids: dict[str, Any] = {}
    for n, radius in enumerate([None, *sorted(radii)]):
        name = "jig-flat" if radius is None else f"jig-{radius:g}"
        progress("jigs", n / (len(radii) + 1), name)
        solids[name] = jig(spec, radius)
    progress("jigs", 1.0, "done")
    solids = halves(spec) | solids
    prints = {n: Print.of(n, solid, UP.get(n, (0, 1, 0))) for n, solid in solids.items()}
    printer.check({n: one.size for n, one in prints.items()})
    warnings = []
    skin = offset - channel / 2
    if skin < least - _ROUNDING:
        warnings.append(
            f"the outer channels leave a skin of {skin:.2f} mm, less than the {least:.2f} mm of two"
            f" lines of {process}, and may break through; --offset {enough:.1f} leaves them"
        )
    data = _describe(spec, sorted(radii), warnings) | {"cord": cord, "process": process}
    return write_prints(folder, prints, data, FILE)


def _describe(spec: Specimen, radii: Sequence[float], warnings: list[str]) -> dict[str, Any]:
    jigs: list[dict[str, Any]] = [
        {"name": "jig-flat", "radius": None, "neutral_radius": None, "strains": [0.0] * 3}
    ]
    for r in radii:
        strains = [spec.strain(r, z) for z in spec.heights]
        neutral = r + spec.thickness / 2
        jigs.append(
            {"name": f"jig-{r:g}", "radius": r, "neutral_radius": neutral, "strains": strains}
        )
    return {
        "length": spec.length,
        "thickness": spec.thickness,
        "width": spec.width,
        "offset": spec.offset,
        "channel_diameter": spec.channel_diameter,
        "channels": dict(zip(("inner", "neutral", "outer"), spec.heights, strict=True)),
        "jigs": jigs,
        "warnings": warnings,
    }
