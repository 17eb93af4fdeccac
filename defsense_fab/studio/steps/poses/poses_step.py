"""The step Poses: the user defines regions and poses, and the body follows."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Literal

import numpy as np

from ....core.arrays import Float
from ....core.errors import DefsenseError, DeviceError, LayoutError
from ....core.mesh import Surface
from ....workflow.design.body_fit import skin_points
from ....workflow.design.pose_preview import PosePreview, load_preview
from ....workflow.design.pose_ramp import load_state_shape
from ....workflow.view import Arrays, Client, Request
from ...background.latest_worker import LatestWorker
from ...edits.edit import combine
from ...edits.pose_loads import finite
from ...edits.poses import pose_edits
from ...messages import poses as messages
from ...session.body_arrays import surface_arrays
from ...session.device_session import DeviceSession
from ...session.step import Handler, Step
from .grips import move_grip
from .pictures import PictureWork
from .pose_queue import SolverTask
from .pose_records import pose_states, region_states
from .pose_requests import PoseRequests
from .proposals import Proposals
from .region_requests import RegionRequests
from .shapes import ShapeWork
from .simulated_states import simulated_states

_EDGE_ANGLE_DEGREES = 45.0  # of drawn edges; round bodies are meshed with many smaller ones
_NO_POINTS: Float = np.zeros((0, 3))


class PosesStep(Step):
    """Edits regions and poses, and solves poses while they are changed.

    Args:
        session: The device.

    Attributes:
        surface: The meshed body at rest, or None without a mesh.
        shapes: The shapes that browsers show.
        pictures: The small pictures of the poses.
        proposals: Poses that are proposed.
    """

    def __init__(self, session: DeviceSession) -> None:
        super().__init__(session)
        self.surface: Surface | None = None
        self._mesh = ""  # key of the mesh that `surface` belongs to
        self._warnings: dict[str, messages.PoseWarning] = {}
        self.shapes = ShapeWork(
            session, self._follow_solved, self._follow_warning, self._follow_surface
        )
        self.pictures = PictureWork(session, self.shapes.queue)
        self.proposals = Proposals(session, lambda: self.points)
        self._regions = RegionRequests(session, lambda: self.points)
        self._poses = PoseRequests(session, lambda: self.points)
        self._loader = LatestWorker[str](self._load, session.show_error)
        self._lock = threading.Lock()  # an earlier state is never published after a later one
        self._published: messages.PosesState | None = None
        self._published_states: messages.SimulatedStates | None = None

    @property
    def points(self) -> Float:
        """Points (v, 3) mm of the meshed surface at rest; none without a mesh."""
        return _NO_POINTS if self.surface is None else self.surface.vertices

    @property
    def newest_points(self) -> Float:
        """Points (v, 3) mm of the newest body's surface, which need not be meshed."""
        surface = self.session.newest_surface
        if surface is None or (self.surface is not None and self.session.preview is None):
            return self.points
        return skin_points(surface)

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {
            **self._regions.handlers,
            **self._poses.handlers,
            **self.proposals.handlers,
            messages.ShowPose: self._show,
            messages.HidePose: lambda client, _: self.shapes.hide(client),
            messages.StopSolving: lambda client, _: self.shapes.queue.cancel(client),
            messages.MoveGrip: self._move_grip,
            messages.FollowRamp: self._follow_ramp,
            messages.StateShape: self._state_shape,
        }

    def on_device_changed(self) -> None:
        self._publish()
        self._publish_states()
        self.shapes.follow_device()
        self.pictures.follow_device()

    def on_build_loaded(self) -> None:
        self._loader.give(self._mesh_key())
        self._publish_states()

    def on_body_changed(self) -> None:
        self._warnings = {}  # of an earlier body
        self._publish()

    def on_freshness(self) -> None:
        self._publish()
        self._publish_states()

    def disconnect(self, client: Client) -> None:
        self.shapes.hide(client)

    def poll(self) -> None:
        self.pictures.refresh()

    def wait(self, timeout_s: float) -> bool:
        """Wait until the body is loaded and all shapes are solved; return False after a time."""
        return self._loader.wait(timeout_s) and self.shapes.wait(timeout_s)

    def close(self) -> None:
        self._loader.close()
        self.shapes.close()

    # The meshed body

    def _mesh_key(self) -> str:
        try:
            return repr(self.session.results.mesh_record)
        except (DefsenseError, OSError):
            return ""

    def _load(self, key: str) -> None:
        """Load the mesh of the last build, on the thread of the loader."""
        if key == self._mesh and (self.surface is not None or not key):
            self._publish()
            return
        preview: PosePreview | None = None
        try:
            preview = load_preview(self.session.device)
        except (DefsenseError, OSError):  # not meshed yet, or a build replaces the mesh
            key = ""
        self._mesh = key
        self.surface = None if preview is None else preview.surface
        self._warnings = {}
        self._publish_body()
        self.shapes.use(preview)
        self.pictures.use(has_body=preview is not None)
        self.proposals.follow_mesh()
        self._publish()
        self.pictures.refresh()

    def _follow_surface(self, surface: Surface) -> None:
        """Take the body after regions have changed; called on the thread of the solver."""
        if self.surface is not None:
            self.surface = surface
            self._publish_body()
            self._publish()

    # Events

    def _publish_body(self) -> None:
        arrays = {} if self.surface is None else surface_arrays(self.surface, _EDGE_ANGLE_DEGREES)
        self.session.server.publish_arrays(Arrays(name="pose-body", arrays=arrays))

    def _publish(self) -> None:
        session = self.session
        with self._lock:
            points = self.newest_points
            size = float(np.ptp(points, axis=0).max()) if len(points) else session.size
            state = messages.PosesState(
                mesh=self._mesh_state(),
                size=size,
                regions=region_states(session.device, points),
                poses=pose_states(session.device, points, self._warnings),
            )
            if state != self._published:
                self._published = state
                session.server.publish(state)

    def _mesh_state(self) -> Literal["missing", "old", "current"]:
        if self.surface is None:
            return "missing"
        return "old" if self.session.freshness.get("body") == "old" else "current"

    def _publish_states(self) -> None:
        session = self.session
        with self._lock:
            is_current = session.freshness.get("simulate") == "current"
            states = simulated_states(session.results, session.device, is_current=is_current)
            if states != self._published_states:
                self._published_states = states
                session.server.publish(states)

    def _follow_solved(self, digest: str, moved: Float) -> None:
        self.pictures.take(digest, moved)

    def _follow_warning(self, digest: str, warning: messages.PoseWarning | None) -> None:
        if warning is None:
            self._warnings.pop(digest, None)
        else:
            self._warnings[digest] = warning
        self._publish()

    # Requests

    def _show(self, client: Client, request: messages.ShowPose) -> None:
        self._require_mesh()
        self._poses.pose(request.pose)
        if not 0 < request.share <= 1:
            raise DeviceError(
                f"the share {request.share:g} of a pose is not in (0, 1]", code="invalid-share"
            )
        self.shapes.show(client, request.pose, request.share)

    def _move_grip(self, client: Client, request: messages.MoveGrip) -> None:
        self._require_mesh()
        pose = self._poses.pose(request.pose)
        grip = request.region or f"pull/{request.pull}"
        position = finite(request.position, 3, "the position")
        rotation = finite(request.rotation, 3, "the rotation")
        moved = move_grip(pose, self.session.device, self.points, grip, position, rotation)
        if not request.write:
            self.shapes.drag(client, moved)
            return
        edits = pose_edits(pose, moved)
        if edits:
            name = edits[0].name if len(edits) == 1 else f"move `{request.region}` in `{pose.name}`"
            self.session.apply(combine(name, edits))
        self.shapes.end_drag(client)  # unless the change has started it

    def _follow_ramp(self, client: Client, request: messages.FollowRamp) -> Arrays:
        self._require_mesh()
        is_current = self.session.freshness.get("simulate") == "current"
        return self.shapes.ramp(client, self._poses.pose(request.pose), is_current)

    def _state_shape(self, client: Client, request: messages.StateShape) -> Arrays:
        self._require_mesh()
        session = self.session
        names = {state.state for state in session.results.field_index.states}
        if request.state not in names:
            raise LayoutError(
                f"the state {request.state!r} is not simulated",
                code="unknown-state",
                action="Simulate the poses",
            )
        folder = session.results.folder
        task = SolverTask(lambda preview, _: load_state_shape(folder, preview, request.state))
        self.shapes.queue.give(("state", client), task)
        moved = task.result()
        if moved is None:
            raise LayoutError(
                "the state belongs to another mesh",
                code="other-mesh",
                action="Simulate the poses again",
            )
        arrays = {"moved": moved.astype(np.float32)}
        return Arrays(name="state-shape", arrays=arrays, facts={"state": request.state})

    def _require_mesh(self) -> None:
        if self.surface is None:
            raise LayoutError(
                "the body has no mesh yet", code="not-meshed", action="Mesh the body first"
            )
