"""The build as a background job, with the layouts that its search tries."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...core.device.device import Sensor
from .background_job import JobReporter

_STAGES_WITHOUT_POSES = ("body", "mesh")
#: Usual time of each stage, relative to the others.
_WORK = {"body": 2, "mesh": 3, "simulate": 15, "optimize": 60, "fabricate": 12, "report": 8}
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
    from ...workflow.build.build import build, freshness
    from ...workflow.build.options import BuildOptions
    from ...workflow.build.stages import STAGES, STAGES_WITHOUT_CORDS, SearchProgress

    clock, last_sent = _Clock(), -_MIN_LAYOUT_INTERVAL_S

    is_complete = stage not in _STAGES_WITHOUT_POSES
    needs_cords = stage not in STAGES_WITHOUT_CORDS
    device = load_device(folder, complete=is_complete, cords=needs_cords)
    titles = {s.name: s.title for s in STAGES}
    last = list(titles).index(stage)
    states = freshness(device) if is_complete else {}
    names = list(titles)[: last + 1]  # a search runs again after a layout that was continued
    waiting = [n for n in names if states.get(n) != "current" or n == stage == "optimize"]
    progress = BuildProgress({name: titles[name] for name in waiting})

    def report_progress(stage: str, share: float, message: str) -> None:
        with clock.stopped():
            reporter.progress(*progress.report(stage, share, message))

    def report_layout(search: SearchProgress) -> None:
        nonlocal last_sent
        now = clock.seconds
        if search.kept or now - last_sent >= _MIN_LAYOUT_INTERVAL_S:
            last_sent = now
            layout = CandidateLayout(search.folder, search.sensors, search.rmse, search.kept, now)
            with clock.stopped():
                reporter.item(layout)

    options = BuildOptions(search=stage == "optimize")
    build(device, stage, report_progress, report_layout, options=options)


class BuildProgress:
    """The progress of a whole build, which never decreases.

    Args:
        titles: Title of each stage that is expected to run, by name, in order.
    """

    def __init__(self, titles: Mapping[str, str]) -> None:
        self._titles, self._share = titles, 0.0
        self._total = sum(_WORK[name] for name in titles)

    def report(self, stage: str, share: float, message: str) -> tuple[float, str]:
        """Return the completed share of the build, and what it does.

        Args:
            stage: Name of the stage that runs.
            share: Its completed share.
            message: What it does.
        """
        names = list(self._titles)
        if stage not in names:  # it was expected to be up to date
            return self._share, f"{stage}: {message}"
        at = names.index(stage)
        before = sum(_WORK[name] for name in names[:at])
        whole = (before + _WORK[stage] * min(max(share, 0.0), 1.0)) / self._total
        self._share = max(self._share, whole)
        title = self._titles[stage]
        place = f"Stage {at + 1} of {len(names)}, " if len(names) > 1 else ""
        detail = "" if message in (title, "done") else f": {message}"
        return self._share, f"{place}{title}{detail}"


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
