"""The mode that calibrates, records, trains and runs the finished device."""

from __future__ import annotations

from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .calibration_part import CalibrationPart
from .live_part import LivePart
from .recording_part import RecordingPart
from .training_part import TrainingPart


class MeasureMode(Mode):
    """Measure the finished device; what runs continues in other modes and ends with the studio.

    Attributes:
        live: Runs the device live.
        training: Trains and evaluates models.
        recording: Records the device.
        calibration: Measures the response of the cord.
    """

    label = "Measure"
    hint = "Record the finished device, train a model of it, and run it live."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.live = LivePart(bench, self.label)
        self.training = TrainingPart(bench, self.live.refresh)
        self.recording = RecordingPart(bench, self.training.refresh)
        self.calibration = CalibrationPart(bench)

    def add_panel(self) -> None:
        self.live.add_panel()
        self.recording.add_panel()
        self.training.add_panel()
        self.calibration.add_panel()

    def enter(self) -> None:
        self.live.enter()
        self.training.refresh()

    def leave(self) -> None:
        self.live.leave()

    def on_device_changed(self) -> None:
        if self.is_active:
            self.live.refresh()
            self.training.refresh()

    def close(self) -> None:
        self.live.close()
        self.recording.close()
        self.training.close()
        self.calibration.close()
