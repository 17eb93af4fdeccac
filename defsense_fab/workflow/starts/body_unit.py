"""The unit of a body's file: as it is said, or as its size tells; what is doubtful is asked."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.errors import BodyError, DeviceError
from ...geometry.bodies.body import SIZE_RANGE_MM
from .dropped_body import DroppedBody
from .units import UNIT_WORDS, unit_name


def body_unit(
    found: DroppedBody, units: str | None, written: str, ask: Callable[[], str] | None = None
) -> str:
    """The unit of the file's lengths: `units`, where they are given; where nothing but its size
    tells, and that is doubtful, what `ask` returns. `written` is how a user gives units, as in
    "--units {}". Raises DeviceError where nobody can be asked, and for a unit that there is not;
    BodyError where no device can be of that size."""
    unit = found.unit
    if units is not None:
        unit = unit_name(units)
        if found.key != "mesh" and unit != "mm":
            raise DeviceError(
                f"{written.format(units)}: is for meshes; a STEP file says its unit, and a script"
                " gives mm"
            )
    elif found.doubtful and ask is not None:
        unit = ask()
    elif found.doubtful:
        if unit == found.own:
            raise DeviceError(
                f"units: in {UNIT_WORDS[unit]} the body is {found.told_size(unit)}, unusual for a"
                f" soft device: give {written.format(unit)} if it is so large, or another"
            )
        raise DeviceError(
            f"units: in {UNIT_WORDS[found.own]} the body would be {found.told_size(found.own)};"
            f" in {UNIT_WORDS[unit]} it is {found.told_size(unit)}: give {written.format(unit)}, or"
            " another"
        )
    check_unit(found, unit)
    return unit


def check_unit(found: DroppedBody, unit: str) -> None:
    """Raises BodyError for a body that is no device of mm."""
    size = float(np.linalg.norm(found.size(unit)))
    if not SIZE_RANGE_MM[0] <= size <= SIZE_RANGE_MM[1]:
        units = (
            f"its lengths are no {UNIT_WORDS[unit]}: choose another unit"
            if found.key == "mesh"
            else "export it again in its right unit"
        )
        raise BodyError(f"{found.name}: would be {size:,.3f} mm across; {units}")
