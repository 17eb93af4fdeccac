"""Requests that add, change and delete regions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ....core.arrays import Float
from ....core.device.regions import Shape
from ....core.errors import DeviceError, LayoutError
from ....workflow.design.region_points import fit_box
from ....workflow.view import Client, Request
from ...edits.edit import Edit, combine, free_name
from ...edits.pose_loads import finite
from ...edits.poses import remove_region, rename_region, set_box, shift_region
from ...edits.regions import set_shape
from ...messages import pose_edits as messages
from ...session.device_session import DeviceSession
from ...session.step import Handler
from .grips import shift_shape
from .pose_records import default_shape, make_shape

_COPY_SHIFT = 0.05  # of a copy from its original, times the body's size
_MAX_DECIMALS_MM = 1


class RegionRequests:
    """Handles requests about regions.

    Args:
        session: The device.
        points: Returns the points (v, 3) mm of the meshed surface; none without a mesh.
    """

    def __init__(self, session: DeviceSession, points: Callable[[], Float]) -> None:
        self._session, self._points = session, points

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        """The requests that this object handles."""
        return {
            messages.AddRegion: self._add,
            messages.SetRegion: self._set,
            messages.FitRegion: self._fit,
            messages.ConvertRegion: self._convert,
            messages.ShiftRegion: self._shift,
            messages.DuplicateRegion: self._duplicate,
            messages.RenameRegion: self._rename,
            messages.DeleteRegions: self._delete,
        }

    def _add(self, _: Client, request: messages.AddRegion) -> messages.RegionResult:
        if request.points is not None:
            shape = make_shape(request.shape, request.points, request.radius)
        else:
            points = self._points()
            if not len(points) and self._session.surface is not None:
                points = self._session.surface.vertices
            if not len(points):
                raise LayoutError(
                    "there is no body yet", code="no-body", action="Make the body first"
                )
            shape = default_shape(request.shape, points.min(axis=0), points.max(axis=0))
        return self._write(self._free_name("region"), shape, is_new=True)

    def _set(self, _: Client, request: messages.SetRegion) -> messages.RegionResult:
        shape = make_shape(request.shape, request.points, request.radius)
        return self._write(request.region, shape)

    def _fit(self, _: Client, request: messages.FitRegion) -> messages.RegionResult:
        corners = [finite(c, 3, "a corner") for c in (request.low, request.high)]
        box = fit_box(np.array(corners), self._session.size)
        name = request.region or self._free_name("region")
        self._session.apply(set_box(name, box.low, box.high))
        return self._result(name, box)

    def _convert(self, _: Client, request: messages.ConvertRegion) -> messages.RegionResult:
        points = self._points()
        inside = self._shape(request.region).contains(points)
        if not inside.any():
            raise DeviceError(
                "holds no surface point to fit a box to",
                code="region-empty",
                where=f"region {request.region!r}",
                action="Move it",
            )
        box = fit_box(points[inside], self._session.size)
        self._session.apply(set_box(request.region, box.low, box.high))
        return self._result(request.region, box)

    def _shift(self, _: Client, request: messages.ShiftRegion) -> None:
        by = np.round(finite(request.by, 3, "the movement"), _MAX_DECIMALS_MM)
        if by.any():
            self._session.apply(shift_region(request.region, by))

    def _duplicate(self, _: Client, request: messages.DuplicateRegion) -> messages.RegionResult:
        shift = np.array([0.0, 0.0, round(_COPY_SHIFT * self._session.size, _MAX_DECIMALS_MM)])
        shape = shift_shape(self._shape(request.region), shift)
        return self._write(self._free_name(request.region), shape, is_new=True)

    def _rename(self, _: Client, request: messages.RenameRegion) -> None:
        name = request.name.strip()
        if not name or not name.isprintable():
            raise DeviceError(
                f"{name!r} cannot be the name of a region",
                code="name-invalid",
                action="Use one line of letters",
            )
        if name != request.region:
            self._session.apply(rename_region(request.region, name))

    def _delete(self, _: Client, request: messages.DeleteRegions) -> None:
        listed = ", ".join(f"`{name}`" for name in request.regions)
        edits: Sequence[Edit] = [remove_region(name) for name in request.regions]
        self._session.apply(combine(f"delete {listed}", edits))

    def _write(self, name: str, shape: Shape, *, is_new: bool = False) -> messages.RegionResult:
        self._session.apply(set_shape(name, shape, is_new=is_new))
        return self._result(name, shape)

    def _result(self, name: str, shape: Shape) -> messages.RegionResult:
        return messages.RegionResult(name=name, count=int(shape.contains(self._points()).sum()))

    def _shape(self, name: str) -> Shape:
        regions = self._session.device.regions
        if name not in regions:
            raise DeviceError(
                f"there is no region {name!r} any more", code="not-in-device", name=name
            )
        return regions[name]

    def _free_name(self, name: str) -> str:
        return free_name(name, self._session.device.regions)
