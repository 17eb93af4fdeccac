"""The process of a batch: `python -m defsense_fab.workflow.study.runs.make_runs FOLDER`."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ....core.machine.processes import cpu_seconds, peak_memory_mb

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def main(folder: Path) -> None:
    """Make the runs of `job.json` one after the other in one folder; shared stages are kept."""
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    if job["threads"]:
        for name in _THREAD_VARIABLES:
            os.environ.setdefault(name, str(job["threads"]))
    # NumPy reads these variables when it is imported.
    from ....core.storage.append_log import AppendLog
    from ....geometry.bodies.child_process import end_with_parent
    from .batch import DEVICE_FOLDER, DONE, RECORDS
    from .run_log import encode_record

    end_with_parent()
    work = Path(job["work"])
    with AppendLog(work / RECORDS) as log:
        for name, values in job["runs"]:
            log.line(encode_record(_make_run(name, values, job, work / DEVICE_FOLDER)))
    (folder / DONE).write_text("")


def _make_run(name: str, values: Mapping[str, Any], job: Mapping[str, Any], source: Path) -> Any:
    from ....core.errors import DefsenseError
    from ...build.build import build
    from ..points.measures import measure
    from ..points.studied_device import studied_device
    from .batch import machine_name
    from .run_log import Cost, Outcome, RunRecord

    measures: Mapping[str, Any] = {}
    outcome: Outcome = "done"
    message, meter = "", _Meter()
    try:
        device = studied_device(job["text"], source, values)
        measures = measure(build(device, job["until"], meter.progress).folder, job["until"])
    except DefsenseError as error:
        outcome, message = ("broken" if error.is_machine_limit else "refused"), str(error)
    except MemoryError:
        outcome, message = "broken", "the memory does not suffice. Use a larger [mesh] edge_length."
    except Exception as error:
        outcome, message = "broken", f"failed ({type(error).__name__}: {error})"
    message = " ".join(message.replace(f"{source}/", "").replace(str(source), ".").split())
    cost = Cost(meter.seconds, meter.cpu, meter.shared, round(peak_memory_mb(), 1))
    return RunRecord(name, values, outcome, message, measures, cost, machine_name())


class _Meter:
    """Measures the time of a run, and the CPU time of this process and its finished children."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), cpu_seconds()
        self.shared = 0.0

    def progress(self, stage: str, fraction: float, message: str) -> None:
        """Receive the progress of the build."""
        if message == "done" and fraction == 1 and stage in ("body", "mesh", "simulate"):
            self.shared = cpu_seconds() - self._cpu

    @property
    def seconds(self) -> float:
        return round(time.perf_counter() - self._wall, 3)

    @property
    def cpu(self) -> float:
        return round(cpu_seconds() - self._cpu, 3)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
