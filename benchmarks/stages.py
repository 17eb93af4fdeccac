"""Measure a build from an empty cache: CPU seconds and elapsed time of each stage, peak memory.

    python -m benchmarks.stages fixtures/devices/bar
    python -m benchmarks.stages fixtures/devices/* --compile

Each device is copied to a separate folder and built by a separate process, without cached meshes. A
first build compiles the code, unless `--compile` is given. CPU seconds are those of the process and
of its children, which mesh and run scripts.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="+", type=Path)
    parser.add_argument("--compile", action="store_true", help="count compiling, too")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
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
