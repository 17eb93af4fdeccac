"""Measure a build from an empty cache: CPU seconds and elapsed time of each stage, peak memory.

    python -m benchmarks.stages fixtures/devices/bar
    python -m benchmarks.stages fixtures/devices/* --compile
    python -m benchmarks.stages fixtures/devices/bar --workers 1 2 --edge-length 6.5 --repeat 3

Each device is copied to a separate folder and built by a separate process, without cached meshes. A
first build compiles the code, unless `--compile` is given. CPU seconds are those of the process and
of its children, which mesh and run scripts. With `--workers`, poses and searches run on a Dask
scheduler of this machine with so many workers of one thread each, next to a run without it.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path


def cpu() -> float:
    """Return the CPU seconds of this process and of its finished children."""
    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def peak() -> float:
    """Return the largest memory of this process or of a finished child so far, MB."""
    return (
        max(
            resource.getrusage(w).ru_maxrss
            for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        )
        / 1024
    )


def built(folder: Path) -> list[tuple[str, float, float, float]]:
    """Build the device.

    Returns:
        Name, CPU seconds, elapsed seconds and peak memory (MB) of each stage, imports first.
    """
    started = cpu(), time.perf_counter(), 0.0
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.workflow.build.build import build

    device = load_device(folder)
    marks = [("imports", *started)]

    def progress(stage: str, fraction: float, _: str) -> None:
        if fraction == 0.0 and stage != marks[-1][0]:
            marks.append((stage, cpu(), time.perf_counter(), peak()))

    build(device, progress=progress)
    ends = [*marks[1:], ("", cpu(), time.perf_counter(), peak())]
    return [(m[0], e[1] - m[1], e[2] - m[2], e[3]) for m, e in zip(marks, ends, strict=True)]


def in_process(folder: Path, environment: dict[str, str]) -> list[tuple[str, float, float, float]]:
    """Return the same from a new process."""
    command = [sys.executable, "-m", "benchmarks.stages", "--one", str(folder)]
    out = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return [tuple(row) for row in json.loads(out.stdout.splitlines()[-1])]


def compare_workers(source: Path, counts: list[int], edge_length: float, repeat: int) -> None:
    """Print the time of poses and searches by the number of workers, and whether results differ."""
    os.environ |= {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    from distributed import LocalCluster

    from defsense_fab.core.device.device_file import load_device

    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / source.name
        shutil.copytree(source, copy, ignore=shutil.ignore_patterns("build", ".build*", "*.mesh"))
        device = load_device(copy)
        if edge_length:
            device = replace(device, mesh=replace(device.mesh, edge_length=edge_length))
        reference = None
        times: dict[int, list[float]] = {}
        for _ in range(repeat):
            for count in (0, *counts):
                started = cpu()
                if count:
                    with LocalCluster(
                        n_workers=count, threads_per_worker=1, dashboard_address=None
                    ) as cluster:
                        results, row = _timed(device, copy, cluster.scheduler_address)
                else:
                    results, row = _timed(device, copy, None)
                times.setdefault(count, []).append(sum(row))
                load = f"{cpu() - started:.0f} CPU s with workers, load {os.getloadavg()[0]:.1f}"
                reference = reference or results
                print(
                    f"  {count or 'no'} workers: poses {row[0]:.1f} s, layout {row[1]:.1f} s,"
                    f" {load}; {_difference(reference, results)}",
                    flush=True,
                )
        print(f"{source.name}: {reference[0]} tets, medians of {repeat}")
        for count, seconds in times.items():
            ratio = statistics.median(times[counts[0]]) / statistics.median(seconds)
            name = f"{count} workers" if count else "without"
            print(f"  {name}: {statistics.median(seconds):.1f} s, {ratio:.2f} times {counts[0]}")


def _timed(device, folder: Path, scheduler: str | None):
    """Return the results, and the seconds of the poses and of the layout."""
    from defsense_fab.workflow.build.build import build
    from defsense_fab.workflow.build.options import BuildOptions

    with tempfile.TemporaryDirectory() as cache:
        os.environ["DEFSENSE_CACHE"] = cache
        shutil.rmtree(folder / "build", ignore_errors=True)
        shutil.rmtree(folder / ".build-kept", ignore_errors=True)
        build(device, "mesh")
        row, options = [], BuildOptions(scheduler=scheduler)
        for stage in ("simulate", "optimize"):
            start = time.perf_counter()
            build(device, stage, options=options)
            row.append(time.perf_counter() - start)
        results = build(device, "optimize").results
        layout = json.loads((folder / "build" / "layout.json").read_text())
        return (results.mesh_record.tets, results.fields.displacements, layout["sensors"]), row


def _difference(a, b) -> str:
    cords = "equal" if a[2] == b[2] else "different"
    return f"largest difference of a field {abs(a[1] - b[1]).max():.1e} mm, {cords} cords"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="+", type=Path)
    parser.add_argument("--compile", action="store_true", help="count compiling, too")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--workers", type=int, nargs="+", help="numbers of workers of a scheduler")
    parser.add_argument("--edge-length", type=float, default=0.0, help="with --workers, mm")
    parser.add_argument("--repeat", type=int, default=3, help="with --workers")
    options = parser.parse_args()
    if options.workers:
        for source in options.folder:
            compare_workers(source, options.workers, options.edge_length, options.repeat)
        return
    if options.one:
        print(json.dumps(built(options.folder[0])))
        return
    for source in options.folder:
        with tempfile.TemporaryDirectory() as temporary:
            copy, cache = Path(temporary) / source.name, Path(temporary) / "cache"
            environment = {**os.environ, "DEFSENSE_CACHE": str(cache)}
            if options.compile:
                environment["NUMBA_CACHE_DIR"] = str(Path(temporary) / "code")
            skip = shutil.ignore_patterns("build", ".build*", "*.mesh")
            shutil.copytree(source, copy, ignore=skip)
            if not options.compile:
                in_process(copy, environment)
                shutil.rmtree(copy / "build")
                shutil.rmtree(cache)
                (copy / "device.mesh").unlink(missing_ok=True)
            rows = in_process(copy, environment)
        total = [sum(r[k] for r in rows) for k in (1, 2)]
        print(f"{source.name}: {total[0]:.1f} CPU s, {total[1]:.1f} s on the clock")
        for name, used, wall, memory in rows:
            share = used / total[0]
            print(f"  {name:<10} {used:6.1f} CPU s  {share:4.0%}  {wall:6.1f} s  {memory:6.0f} MB")


if __name__ == "__main__":
    main()
