"""Poses and drawn cords as Python values, and as they stand in device.toml."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import DeviceError


@dataclass(frozen=True)
class Handle:
    """A `region` that is moved rigidly: turned by `degrees` about `axis` (3,) through the point
    `about` (3,) mm (None: the region's centre), and moved by `translate` (3,) mm, or to where no
    force acts on it ("free")."""

    region: str
    axis: ArrayLike = (0.0, 0.0, 1.0)
    degrees: float = 0.0
    translate: ArrayLike | Literal["free"] = (0.0, 0.0, 0.0)
    about: ArrayLike | None = None

    def table(self) -> dict[str, Any]:
        """As in `[[poses.handles]]`."""
        rotate = {"axis": plain(self.axis), "degrees": plain(self.degrees)}
        if self.about is not None:
            rotate["about"] = plain(self.about)
        free = isinstance(self.translate, str)
        return {
            "region": self.region,
            "rotate": rotate,
            "translate": self.translate if free else plain(self.translate),
        }


@dataclass(frozen=True)
class Pose:
    """A deformation that the device is to sense: regions by name that are `fixed`, and `handles`
    that are moved."""

    name: str
    fixed: Sequence[str]
    handles: Sequence[Handle]

    def table(self) -> dict[str, Any]:
        """As in `[[poses]]`."""
        return {
            "name": self.name,
            "fixed": list(self.fixed),
            "handles": [h.table() for h in self.handles],
        }


@dataclass(frozen=True)
class DrawnCord:
    """A cord's path as it is drawn: `control_points` (k >= 4, 2) mm in the plane through `origin`
    (3,) mm with this `normal` (3,) and `x_axis` (3,), and what the optimiser may change of it: its
    "path", its "plane", or the plane's "offset" alone; nothing: the cord stays."""

    name: str
    control_points: ArrayLike
    origin: ArrayLike
    normal: ArrayLike
    x_axis: ArrayLike
    free: Sequence[str] = ("path", "plane")

    def table(self) -> dict[str, Any]:
        """As in `[[sensors]]`."""
        plane = {k: plain(getattr(self, k)) for k in ("origin", "normal", "x_axis")}
        return {
            "name": self.name,
            "plane": plane,
            "control_points": plain(self.control_points),
            "free": list(self.free),
        }


def plain(values: ArrayLike) -> Any:
    """Numbers and lists of them, whatever kind of array they came in. Raises DeviceError for
    what is neither."""
    try:
        return np.asarray(values).tolist()
    except ValueError:
        raise DeviceError(f"{values!r}: give numbers, or an array of them") from None
