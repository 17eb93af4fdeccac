"""Measure a bending specimen on its jigs, step by step."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from ...calibration.guided_measurement import run_guided_measurement
from ...calibration.session import (
    CHANNELS,
    create_or_resume,
    discard_empty,
    read_specimen,
    unfinished_steps,
)
from ...capture.readout.reader import ReadoutSettings
from ...core.errors import CaptureError, DefsenseError
from ...core.guided_run import Screen
from ...twin.live.sample_sources import open_source
from ..board.options import BoardOptions
from .options import MeasureOptions

#: Folder of a session, next to `specimen.json`.
SESSION = "session"
_DEFAULT_READINGS, _DEFAULT_BOARD = MeasureOptions(), BoardOptions()


@dataclass(frozen=True)
class RecordedSpecimen:
    """A session on a specimen, and its progress.

    Attributes:
        folder: Folder of the session.
        finished: Number of finished readings.
        readings: Number of all readings.
    """

    folder: Path
    finished: int
    readings: int

    @property
    def is_finished(self) -> bool:
        """Whether all readings are finished."""
        return self.finished == self.readings


def record_specimen(
    port: str,
    specimen: Path,
    options: MeasureOptions = _DEFAULT_READINGS,
    board: BoardOptions = _DEFAULT_BOARD,
    *,
    screen: AbstractContextManager[Screen],
    out: Path | None = None,
    auto: bool = False,
) -> RecordedSpecimen:
    """Measure a specimen, or continue its measurement.

    A new session that cannot start leaves no files. Ctrl-C stops the measurement as the key `q`
    does; it can be continued.

    Args:
        port: Port of the read-out board, or `twin`.
        specimen: `specimen.json`, or its folder.
        options: Which readings are taken.
        board: How the read-out board measures.
        screen: Shows the measurement and reads keys; opened when the session is ready.
        out: Folder of the session; None for `session` next to `specimen.json`.
        auto: Whether each reading is taken as soon as it has settled, without keys.

    Returns:
        The session and its progress.

    Raises:
        CalibrationError: The specimen is invalid, or the session is finished or differs.
        CaptureError: The port is a recording (`port-is-recording`) or cannot be read.
        StorageError: Files cannot be written.
    """
    if port.endswith(".csv"):
        raise CaptureError(
            f"{port} is a recording, which cannot be measured again",
            code="port-is-recording",
            where="port",
            action="Give the port of a read-out board, or twin",
            port=port,
        )
    parent = specimen if specimen.is_dir() else specimen.parent
    session, is_resumed = create_or_resume(
        out or parent / SESSION, read_specimen(specimen), options, board
    )
    settings = ReadoutSettings(len(CHANNELS), session.average, session.rate)
    try:
        opened = open_source(port, settings, session.geometry, session.length)
        with screen as opened_screen:
            run_guided_measurement(session, opened.source, opened_screen, opened.hands, auto=auto)
    except KeyboardInterrupt:
        pass  # every frame is written
    except DefsenseError:
        if not is_resumed:
            discard_empty(session)
        raise
    count = len(session.steps)
    return RecordedSpecimen(session.folder, count - len(unfinished_steps(session)), count)
