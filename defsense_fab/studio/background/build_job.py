"""The build as a background job, with the layouts that its search tries."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...core.device.device import Sensor
from .background_job import JobReporter

_STAGES_OF_INCOMPLETE_DEVICES = ("body", "mesh")  # they need neither poses nor cords
_MIN_LAYOUT_INTERVAL_S = 0.1  # between layouts that are sent while the search passes them


@dataclass(frozen=True)
class CandidateLayout:
    """A layout that a search has come to (see `workflow.build.stages.SearchProgress`).

    Attributes:
        folder: Build folder of the search.
        sensors: The cords.
        rmse: Error of the layout by the search's measure, mm.
        is_best: Whether it is the best of its search so far.
        seconds: Time that the search has worked, without pauses, s.
    """

    folder: Path
    sensors: tuple[Sensor, ...]
    rmse: float
    is_best: bool
    seconds: float


def run_build(reporter: JobReporter, folder: Path, stage: str) -> None:
    """Build the device in a folder up to a stage; run this in a BackgroundJob.

    The stage "optimize" searches; later stages continue from the layout of an earlier build.
    Its items are `CandidateLayout`. A build that is canceled or fails leaves the previous build
    unchanged; the next one resumes from the last completed stage.
    """
    from ...core.device.device_file import load_device
    from ...workflow.build.build import build
    from ...workflow.build.options import BuildOptions
    from ...workflow.build.stages import SearchProgress

    clock, last_sent = _Clock(), -_MIN_LAYOUT_INTERVAL_S

    def report_progress(stage: str, share: float, message: str) -> None:
        with clock.stopped():
            reporter.stage_progress(stage, share, message)

    def report_layout(search: SearchProgress) -> None:
        nonlocal last_sent
        now = clock.seconds
        if search.kept or now - last_sent >= _MIN_LAYOUT_INTERVAL_S:
            last_sent = now
            layout = CandidateLayout(search.folder, search.sensors, search.rmse, search.kept, now)
            with clock.stopped():
                reporter.item(layout)

    is_complete = stage not in _STAGES_OF_INCOMPLETE_DEVICES
    device = load_device(folder, complete=is_complete)
    options = BuildOptions(search=stage == "optimize")
    build(device, stage, report_progress, report_layout, options=options)


class _Clock:
    """Measure time, without the periods in which it is stopped."""

    def __init__(self) -> None:
        self._started_at = time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._started_at

    @contextmanager
    def stopped(self) -> Iterator[None]:
        stopped_at = time.monotonic()
        yield
        self._started_at += time.monotonic() - stopped_at
