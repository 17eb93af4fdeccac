"""Files of the fit coupon."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...core.errors import FabricationError
from ...core.storage.files import check_folder
from .print_files import Print, Printer, PrintFiles, cord_diameter, write_prints

FILE = "coupon.json"
#: What is said of a process that casts its parts.
NO_MOULD = (
    "casts parts in printed moulds, and the coupon has no mould: what a printed coupon shows does"
    " not hold for cast grooves. Cast the smallest part of the device first, lay cord into its"
    " groove and push a pin into its socket, and give [fabrication] clearance what they lack"
)
CLEARANCES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)


def write_coupon(
    folder: Path,
    *,
    clearances: Sequence[float] = CLEARANCES,
    cord: str = "rubber-2mm",
    process: str = "fdm-tpu",
) -> PrintFiles:
    """Write STL and STEP files of the coupon's plate and peg, and `coupon.json`. Clearances are on
    the diameter, mm.

    Raises FabricationError for clearances that cannot be, a process that casts its parts, or a bed
    that does not hold the plate, and StorageError for a folder that takes no files.
    """
    from ...geometry.specimen.coupon import PEG, coupon, sizes

    if not all(np.isfinite(c) for c in clearances) or len(set(clearances)) < len(clearances):
        raise FabricationError("coupon: give different clearances in mm")
    diameter, printer = cord_diameter(cord), Printer.named(process)
    if printer.kind == "cast":
        raise FabricationError(f"coupon: {process} {NO_MOULD}")
    ordered = sorted(clearances)
    printer.check(sizes(diameter, ordered))
    check_folder(folder)
    solids = coupon(diameter, ordered)
    prints = {name: Print.of(name, solid, (0, 0, 1)) for name, solid in solids.items()}
    data = {
        "cord": cord,
        "process": process,
        "clearances": ordered,
        "grooves": [diameter + c for c in ordered],
        "sockets": [PEG + c for c in ordered],
        "peg": PEG,
    }
    return write_prints(folder, prints, data, FILE)
