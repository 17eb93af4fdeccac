"""The comparison of layouts as a background job."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from ....workflow.build.results import last_build
from ....workflow.design.compare_layouts import ComparedLayout, compare_layouts
from ...background.background_job import JobReporter

_TIME_STEP_S = 5  # to which the estimated time is rounded


def by_error(layouts: Sequence[ComparedLayout]) -> list[ComparedLayout]:
    """Sort layouts by their errors; layouts without an error come last."""
    return sorted(layouts, key=lambda layout: (math.isnan(layout.error), layout.error))


def round_time(seconds: float) -> int:
    """Round an estimated time (s) to its accuracy."""
    return max(_TIME_STEP_S * round(seconds / _TIME_STEP_S), _TIME_STEP_S)


def run_comparison(reporter: JobReporter, folder: Path) -> None:
    """Compare the layouts of the last build; run this in a BackgroundJob.

    Its items are `ComparedLayout`.
    """
    from ....core.device.device_file import load_device
    from ....core.machine.processes import one_blas_thread

    with one_blas_thread():  # as in builds
        device = load_device(folder)
        compare_layouts(device, last_build(device), reporter.item, reporter.progress)
