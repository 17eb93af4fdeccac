"""The process of a group of runs: `python -m defsense_fab.workflow.study.run_process FOLDER`."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

#: Files in the folder: the runs to make, and a mark that all are finished.
TASK, DONE = "runs.json", "done"
#: Lines of finished runs, and the device, in the folder of the group.
RECORDS, DEVICE = "records.log", "device"
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def main(folder: Path) -> None:
    """Make runs one after another, and append a line for each."""
    task = json.loads((folder / TASK).read_text(encoding="utf-8"))
    if task["threads"]:
        for name in _THREAD_VARIABLES:
            os.environ.setdefault(name, str(task["threads"]))
    # NumPy reads these variables when it is imported.
    from ...core.machine.child_process import start_child
    from ...core.machine.processes import kill_own_group
    from ...core.storage.append_log import AppendLog
    from .run_log import RunRecord, encode_record

    start_child()
    limit = task["time_limit"]
    with AppendLog(Path(task["folder"]) / RECORDS) as log:

        def stop(run: dict[str, Any]) -> None:
            text = f"did not end within {limit:g} s and was stopped. Raise time_limit in study.toml"
            log.line(encode_record(RunRecord(run["name"], run["values"], "broken", text)))
            kill_own_group()

        for run in task["runs"]:
            timer = threading.Timer(limit, stop, (run,))
            timer.daemon = True
            timer.start()
            record = _make_run(run, task)
            timer.cancel()
            log.line(encode_record(record))
    (folder / DONE).touch()


def _make_run(run: dict[str, Any], task: dict[str, Any]) -> Any:
    """Return the record of a run, whether it succeeds or not."""
    from socket import gethostname

    from ...core.errors import DefsenseError
    from ...core.machine.processes import cpu_seconds, peak_memory_mb
    from ..build.build import build
    from ..changed_values import changed_device
    from .measures import Value, measure
    from .run_log import Outcome, RunRecord

    measures: dict[str, Value] = {}
    outcome: Outcome = "done"
    message, source = "", Path(task["folder"]) / DEVICE
    started_at, cpu = time.perf_counter(), cpu_seconds()
    try:
        device = changed_device(task["text"], source, run["changes"])
        measures = measure(build(device, task["until"]).results, task["until"])
    except DefsenseError as error:
        outcome, message = ("broken" if error.is_machine_limit else "refused"), str(error)
    except MemoryError:
        outcome, message = "broken", "not enough memory. Use a larger [mesh] edge_length."
    except Exception as error:
        outcome, message = "broken", f"failed ({type(error).__name__}: {error})"
    return RunRecord(
        run["name"],
        run["values"],
        outcome,
        " ".join(message.replace(f"{source}/", "").replace(str(source), ".").split()),
        measures,
        round(time.perf_counter() - started_at, 3),
        round(cpu_seconds() - cpu, 3),
        round(peak_memory_mb(), 1),
        gethostname(),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
