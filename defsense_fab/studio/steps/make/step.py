"""The step Make: build the parts, follow their assembly, and export everything."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace

from ....core.errors import DefsenseError, StorageError
from ....core.storage.files import read_regular
from ....workflow.build.build import first_outdated
from ....workflow.build.export import describe_changes, export, export_name
from ....workflow.build.recorded_options import recorded_options
from ....workflow.build.results import parts_digest
from ....workflow.fabrication.assembly_guide import AssemblyGuide, assembly_guide
from ....workflow.view import Arrays, Client, Download, Problem, Request
from ...background.background_job import CANCELLED
from ...background.latest_worker import LatestWorker
from ...messages import make as messages
from ...session.built_cords import built_cords
from ...session.device_session import DeviceSession
from ...session.step import Handler, Step
from ..optimize.ghost_cords import are_same
from .assembly_ticks import AssemblyTicks
from .build_state import BuildState
from .guide_content import (
    FILES_PATH,
    build_files,
    guide_state,
    made_file,
    part_meshes,
    parts_state,
)
from .state_texts import make_state

_DOWNLOADS = FILES_PATH.removeprefix("files/")
_NO_PARTS = messages.Parts(id="", parts=[])


class MakeStep(Step):
    """Publishes the parts, the guide, and which device they belong to.

    Args:
        session: The device.

    Attributes:
        guide: The assembly guide of the last build, or None.
        state: What was published last, or None.
    """

    def __init__(self, session: DeviceSession) -> None:
        super().__init__(session)
        self.guide: AssemblyGuide | None = None
        self.state: messages.MakeState | None = None
        self._identifier = ""
        self._lock = threading.Lock()
        self._ticks = AssemblyTicks(session.project.folder)
        self._export_name = ""  # of the zip that was written last
        self._reader = LatestWorker[None](self._read_build, session.show_error)
        self._checker = LatestWorker[None](self._check, session.show_error)

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {
            messages.PartMeshes: self._part_meshes,
            messages.TickStage: self._tick,
            messages.ExportDevice: self._export,
        }

    def on_device_changed(self) -> None:
        self._checker.give(None)

    def on_build_loaded(self) -> None:
        self._reader.give(None)

    def wait(self, timeout_s: float) -> bool:
        """Wait until all is published; return False after a time."""
        return self._reader.wait(timeout_s) and self._checker.wait(timeout_s)

    def close(self) -> None:
        self._reader.close()
        self._checker.close()

    def download(self, path: str) -> Download | None:
        """Return a file of the build or the zip; no other file of the folder is sent."""
        if not path.startswith(_DOWNLOADS):
            return None
        name, session = path.removeprefix(_DOWNLOADS), self.session
        folder = session.results.folder
        if name and name == self._export_name:
            file = session.device.source / name
        elif self.guide is not None and any(
            made.path == FILES_PATH + name for made in build_files(self.guide, folder)
        ):
            file = folder / name
        else:
            return None
        try:
            inside = session.device.source.resolve()
            if not file.resolve().is_relative_to(inside):  # a folder from elsewhere has links
                return None
            return Download(file.name, read_regular(file))
        except OSError:  # another build replaces it
            return None

    # Requests

    def _part_meshes(self, _: Client, __: messages.PartMeshes) -> Arrays:
        with self._lock:
            guide, identifier = self.guide, self._identifier
        if guide is None:
            raise StorageError("no parts are built", code="not-built", action="Build the parts")
        return part_meshes(guide, identifier)

    def _tick(self, _: Client, request: messages.TickStage) -> None:
        self._ticks.tick(request.stage, is_done=request.is_done)
        self._publish_progress()

    def _export(self, _: Client, __: messages.ExportDevice) -> messages.ExportResult:
        device = self.session.device
        path = device.source / export_name(device)
        names = export(device, path)
        self._export_name = path.name
        return messages.ExportResult(file=made_file("Export", path, path.name), count=len(names))

    # Published states, on the threads of the workers

    def _read_build(self, _: None) -> None:
        session = self.session
        device, build = session.device, session.results
        guide, identifier = None, ""
        try:
            if build.has_parts:
                identifier = parts_digest(build)
                guide = assembly_guide(device, build)
        except (DefsenseError, OSError) as error:
            session.show_error(error)
        with self._lock:
            self.guide, self._identifier = guide, identifier if guide is not None else ""
        server = session.server
        if guide is None:
            server.publish(_NO_PARTS)
            server.publish(_empty_guide())
        else:
            server.publish(parts_state(guide, identifier))
            server.publish(
                guide_state(device, guide, identifier, build.folder, self.session.cord_colors())
            )
        self._publish_progress()
        self._checker.give(None)

    def _publish_progress(self) -> None:
        self.session.server.publish(messages.AssemblyProgress(done=self._ticks.done))

    def _check(self, _: None) -> None:
        session = self.session
        device, folder = session.device, session.results.folder
        stage = first_outdated(device)
        error = session.build_error
        if error is not None and error.code == CANCELLED:
            error = None
        cords = built_cords(session.results)
        if cords is not None and any(
            are_same(cords.sensors, taken) for taken in session.taken_layouts
        ):
            cords = replace(cords, is_moved=True)  # by the search that found them
        state = BuildState(
            is_built=self.guide is not None,
            outdated_stage=None if stage is None else stage.title,
            error=None if error is None else str(error),
            changes="" if stage is None else describe_changes(device, folder),
            options="" if stage is not None else str(recorded_options(device, folder)),
            noun=device.cord.noun,
            cords=cords,
            are_cords_drawn=cords is None or are_same(cords.sensors, device.sensors),
        )
        problem = None if error is None else Problem.of(error)
        self.state = make_state(state, self._build_obstacle(), problem)
        session.server.publish(self.state)

    def _build_obstacle(self) -> str:
        device = self.session.device
        if not device.poses:
            return "Add a pose first"
        if not device.sensors and not device.propose:
            return f"Add a {device.cord.noun} first"
        return ""


def _empty_guide() -> messages.Guide:
    return messages.Guide(
        id="",
        cord_radius=1.0,
        wire_radius=1.0,
        cords=[],
        stages=[],
        lists=[],
        checks=None,
        notes=[],
        files=[],
    )
