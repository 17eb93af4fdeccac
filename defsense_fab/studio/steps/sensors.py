"""The step Sensors: the user draws cords and drags their points; the expected error follows."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.curve import Hermite, catmull_rom, is_smooth
from ...core.device.device import Sensor
from ...core.device.sensor_tables import new_sensor_names
from ...core.errors import DefsenseError, DeviceError, LayoutError
from ...workflow.design.body_fit import check_cords
from ...workflow.design.draw_cord import Snapper, fit_stroke, plane_section
from ...workflow.design.repair_cords import repair_cords, smooth_cord
from ...workflow.view import Client, Request
from ..background.latest_worker import LatestWorker
from ..edits import cords as edits
from ..edits.edit import Edit
from ..messages import sensors as messages
from ..session.built_cords import built_cords
from ..session.computed_edit import REPAIR_S, EditBasis
from ..session.cord_check import CordCheck
from ..session.cord_states import path_points, plane_of, rounded
from ..session.device_session import DeviceSession
from ..session.pipeline import LimitState
from ..session.step import Handler, Step
from .judgement import describe_check, describe_layout, judge, simulated_judge
from .optimize.ghost_cords import are_same

_NOT_SIMULATED = "Simulate the poses to see the expected error"
_OTHER_BODY = "The body has changed: simulate the poses again to see the expected error"
_SMOOTH_S = 10.0  # in which a smooth path is found; the edits of a browser wait for it
_SNAP_DISTANCE = 0.01  # times the body's size
_SHIFT = 0.04  # of a copy from its original, times the body's size
_SNAP_TEXTS = {"surface": "surface", "middle": "middle of the body"}

Cords = tuple[Sensor, ...]


class SensorsStep(Step):
    """Edits cords, and predicts their error.

    Args:
        session: The device.
        check: Makes the drawn cords on trial.
        on_limits: Called with what is known of the limits of the drawn cords.

    Attributes:
        prediction: What was published last, or None.
    """

    def __init__(
        self, session: DeviceSession, check: CordCheck, on_limits: Callable[[LimitState], None]
    ) -> None:
        super().__init__(session)
        self._cord_check, self._on_limits = check, on_limits
        check.on_result.append(self._publish_again)
        self._last: tuple[Cords, dict[str, Any]] | None = None
        self._publishing = threading.RLock()
        self.prediction: messages.Prediction | None = None
        self._worker = LatestWorker[Cords](self._judge_drawn, session.show_error)
        self._snapper: tuple[object, Snapper] | None = None

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {
            messages.DragPoint: self._drag_point,
            messages.DragTangent: self._drag_tangent,
            messages.DragPlane: self._drag_plane,
            messages.InsertPoint: lambda _, r: self._apply(
                edits.insert_point(r.cord, r.before, np.array(r.at, float))
            ),
            messages.DeletePoint: lambda _, r: self._apply(edits.delete_point(r.cord, r.index)),
            messages.SmoothCord: self._smooth,
            messages.RepairCords: self._repair,
            messages.RenameCord: lambda _, r: self._apply(
                edits.rename_cord(r.cord, r.name.strip())
            ),
            messages.DeleteCords: lambda _, r: self._apply(_delete(r.cords)),
            messages.SetFreedoms: lambda _, r: self._apply(edits.set_freedoms(r.cord, r.free)),
            messages.DuplicateCord: self._duplicate,
            messages.MirrorCord: self._mirror,
            messages.AddStraight: self._add_straight,
            messages.OutlineOf: self._outline,
            messages.AddStroke: self._add_stroke,
            messages.CompareCords: self._compare,
        }

    def on_device_changed(self) -> None:
        self._snapper = None
        self._worker.give(self.session.device.sensors)

    def on_build_loaded(self) -> None:
        self._worker.give(self.session.device.sensors)

    def on_body_changed(self) -> None:
        self.on_device_changed()

    def wait(self, timeout_s: float) -> bool:
        """Wait until the prediction is up to date; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def close(self) -> None:
        self._worker.close()

    # Drags

    def _drag_point(self, _: Client, request: messages.DragPoint) -> messages.DragResult:
        sensor = self._cord(request.cord)
        target = np.array(request.to, float)
        _check_point(sensor, request.index, target)
        snapped_to = ""
        if request.snap and sensor.curve.is_planar and self.session.newest_surface is not None:
            snap = self._snapper_for(sensor).snap(target)
            target = snap.point
            snapped_to = _SNAP_TEXTS.get(snap.target or "", snap.cord)
        moved = with_point(sensor, request.index, target)
        if request.write:
            self._apply(
                edits.move_point(sensor.name, request.index, moved.curve.points[request.index])
            )
        return self._judge_drag(moved, snapped_to)

    def _drag_tangent(self, _: Client, request: messages.DragTangent) -> messages.DragResult:
        sensor = self._cord(request.cord)
        target = np.array(request.to, float)
        _check_point(sensor, request.index, target)
        tangents = sensor.curve.tangents.copy()
        tangents[request.index] = target
        moved = replace(sensor, curve=Hermite(sensor.curve.points, tangents))
        if request.write:
            self._apply(edits.bend_at(sensor.name, request.index, moved.curve))
        return self._judge_drag(moved)

    def _drag_plane(self, _: Client, request: messages.DragPlane) -> messages.DragResult:
        sensor = self._cord(request.cord)
        moved = replace(sensor, plane=plane_of(request.origin, request.axes))
        if request.write:
            self._apply(edits.set_plane(sensor.name, moved.plane))
        return self._judge_drag(moved)

    def _judge_drag(self, sensor: Sensor, snapped_to: str = "") -> messages.DragResult:
        cords = tuple(sensor if s.name == sensor.name else s for s in self.session.device.sensors)
        judgement, problem = self._check(cords), None
        if judgement is None and self.session.judge is not None:
            judgement, problem = judge(self.session.judge, cords, quick=True)
        return messages.DragResult(
            points=rounded(sensor.curve.points),
            tangents=rounded(sensor.curve.tangents),
            path=path_points(sensor),
            snapped_to=snapped_to,
            judgement=judgement,
            problem=problem,
        )

    def _snapper_for(self, sensor: Sensor) -> Snapper:
        surface = self.session.newest_surface
        assert surface is not None
        key = (surface, sensor.name)
        if self._snapper is None or self._snapper[0] != key:
            others = [s for s in self.session.device.sensors if s.name != sensor.name]
            distance = _SNAP_DISTANCE * self.session.size
            self._snapper = key, Snapper(surface, sensor.plane, others, distance)
        return self._snapper[1]

    # Edits

    def _apply(self, edit: Edit) -> None:
        self.session.apply(edit)

    def _smooth(self, client: Client, request: messages.SmoothCord) -> None:
        name, basis = self._cord(request.cord).name, EditBasis.of(self.session)
        check = basis.check_wanted(client)
        found = smooth_cord(basis.device, basis.surface, name, check, _SMOOTH_S)
        edit = edits.smooth(name, found.sensor if found.has_moved else None)
        basis.apply(edit, "Smooth it again")
        if found.has_moved:
            self.session.notify(f"{name}: control points moved, to keep the limits")

    def _repair(self, client: Client, request: messages.RepairCords) -> messages.RepairResult:
        self._vertices()
        basis = EditBasis.of(self.session)
        assert basis.surface is not None
        names = [self._cord(name).name for name in request.cords] or None
        check = basis.check_wanted(client)
        found = repair_cords(basis.device, basis.surface, names, check, REPAIR_S)
        edit = edits.repair([s for s in found.sensors if s.name in found.moves])
        basis.apply(edit, "Repair again")
        return messages.RepairResult(
            cords=list(found.moves),
            largest_move=max(found.moves.values()),
            remaining=[str(violation) for violation in found.remaining],
            is_complete=found.is_complete,
        )

    def _duplicate(self, _: Client, request: messages.DuplicateCord) -> messages.CordResult:
        sensor = self._cord(request.cord)
        shift = _SHIFT * self.session.size
        if sensor.curve.is_planar:
            plane = replace(sensor.plane, origin=sensor.plane.origin + shift * sensor.plane.normal)
            copy = replace(sensor, plane=plane)
        else:
            points = sensor.curve.points + np.array([0.0, 0.0, shift])
            copy = replace(sensor, curve=Hermite(points, sensor.curve.tangents))
        return self._add(replace(copy, name=self._new_name()))

    def _mirror(self, _: Client, request: messages.MirrorCord) -> messages.CordResult:
        sensor, vertices = self._cord(request.cord), self._vertices()
        middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        name = self._new_name()
        normal = np.eye(3)["xyz".index(request.axis)]
        self._apply(edits.mirror_cord(sensor.name, name, middle, normal))
        return messages.CordResult(name=name)

    def _add_straight(self, _: Client, __: messages.AddStraight) -> messages.CordResult:
        return self._add(simulated_judge(self.session).new_cord(self._new_name()))

    def _outline(self, _: Client, request: messages.OutlineOf) -> messages.PlaneOutline:
        plane, vertices = plane_of(request.origin, request.axes), self._vertices()
        assert self.session.newest_surface is not None
        local = (vertices - plane.origin) @ plane.axes
        return messages.PlaneOutline(
            segments=rounded(plane_section(self.session.newest_surface, plane)),
            low=rounded(local.min(axis=0)),
            high=rounded(local.max(axis=0)),
        )

    def _add_stroke(self, _: Client, request: messages.AddStroke) -> messages.CordResult:
        self._vertices()
        plane = plane_of(request.origin, request.axes)
        if any(len(point) != 2 for point in request.stroke):
            raise LayoutError("a point of a stroke needs two numbers", code="invalid-point")
        stroke = np.array(request.stroke, float).reshape(-1, 2)
        assert self.session.newest_surface is not None
        curve = fit_stroke(self.session.newest_surface, plane, stroke)
        if not request.replaces:
            cord = Sensor(self._new_name(), plane, curve, frozenset({"path"}))
            return self._add(cord)
        sensor = self._cord(request.replaces)
        if not (sensor.curve.is_planar and sensor.plane.coincides(plane)):
            raise LayoutError(
                f"the stroke is not in the plane of {sensor.name!r}",
                code="other-plane",
                action="Draw in the plane of the cord",
            )
        points = (plane.to_world(curve.points) - sensor.plane.origin) @ sensor.plane.axes
        tangents = curve.tangents @ plane.axes[:, :2].T @ sensor.plane.axes
        self._apply(edits.set_path(sensor.name, Hermite(points[:, :2], tangents[:, :2])))
        return messages.CordResult(name=sensor.name)

    def _compare(self, _: Client, request: messages.CompareCords) -> messages.Comparison:
        judge_, sensors = simulated_judge(self.session), self.session.device.sensors
        names = self._cord(request.first).name, self._cord(request.second).name
        judged = judge_.judge(sensors, quick=True)
        assert judged is not None  # there are two cords
        found = judge_.compare(sensors, judged, names)
        return messages.Comparison(
            names=list(found.names),
            errors_without=list(found.errors_without),
            error=found.error,
            largest_signals=list(found.largest_signals),
            correlation=found.correlation,
            is_redundant=found.is_redundant,
        )

    def _add(self, cord: Sensor) -> messages.CordResult:
        self._apply(edits.add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))
        return messages.CordResult(name=cord.name)

    def _new_name(self) -> str:
        return next(new_sensor_names(s.name for s in self.session.device.sensors))

    def _cord(self, name: str) -> Sensor:
        for sensor in self.session.device.sensors:
            if sensor.name == name:
                return sensor
        raise DeviceError(
            f"there is no cord {name!r} any more", code="not-in-device", table="sensor", name=name
        )

    def _vertices(self) -> Any:
        if self.session.newest_surface is None:
            raise LayoutError("there is no body yet", code="no-body", action="Make the body first")
        return self.session.newest_surface.vertices

    # Prediction, on the thread of the worker

    def _check(self, sensors: Cords) -> messages.Judgement | None:
        """Return the limits of cords in a body that is not simulated, or None if it is."""
        session = self.session
        surface = session.newest_surface
        if surface is None or (session.judge is not None and session.preview is None):
            return None
        try:
            check = check_cords(session.device, sensors, surface)
        except DefsenseError:  # shown once the device is built
            return None
        return describe_layout(sensors, None, check)

    def _judge_drawn(self, sensors: Cords) -> None:
        judge_ = self.session.judge
        if judge_ is None or self.session.preview is not None:
            text = _NOT_SIMULATED if judge_ is None else _OTHER_BODY
            self._cord_check.stop()
            self._publish(sensors, is_ready=False, text=text, drawn=self._check(sensors))
            return
        quick, problem = judge(judge_, sensors, quick=True)
        if not sensors or quick.violations or problem is not None:
            self._cord_check.stop()
        else:
            self._cord_check.request(sensors)
        self._publish(sensors, drawn=quick, drawn_problem=problem, is_computing=bool(sensors))
        if sensors and self._worker.pending is None:
            full, problem = judge(judge_, sensors, quick=False)
            self._publish(sensors, drawn=full, drawn_problem=problem)

    def _publish(self, sensors: Cords, **values: Any) -> None:
        with self._publishing:
            self._last = sensors, values
            built = built_cords(self.session.results)
            is_built = built is not None and are_same(built.sensors, sensors)
            drawn: messages.Judgement | None = values["drawn"]
            is_kept = drawn is not None and not drawn.violations and bool(sensors)
            check = messages.PartsCheck()
            if is_kept and values.get("is_ready", True):
                state, trial = self._cord_check.state(sensors), self._cord_check.result(sensors)
                check = describe_check(state, trial, built if is_built else None)
            defaults = {"is_ready": True, "text": "", "is_computing": False}
            self.prediction = messages.Prediction(
                check=check,
                built=None if built is None else built.error,
                is_built_drawn=is_built,
                has_built_parts=self.session.results.has_parts,
                **{**defaults, **values},
            )
            self.session.server.publish(self.prediction)
            self._report_limits(drawn, check)

    def _report_limits(self, drawn: messages.Judgement | None, check: messages.PartsCheck) -> None:
        violations = list(drawn.violations) if drawn is not None else []
        violations += [check.problem] if check.problem is not None else []
        cords = [name for violation in violations for name in violation.cords]
        self._on_limits(
            LimitState(
                is_broken=bool(violations),
                broken_cord="".join(cords[:1]),
                is_being_checked=check.state == "checking",
                is_check_aborted=check.state == "aborted",
            )
        )

    def _publish_again(self) -> None:
        """Publish the last judgement with the present result of the check."""
        with self._publishing:
            if self._last is not None:
                self._publish(self._last[0], **self._last[1])


def with_point(sensor: Sensor, index: int, point: Any) -> Sensor:
    """Return the cord with a control point moved to `point` (2,) or (3,) mm.

    Tangents that were computed from the points are computed again.
    """
    points, tangents = sensor.curve.points.copy(), sensor.curve.tangents
    points[index] = point
    if is_smooth(sensor.curve):
        tangents = catmull_rom(points)
    return replace(sensor, curve=Hermite(points, tangents))


def _check_point(sensor: Sensor, index: int, point: Any) -> None:
    count, size = sensor.curve.points.shape
    if not 0 <= index < count:
        raise DeviceError(
            f"{sensor.name!r} no longer has a control point {index + 1}; it has {count}",
            code="no-control-point",
            cord=sensor.name,
            number=index + 1,
            count=count,
        )
    if point.shape != (size,) or not np.isfinite(point).all():
        raise DeviceError(
            f"{sensor.name!r} needs {size} finite coordinates for a point",
            code="invalid-point",
            cord=sensor.name,
        )


def _delete(names: Sequence[str]) -> Edit:
    """Return the edit that deletes cords in one step."""
    parts = [edits.remove_cord(name) for name in names]

    def change(document: Any) -> None:
        for part in parts:
            part.change(document)

    listed = ", ".join(f"`{name}`" for name in names)
    return Edit(f"delete {listed}", change)
