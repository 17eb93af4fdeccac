"""Poses and drawn cords as Python values, and as they stand in device.toml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float
from ..core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere, shape_problem
from ..core.errors import DeviceError
from .arguments import array, each_of, number, of_kind, plain, shown

# Named parts of a body, in mm in its rest frame, and as they stand in device.toml.

S = TypeVar("S", bound=Shape)


def box(low: ArrayLike, high: ArrayLike) -> Box:
    """The box between two corners (3,) mm, parallel to the axes, the first of which is lower than
    the second in x, y and z. Raises DeviceError."""
    return _checked(Box(_point("low", low), _point("high", high)))


def sphere(center: ArrayLike, radius: float) -> Sphere:
    """The ball of a radius (mm) above 0 around a point (3,) mm. Raises DeviceError."""
    return Sphere(_point("center", center), number(radius, "radius", above=0))


def half_space(origin: ArrayLike, normal: ArrayLike) -> HalfSpace:
    """What lies beyond the plane through `origin` (3,) mm, where `normal` (3,) points to, of any
    length above 0. Raises DeviceError."""
    return _checked(HalfSpace(_point("origin", origin), _point("normal", normal)))


def cylinder(start: ArrayLike, end: ArrayLike, radius: float) -> Cylinder:
    """The cylinder of a radius (mm) above 0 about the line between two points (3,) mm that differ.
    Raises DeviceError."""
    ends = _point("start", start), _point("end", end)
    return _checked(Cylinder(*ends, number(radius, "radius", above=0)))


def region_tables(regions: object) -> dict[str, Any]:
    """As in the table `[regions]`. Raises DeviceError for what are no shapes by name."""
    if not isinstance(regions, Mapping):
        raise DeviceError(
            f'regions: must be a dict of shapes by name, as in {{"base": box(low, high)}}, not'
            f" {shown(regions)}"
        )
    for name in regions:
        if not isinstance(name, str) or not name.strip():
            raise DeviceError(f"regions: names must be text that is not empty, not {shown(name)}")
    return {name: _table(name, shape) for name, shape in regions.items()}


def _table(name: str, shape: object) -> dict[str, Any]:
    if isinstance(shape, Box):
        return {"box": [shape.low.tolist(), shape.high.tolist()]}
    kinds: dict[type, str] = {Sphere: "sphere", HalfSpace: "half_space", Cylinder: "cylinder"}
    if type(shape) not in kinds:
        raise DeviceError(
            f"regions.{name}: must be made by box, sphere, half_space or cylinder, not"
            f" {shown(shape)}"
        )
    return {kinds[type(shape)]: {k: np.asarray(v).tolist() for k, v in vars(shape).items()}}


def _checked(shape: S) -> S:
    if wrong := shape_problem(shape):
        raise DeviceError(": ".join(wrong))
    return shape


def _point(name: str, values: ArrayLike) -> Float:
    point = array(values, name)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise DeviceError(f"{name}: must be 3 finite numbers, not {values!r}")
    return point


Free = Literal["free"]


@dataclass(frozen=True)
class Handle:
    """A `region` that is moved rigidly: turned by `degrees` about `axis` (3,) through the point
    `about` (3,) mm (None: the region's centre), and moved by `translate` (3,) mm.

    What is "free" goes to where nothing acts against it: `degrees` of a hinge with that axis,
    `axis` of a region that turns in any way, `translate` or each of its three components.
    """

    region: str
    axis: ArrayLike | Free = (0.0, 0.0, 1.0)
    degrees: float | Free = 0.0
    translate: ArrayLike | Free | Sequence[float | Free] = (0.0, 0.0, 0.0)
    about: ArrayLike | None = None

    def __post_init__(self) -> None:
        of_kind(self.region, "region", str)

    def table(self) -> dict[str, Any]:
        """As in `[[poses.handles]]`. Raises DeviceError for what says two things at once."""
        return {
            "region": self.region,
            "rotate": self._rotate(),
            "translate": plain(self.translate, "translate"),
        }

    def _rotate(self) -> object:
        if isinstance(self.axis, str):
            if self.degrees != 0.0 or self.about is not None:
                raise DeviceError(
                    f"handle of {self.region!r}: has a free axis, and degrees or a point about"
                    " which it turns; give an axis (3,) with these"
                )
            return self.axis
        rotate = {"axis": plain(self.axis, "axis"), "degrees": plain(self.degrees, "degrees")}
        if self.about is not None:
            rotate["about"] = plain(self.about, "about")
        return rotate


@dataclass(frozen=True)
class Symmetry:
    """A flat `region` whose points stay in its plane, of this `normal` (3,)."""

    region: str
    normal: ArrayLike

    def __post_init__(self) -> None:
        of_kind(self.region, "region", str)

    def table(self) -> dict[str, Any]:
        """As in `symmetry`."""
        return {"region": self.region, "normal": plain(self.normal, "normal")}


@dataclass(frozen=True)
class Drag:
    """A spring of so much `stiffness` (N/mm) that pulls the point `at` (3,) mm by (3,) mm `by`."""

    at: ArrayLike
    by: ArrayLike
    stiffness: float = 1.0

    def table(self) -> dict[str, Any]:
        """As in `drags`."""
        return {k: plain(getattr(self, k), k) for k in ("at", "by", "stiffness")}


@dataclass(frozen=True)
class Pressure:
    """A pressure of `value` MPa on the surface in a `region`, which it follows; positive pushes
    inwards."""

    region: str
    value: float

    def __post_init__(self) -> None:
        of_kind(self.region, "region", str)

    def table(self) -> dict[str, Any]:
        """As in `pressures`."""
        return {"region": self.region, "value": plain(self.value, "value")}


@dataclass(frozen=True)
class Pose:
    """A deformation that the device is to sense: regions by name that are `fixed`, `handles` that
    are moved, planes of `symmetry`, points that `drags` pull, `pressures`, and `gravity` (3,) in
    multiples of g (None: none)."""

    name: str
    fixed: Sequence[str] = ()
    handles: Sequence[Handle] = ()
    symmetry: Sequence[Symmetry] = ()
    drags: Sequence[Drag] = ()
    pressures: Sequence[Pressure] = ()
    gravity: ArrayLike | None = None

    def __post_init__(self) -> None:
        of_kind(self.name, "name", str)
        each_of(self.fixed, "fixed", str)
        each_of(self.handles, "handles", Handle)
        each_of(self.symmetry, "symmetry", Symmetry)
        each_of(self.drags, "drags", Drag)
        each_of(self.pressures, "pressures", Pressure)

    def table(self) -> dict[str, Any]:
        """As in `[[poses]]`."""
        parts = {k: getattr(self, k) for k in ("handles", "symmetry", "drags", "pressures")}
        table: dict[str, Any] = {"name": self.name, "fixed": plain(self.fixed, "fixed")}
        table |= {k: [each.table() for each in some] for k, some in parts.items() if len(some)}
        if self.gravity is not None:
            table["gravity"] = plain(self.gravity, "gravity")
        return table


@dataclass(frozen=True)
class DrawnCord:
    """A cord's path as it is drawn: `control_points` (k >= 4, 2) mm in the plane through `origin`
    (3,) mm with this `normal` (3,) and `x_axis` (3,), and what the optimiser may change of it: its
    "path", its "plane", or the plane's "offset" alone; nothing: the cord stays. `tangents` (k, 2)
    mm at the points are those of Catmull and Rom where none are given."""

    name: str
    control_points: ArrayLike
    origin: ArrayLike
    normal: ArrayLike
    x_axis: ArrayLike
    free: Sequence[str] = ("path", "plane")
    tangents: ArrayLike | None = None

    def __post_init__(self) -> None:
        of_kind(self.name, "name", str)
        each_of(self.free, "free", str)

    def table(self) -> dict[str, Any]:
        """As in `[[sensors]]`."""
        table = {
            "name": self.name,
            "plane": {k: plain(getattr(self, k), k) for k in ("origin", "normal", "x_axis")},
            "control_points": plain(self.control_points, "control_points"),
            "free": plain(self.free, "free"),
        }
        if self.tangents is not None:
            table["tangents"] = plain(self.tangents, "tangents")
        return table
