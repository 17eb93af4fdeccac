"""Poses proposed from the body's vibration modes, searched for in the background."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ....core.arrays import Float
from ....core.errors import DeviceError, LayoutError
from ....workflow.study.propose_poses import PoseSearch
from ....workflow.view import Arrays, Client, Request
from ...messages import poses as messages
from ...messages.pose_edits import AddProposed, PoseResult
from ...session.device_session import DeviceSession
from ...session.job_strip import Work
from ...session.step import Handler
from .pose_search import add_proposed, search_poses


class Proposals:
    """Searches for poses, and adds those that the user chooses.

    Args:
        session: The device.
        points: Returns the points (v, 3) mm of the meshed surface; none without a mesh.
    """

    def __init__(self, session: DeviceSession, points: Callable[[], Float]) -> None:
        self._session, self._points = session, points
        self._search: PoseSearch | None = None
        self._held = ""

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        """The requests that this object handles."""
        return {
            messages.ProposePoses: lambda _, request: self.propose(request.held),
            AddProposed: self._add,
        }

    def propose(self, held: str) -> None:
        """Search in the background for poses of the body that a region holds.

        Raises:
            DefsenseError: There is no such region, or another job is running.
        """
        if held not in self._session.device.regions:
            raise DeviceError(
                "choose the region that holds the body",
                code="unknown-region",
                action="Add a region first",
            )
        # The mesh may have to be made again, by the script.
        if not self._session.may_run_script(lambda: self.propose(held)):
            return
        self._session.jobs.start(
            Work(
                name="search for poses",
                title="Propose poses",
                job=search_poses,
                arguments=(self._session.project.folder, held),
                on_item=lambda item: self.show(item[1], item[0]),
                on_end=lambda *_: self._session.load(),  # the search may have made the mesh
            )
        )

    def show(self, search: PoseSearch | None, held: str = "") -> None:
        """Publish the poses of a search, or none.

        Args:
            search: The search.
            held: Region that held the body.
        """
        self._search, self._held = search, held
        server = self._session.server
        poses = () if search is None else search.poses
        server.publish(
            messages.ProposedPoses(
                held=held,
                poses=[
                    messages.ProposedPose(name=p.name, frequency=p.mode.frequency) for p in poses
                ],
                notes=[] if search is None else list(search.notes),
            )
        )
        shapes = list[Float]()
        if search is not None:
            shapes = [search.shape(pose)[search.surface_nodes] for pose in poses]
        count = len(self._points())
        server.publish_arrays(
            Arrays(
                name="proposed-poses",
                arrays={
                    str(k): np.asarray(shape, np.float32)
                    for k, shape in enumerate(shapes)
                    if len(shape) == count
                },
                facts={"poses": [pose.name for pose in poses]},
            )
        )

    def follow_mesh(self) -> None:
        """Publish the poses again for another mesh, or none if they belong to an earlier one."""
        search = self._search
        if search is None or len(search.surface_nodes) != len(self._points()):
            self.show(None)
        else:
            self.show(search, self._held)

    def _add(self, _: Client, request: AddProposed) -> PoseResult:
        search = self._search
        chosen = [] if search is None else [p for p in search.poses if p.name in request.poses]
        if search is None or not chosen:
            raise LayoutError(
                "these poses are not proposed any more",
                code="no-pose-chosen",
                action="Propose poses again",
            )
        taken = [pose.name for pose in self._session.device.poses]
        names, edit = add_proposed(search, chosen, self._held, taken, has_states=request.has_states)
        self._session.apply(edit)
        return PoseResult(name=names[0])
