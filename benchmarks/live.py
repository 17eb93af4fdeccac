"""Measure delays and memory of the live loop in real time.

    python -m benchmarks.live my-device/model.json --minutes 10
    python -m benchmarks.live my-device/model.json --minutes 10 --view 8080 --output osc

The device's twin sends 100 samples per second (`--port` selects another port). A line every 30 s
shows: samples per second; surfaces per second; the time from the arrival of a sample to its frame's
output, and to its surface's display (median, 99th percentile, largest; ms); memory (MB); and the
number of CPU cores in use. Histograms of both times follow at the end. Open the page of the view to
include the load by a browser.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Float
from defsense_fab.workflow.run.live_device import live_device
from defsense_fab.workflow.run.options import RunOptions
from defsense_fab.workflow.run.outputs import read_settings
from defsense_fab.workflow.run.run import prepare_run

_EVERY = 30.0  # s
_EDGES = (0, 1, 2, 3, 5, 8, 12, 15, 20, 30, 50, 100, np.inf)  # ms


def memory() -> float:
    """Return the memory in use, MB."""
    text = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(next(x for x in text.splitlines() if x.startswith("VmRSS")).split()[1]) / 1024


def processor() -> float:
    """Return the CPU seconds of all threads."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def format_times(seconds: Float) -> str:
    """Return median, 99th percentile and maximum of times in s, as text in ms."""
    if not len(seconds):
        return "-"
    ms = 1e3 * seconds
    return f"{np.median(ms):.2f} / {np.quantile(ms, 0.99):.2f} / {ms.max():.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--port", default="twin")
    parser.add_argument("--rate", type=int, default=100)
    parser.add_argument("--view", type=int, default=None)
    parser.add_argument("--output", action="append", default=[])
    options = parser.parse_args()
    run = prepare_run(
        live_device(options.model),
        options.port,
        RunOptions(rate=options.rate),
        settings=read_settings(None, outputs=options.output),
        view=options.view,
        keeps_readings=False,
    )
    run.loop.start()
    print(f"{run.surface or 'no surface'}; view: {run.view.url if run.view else 'none'}")
    print("s, samples/s, surfaces/s, ms to outputs, ms to view, MB, cores")
    started_at, cpu_at_start = time.monotonic(), processor()
    all_latencies: tuple[list[Float], list[Float]] = ([], [])
    while time.monotonic() - started_at < 60 * options.minutes:
        if not run.loop.wait(_EVERY):
            break
        status, (decoded, displayed) = run.loop.status, run.loop.latencies()
        recent = round(_EVERY * options.rate)
        all_latencies[0].append(decoded[-recent:])
        all_latencies[1].append(displayed[-recent:])
        now, used = time.monotonic() - started_at, processor()
        print(
            f"{now:.0f}, {status.rate:.0f}, {status.surface_rate:.0f},"
            f" {format_times(all_latencies[0][-1])}, {format_times(all_latencies[1][-1])},"
            f" {memory():.0f}, {(used - cpu_at_start) / now:.2f}",
            flush=True,
        )
    run.close()
    for title, parts in zip(("outputs", "view"), all_latencies, strict=True):
        ms = 1e3 * np.concatenate(parts or [np.zeros(0)])
        if len(ms):
            counts = np.histogram(ms, _EDGES)[0]
            rows = ", ".join(
                f"{low:g}-{high:g} ms: {100 * n / len(ms):.2f} %"
                for low, high, n in zip(_EDGES, _EDGES[1:], counts, strict=False)
            )
            print(f"{title}: {format_times(ms / 1e3)} ms of {len(ms)} frames; {rows}")


if __name__ == "__main__":
    main()
