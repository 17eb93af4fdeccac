"""Guided tasks of the step Measure: check the board, record the device, measure a specimen."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from ....core.errors import CalibrationError, CaptureError
from ....workflow.board.check import check_board
from ....workflow.board.options import CheckOptions
from ....workflow.calibrate.record_specimen import record_specimen
from ....workflow.sessions.options import RecordOptions
from ....workflow.sessions.recording import NONE, RecordedSession, is_twin, record_session
from ...messages import measure as messages
from ...session.device_session import DeviceSession
from .device_paths import inside, recording_folder
from .guided_runs import GuidedRuns
from .results import check_result
from .status_board import StatusBoard

_CHECK_TITLE, _RECORD_TITLE = "Check the board", "Record the device"
_SPECIMEN_TITLE = "Measure a specimen"


class GuidedTasks:
    """Starts guided tasks, and shows their results.

    Args:
        session: The device.
        board: Shows what the tasks do.
        runs: Runs the tasks.
    """

    def __init__(self, session: DeviceSession, board: StatusBoard, runs: GuidedRuns) -> None:
        self._session, self._board, self._runs = session, board, runs

    def start_check(self, request: messages.StartCheck) -> None:
        """Check the wiring of the device, on a thread."""
        options = CheckOptions(
            reference=tuple(request.reference) or None,
            wiggle=request.wiggle,
            poses=request.poses,
        )
        self._runs.start("check", lambda: self._check(request.port.strip(), options))

    def start_recording(self, request: messages.StartRecording) -> None:
        """Record the device, or resume a stopped session, on a thread."""
        self._runs.require_idle()  # a session that starts has no manifest yet
        device, device_folder = self._session.device, self._session.project.folder
        folder = recording_folder(device_folder, request.session.strip())
        cameras = _camera_addresses(request.cameras)
        calibration = inside(device_folder, request.calibration.strip(), CaptureError)
        options = RecordOptions(
            calibration=None if is_twin(cameras[0]) else calibration,
            out=folder,
            rounds=request.rounds,
            seconds=request.seconds,
        )
        record = partial(
            record_session,
            device,
            cameras,
            request.port.strip() or NONE,
            options,
            open_screen=lambda _: self._runs.open_screen("record", _RECORD_TITLE),
            note=lambda text: self._board.show(
                "record", text[:1].upper() + text[1:], state="running"
            ),
        )
        self._runs.start("record", lambda: self._show_recorded(record(), folder))

    def start_specimen(self, request: messages.MeasureSpecimen) -> None:
        """Measure a specimen, or continue its measurement, on a thread."""
        path = inside(self._session.project.folder, request.specimen.strip(), CalibrationError)
        self._runs.start("specimen", lambda: self._measure(request.port.strip(), path))

    def _check(self, port: str, options: CheckOptions) -> None:
        result = check_board(
            self._session.project.folder,
            port,
            options,
            screen=self._runs.open_screen("check", _CHECK_TITLE),
        )
        if not result.findings:
            self._board.show(
                "check",
                "Stopped before the readings at rest were complete; nothing was checked.",
                "check-stopped",
            )
            return
        self._board.show_result(check=check_result(result, port))
        text = "" if result.is_complete else "Not all steps were done; their faults may be missing."
        self._board.show("check", text, "check-complete" if not text else "check-incomplete")

    def _show_recorded(self, result: RecordedSession, folder: Path) -> None:
        finished, count = result.finished_steps, len(result.session.steps)
        if result.is_complete:
            text = f"{folder.name}: all {count} steps are recorded. Process it to train on it."
            self._board.show("record", text, "recording-complete")
        else:
            text = f"{folder.name}: {finished} of {count} steps are recorded. Start to resume."
            self._board.show("record", text, "recording-incomplete")

    def _measure(self, port: str, path: Path) -> None:
        screen = self._runs.open_screen("specimen", _SPECIMEN_TITLE)
        result = record_specimen(port, path, screen=screen)
        if result.is_finished:
            text = f"All {result.readings} readings are done. Fit the response next."
            self._board.show("specimen", text, "measurement-complete")
        else:
            text = (
                f"{result.finished} of {result.readings} readings are done. Measure again to"
                " continue, or fit the response to the finished readings."
            )
            self._board.show("specimen", text, "measurement-incomplete")


def _camera_addresses(text: str) -> tuple[str, ...]:
    text = text.strip()
    addresses = text if is_twin(text) else text.replace(",", " ")
    return tuple(addresses.split()) or (NONE,)
