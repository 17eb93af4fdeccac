"""Regions, poses and drawn cords as Python values, and their tables in `device.toml`.

A `Pose` here holds the keys of `[[poses]]` as a user writes them, with degrees, defaults and
"free". Its table is read like a file, so that values from Python get the same checks and messages.
The result is `core.device.device.Pose`, which the solver takes: vectors in rad and mm.
"""

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

S = TypeVar("S", bound=Shape)


def box(low: ArrayLike, high: ArrayLike) -> Box:
    """Return the box between two corners, parallel to the axes.

    Args:
        low: Corner (3,) mm with the lower coordinates.
        high: Opposite corner (3,) mm, higher in x, y and z.

    Raises:
        DeviceError: A corner is not 3 finite numbers, or the box is empty.
    """
    return _validate_shape(Box(_point("low", low), _point("high", high)))


def sphere(center: ArrayLike, radius: float) -> Sphere:
    """Return a ball.

    Args:
        center: Center (3,) mm.
        radius: Radius above 0, mm.

    Raises:
        DeviceError: A value is invalid.
    """
    return Sphere(_point("center", center), number(radius, "radius", above=0))


def half_space(origin: ArrayLike, normal: ArrayLike) -> HalfSpace:
    """Return the space on one side of a plane.

    Args:
        origin: A point (3,) mm of the plane.
        normal: Direction (3,) from the plane into the half-space, of any length above 0.

    Raises:
        DeviceError: A value is invalid.
    """
    return _validate_shape(HalfSpace(_point("origin", origin), _point("normal", normal)))


def cylinder(start: ArrayLike, end: ArrayLike, radius: float) -> Cylinder:
    """Return the cylinder about the line between two points.

    Args:
        start: Center (3,) mm of one end.
        end: Center (3,) mm of the other end; it must differ from `start`.
        radius: Radius above 0, mm.

    Raises:
        DeviceError: A value is invalid.
    """
    ends = _point("start", start), _point("end", end)
    return _validate_shape(Cylinder(*ends, number(radius, "radius", above=0)))


def region_tables(regions: object) -> dict[str, Any]:
    """Return regions as in the table `[regions]`.

    Args:
        regions: Shapes by name.

    Raises:
        DeviceError: They are not shapes by name.
    """
    if not isinstance(regions, Mapping):
        raise DeviceError(
            f"must be a dict of shapes by name, not {shown(regions)}",
            code="not-a-dict",
            where="regions",
            action='Write them as in {"base": box(low, high)}',
            argument="regions",
        )
    for name in regions:
        if not isinstance(name, str) or not name.strip():
            raise DeviceError(
                f"names must be text that is not empty, not {shown(name)}",
                code="not-a-name",
                where="regions",
                argument="regions",
            )
    return {name: _region_table(name, shape) for name, shape in regions.items()}


def _region_table(name: str, shape: object) -> dict[str, Any]:
    if isinstance(shape, Box):
        return {"box": [shape.low.tolist(), shape.high.tolist()]}
    kinds: dict[type, str] = {Sphere: "sphere", HalfSpace: "half_space", Cylinder: "cylinder"}
    if type(shape) not in kinds:
        raise DeviceError(
            f"must be a box, sphere, half-space or cylinder, not {shown(shape)}",
            code="wrong-kind",
            where=f"regions.{name}",
            action="Use box, sphere, half_space or cylinder",
            argument=f"regions.{name}",
        )
    return {kinds[type(shape)]: {k: np.asarray(v).tolist() for k, v in vars(shape).items()}}


def _validate_shape(shape: S) -> S:
    if problem := shape_problem(shape):
        name, text = problem
        raise DeviceError(text, code="shape-empty", where=name, argument=name)
    return shape


def _point(name: str, values: ArrayLike) -> Float:
    point = array(values, name)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise DeviceError(
            f"must be 3 finite numbers, not {values!r}",
            code="not-a-point",
            where=name,
            argument=name,
        )
    return point


Free = Literal["free"]


class _Row:
    """Values of a row of `device.toml`, with the names of its keys."""

    def __post_init__(self) -> None:
        """Check the name of the row, or of its region."""
        for key in ("name", "region"):
            if hasattr(self, key):
                of_kind(getattr(self, key), key, str)

    def table(self) -> dict[str, Any]:
        """Return the row as in `device.toml`.

        Raises:
            DeviceError: A value has no form in `device.toml`.
        """
        return {key: plain(value, key) for key, value in vars(self).items()}


@dataclass(frozen=True)
class Handle(_Row):
    """A region that is moved as a rigid body.

    Components that are "free" take the value at which nothing acts against them: `degrees` of a
    hinge about `axis`, `axis` of a region that may turn in any way, and `translate` or each of its
    three components.

    Attributes:
        region: Name of the region.
        axis: Axis of the rotation (3,), or "free".
        degrees: Angle of the rotation, degrees, or "free".
        translate: Translation (3,) mm; it or any of its components may be "free".
        about: Point (3,) mm on the axis; None: the center of the region.
    """

    region: str
    axis: ArrayLike | Free = (0.0, 0.0, 1.0)
    degrees: float | Free = 0.0
    translate: ArrayLike | Free | Sequence[float | Free] = (0.0, 0.0, 0.0)
    about: ArrayLike | None = None

    def table(self) -> dict[str, Any]:
        """Return the handle as in `[[poses.handles]]`.

        Raises:
            DeviceError: A value has no form in `device.toml`, or the axis is free and an angle or
                a point is given.
        """
        return {
            "region": self.region,
            "rotate": self._rotate(),
            "translate": plain(self.translate, "translate"),
        }

    def _rotate(self) -> object:
        if isinstance(self.axis, str):
            if self.degrees != 0.0 or self.about is not None:
                raise DeviceError(
                    "has a free axis, and also degrees or a point about which it turns",
                    code="axis-contradictory",
                    where=f"handle of {self.region!r}",
                    action="Give an axis (3,) with degrees and about",
                    region=self.region,
                )
            return self.axis
        rotate = {"axis": plain(self.axis, "axis"), "degrees": plain(self.degrees, "degrees")}
        if self.about is not None:
            rotate["about"] = plain(self.about, "about")
        return rotate


@dataclass(frozen=True)
class Symmetry(_Row):
    """A flat region whose points stay in its plane.

    Attributes:
        region: Name of the region.
        normal: Normal of the plane (3,).
    """

    region: str
    normal: ArrayLike


@dataclass(frozen=True)
class Drag(_Row):
    """A spring that pulls a point of the body.

    Attributes:
        at: The point (3,) mm at rest.
        by: Displacement (3,) mm of the spring's other end.
        stiffness: Stiffness of the spring, N/mm.
    """

    at: ArrayLike
    by: ArrayLike
    stiffness: float = 1.0


@dataclass(frozen=True)
class Pressure(_Row):
    """A pressure on the surface in a region, perpendicular to the deformed surface.

    Attributes:
        region: Name of the region.
        value: Pressure, MPa; positive pushes inwards.
    """

    region: str
    value: float


@dataclass(frozen=True)
class Pose(_Row):
    """A deformation that the device must sense.

    Attributes:
        name: Name of the pose.
        fixed: Names of the regions that do not move.
        handles: Regions that are moved.
        symmetry: Planes of symmetry.
        drags: Springs that pull points.
        pressures: Pressures on the surface.
        gravity: Acceleration (3,) in multiples of g; None: without gravity.
    """

    name: str
    fixed: Sequence[str] = ()
    handles: Sequence[Handle] = ()
    symmetry: Sequence[Symmetry] = ()
    drags: Sequence[Drag] = ()
    pressures: Sequence[Pressure] = ()
    gravity: ArrayLike | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        each_of(self.fixed, "fixed", str)
        each_of(self.handles, "handles", Handle)
        each_of(self.symmetry, "symmetry", Symmetry)
        each_of(self.drags, "drags", Drag)
        each_of(self.pressures, "pressures", Pressure)

    def table(self) -> dict[str, Any]:
        """Return the pose as in `[[poses]]`.

        Raises:
            DeviceError: A value has no form in `device.toml`.
        """
        lists = {k: getattr(self, k) for k in ("handles", "symmetry", "drags", "pressures")}
        table: dict[str, Any] = {"name": self.name, "fixed": plain(self.fixed, "fixed")}
        table |= {k: [item.table() for item in items] for k, items in lists.items() if len(items)}
        if self.gravity is not None:
            table["gravity"] = plain(self.gravity, "gravity")
        return table


@dataclass(frozen=True)
class DrawnCord(_Row):
    """The path of a cord as it is drawn in a plane.

    Attributes:
        name: Name of the cord.
        control_points: Points of the path (k >= 4, 2) mm in the plane.
        origin: Origin of the plane (3,) mm.
        normal: Normal of the plane (3,).
        x_axis: First axis (3,) of the plane.
        free: What the optimizer may change: the "path", the "plane", or only the "offset" of the
            plane along its normal. An empty sequence locks the cord.
        tangents: Tangents (k, 2) mm at the points; None: Catmull-Rom tangents.
    """

    name: str
    control_points: ArrayLike
    origin: ArrayLike
    normal: ArrayLike
    x_axis: ArrayLike
    free: Sequence[str] = ("path", "plane")
    tangents: ArrayLike | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        each_of(self.free, "free", str)

    def table(self) -> dict[str, Any]:
        """Return the cord as in `[[sensors]]`.

        Raises:
            DeviceError: A value has no form in `device.toml`.
        """
        table = {
            "name": self.name,
            "plane": {k: plain(getattr(self, k), k) for k in ("origin", "normal", "x_axis")},
            "control_points": plain(self.control_points, "control_points"),
            "free": plain(self.free, "free"),
        }
        if self.tangents is not None:
            table["tangents"] = plain(self.tangents, "tangents")
        return table
