"""What a view shows of a device besides its frames."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.arrays import Float, Int


@dataclass(frozen=True)
class ViewedDevice:
    """The surface at rest: `vertices` (v, 3) mm and `faces` (f, 3); none where only markers are
    known. `cords` by name, each (p, 3) mm at rest. Of the c `channels`, signals in training were
    from `low` (c,) to `high` (c,); marker intervals were usually `radius` mm wide."""

    name: str
    vertices: Float | None
    faces: Int | None
    channels: tuple[str, ...]
    cords: tuple[Float, ...]
    cord_radius: float
    low: Float
    high: Float
    radius: float
