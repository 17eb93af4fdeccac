"""Shapes of all poses for their small pictures: simulated, or solved while nothing else is."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Device, Pose
from ....core.errors import DefsenseError
from ....workflow.design.pose_preview import PosePreview
from ....workflow.design.pose_ramp import load_state_shape
from ....workflow.view import Arrays
from ...messages.poses import PosePictures
from ...session.device_session import DeviceSession
from .pose_queue import BACKGROUND, PoseQueue, SolverTask
from .pose_records import pose_digest

_MAX_EARLIER_SHAPES = 32  # of poses as they were, for undo


class PictureWork:
    """Computes and publishes a displaced surface for each pose.

    Args:
        session: The device.
        queue: The solver, which works for pictures when no browser waits.
    """

    def __init__(self, session: DeviceSession, queue: PoseQueue) -> None:
        self._session, self._queue = session, queue
        self._shapes: dict[str, Float] = {}  # displacements (v, 3) mm by digest
        self._failed: set[str] = set()
        self._has_body = False
        self._task: SolverTask[None] | None = None
        self._published: tuple[tuple[str, str, int], ...] | None = None

    def use(self, *, has_body: bool) -> None:
        """Forget the shapes, which belong to another mesh."""
        self._shapes, self._failed = {}, set()
        self._has_body = has_body
        self._publish()

    def take(self, digest: str, moved: Float) -> None:
        """Use a shape that was solved for a browser."""
        self._shapes[digest] = moved
        device = self._session.device
        drop_oldest(self._shapes, {pose_digest(pose, device) for pose in device.poses})
        self._publish()

    def follow_device(self) -> None:
        """Publish the pictures of the present poses, and compute those that are missing."""
        self._publish()
        self.refresh()

    def refresh(self) -> None:
        """Compute missing shapes in the background; call it again later."""
        is_waiting = self._task is not None
        if is_waiting or not self._has_body or not self._missing(self._session.device):
            return
        if self._queue.work.is_preparing or not self._queue.is_idle:
            return  # the next call comes within a second
        self._task = SolverTask(self._compute)
        self._session.server.publish(PosePictures(is_computing=True))
        self._queue.give(BACKGROUND, self._task)

    def _missing(self, device: Device) -> list[tuple[str, Pose]]:
        digests = [(pose_digest(pose, device), pose) for pose in device.poses]
        return [(d, p) for d, p in digests if d not in self._shapes and d not in self._failed]

    def _compute(self, preview: PosePreview, should_stop: Callable[[], bool]) -> None:
        device = self._session.device
        is_simulated = self._session.freshness.get("simulate") == "current"
        try:
            preview.take(device)
            for digest, pose in self._missing(device):
                if should_stop():
                    return
                moved = self._simulated(preview, pose) if is_simulated else None
                if moved is None:
                    moved = _solve(preview, pose, should_stop)
                if moved is not None:
                    self._shapes[digest] = moved
                    self._publish()
                elif not should_stop():
                    self._failed.add(digest)
        finally:
            self._task = None
            self._session.server.publish(PosePictures(is_computing=False))

    def _simulated(self, preview: PosePreview, pose: Pose) -> Float | None:
        """Return the simulated shape of a pose at its largest level, displacements (v, 3) mm."""
        results = self._session.results
        try:
            states = [s for s in results.field_index.states if set(s.weights) == {pose.name}]
            if not states:
                return None
            largest = max(states, key=lambda state: state.weights[pose.name])
            return load_state_shape(results.folder, preview, largest.state)
        except (DefsenseError, OSError):  # a build replaces it
            return None

    def _publish(self) -> None:
        device = self._session.device
        entries = [(pose.name, pose_digest(pose, device)) for pose in device.poses]
        known = [(n, d, self._shapes[d]) for n, d in entries if d in self._shapes]
        key = tuple((name, digest, id(shape)) for name, digest, shape in known)
        if key == self._published:
            return
        self._published = key
        self._session.server.publish_arrays(
            Arrays(
                name="pose-pictures",
                arrays={str(k): shape.astype(np.float32) for k, (*_, shape) in enumerate(known)},
                facts={"poses": [n for n, *_ in known], "digests": [d for _, d, _ in known]},
            )
        )


def drop_oldest(shapes: dict[str, Float], needed: Collection[str]) -> None:
    """Remove the oldest shapes, except those that are needed: each edit of a pose adds one."""
    others = [digest for digest in tuple(shapes) if digest not in needed]
    for digest in others[:-_MAX_EARLIER_SHAPES]:
        shapes.pop(digest, None)


def _solve(preview: PosePreview, pose: Pose, should_stop: Callable[[], bool]) -> Float | None:
    """Return a quick shape of a pose, displacements (v, 3) mm, or None."""
    coarse = list[Float]()
    try:
        fine = preview.edit(
            pose,
            1.0,
            coarse.append,
            should_stop,
            (lambda: True) if preview.has_coarse else None,
            check=False,
            from_rest=True,
        )
    except DefsenseError:  # shown once the pose is chosen
        return None
    if coarse:
        return coarse[0]
    if fine.moved is None and not fine.is_cancelled:
        return None
    if fine.moved is None and not should_stop():  # the mesh is too coarse for the regions
        fine = preview.edit(pose, 1.0, None, should_stop, check=False, from_rest=True)
    return fine.moved
