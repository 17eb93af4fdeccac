"""A study of many runs on a Dask LocalCluster whose worker and whose command are killed on the way,
against the same study in one process.

    python -m benchmarks.study_cluster --out /tmp/study [--runs 200] [--workers 2] [--only one]

Each run is a bar with a coarse mesh, one pose and one cord, which stays as it is drawn, and is
judged and made on trial. First the study is made with `--workers 1`. Then a cluster of `--workers`
is started here, and the same study made on it by the command in a process of its own: when a
quarter of its runs are in the log, one worker is killed (SIGKILL; its nanny starts another), when
half of them are, the command itself is, and begun again. Told are the seconds of both, whether all
runs are there, whether any was logged twice, and the largest difference of any number recorded.
What is in `--out` already is taken as it is; `--only one` and `--only cluster` make one of the two.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from defsense_fab.workflow.study.runs.run_log import FILE, FOLDER, RunRecord, read_records

BAR = Path("fixtures/devices/bar")
_SEED = "[[sensors]]"
_WIDTHS, _CONTACTS = [28, 30, 32, 34], [0.5, 1.0, 2.0, 4.0, 8.0]


def prepare(folder: Path, runs: int) -> Path:
    """The device and its study."""
    if not folder.exists():
        folder.mkdir(parents=True)
        shutil.copy(BAR / "bar.py", folder)
        text = (BAR / "device.toml").read_text(encoding="utf-8")
        text = text.replace("edge_length = 6.0", "edge_length = 15.0")
        text = text.replace("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]")
        poses, cord = text.index("[[poses]]", text.index("bend_up")), text.index("[states]")
        text = text[:poses] + text[cord : text.index('name = "middle"') - len(f"{_SEED}\n")]
        text = text.replace("markers = 40", "markers = 20").replace("[0, 8, 0]", "[0, 0, 7]")
        text = text.replace('["path", "plane"]', "[]")
        text += '[design]\ndecoder = "affine"\nsearches = 1\n'
        (folder / "device.toml").write_text(text, encoding="utf-8")
        noises = runs // (len(_WIDTHS) * len(_CONTACTS))
        (folder / "study.toml").write_text(
            f"schema = 1\n[parameters]\nbody.parameters.width = {_WIDTHS}\n"
            f"cord.contact = {_CONTACTS}\n"
            f"cord.noise = {{ range = [0.001, 0.01], steps = {noises} }}\n",
            encoding="utf-8",
        )
    return folder


def command(folder: Path, *words: str) -> list[str]:
    return [sys.executable, "-m", "defsense_fab.cli.main", "study", str(folder), "--json", *words]


def lines(folder: Path) -> list[RunRecord]:
    """Of the log, also those that came twice."""
    path = folder / FOLDER / FILE
    if not path.exists():
        return []
    from defsense_fab.core.storage.append_log import LogLines
    from defsense_fab.workflow.study.runs.run_log import decoded

    return [decoded(line) for number, line in LogLines(path) if number > 1]


def wait_for(process: subprocess.Popen[bytes], folder: Path, count: int) -> None:
    while process.poll() is None and len(lines(folder)) < count:
        time.sleep(0.5)


def on_a_cluster(folder: Path, runs: int, workers: int) -> dict[str, Any]:
    from distributed import Client, LocalCluster

    begun = time.perf_counter()
    told: dict[str, Any] = {}
    with (
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        words = command(folder, "--scheduler", cluster.scheduler_address)
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
        wait_for(process, folder, runs // 4)
        pids = client.run(os.getpid)
        victim = next(iter(pids.values()))
        os.kill(victim, signal.SIGKILL)
        told["worker killed at"] = len(lines(folder))
        wait_for(process, folder, runs // 2)
        process.kill()
        process.wait()
        told["command killed at"] = len(lines(folder))
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        told["seconds"] = round(time.perf_counter() - begun, 1)
    return told


def in_one_process(folder: Path) -> dict[str, Any]:
    begun = time.perf_counter()
    subprocess.run(command(folder, "--workers", "1"), check=True, stdout=subprocess.DEVNULL)
    return {"seconds": round(time.perf_counter() - begun, 1)}


def compare(one: Path, other: Path) -> dict[str, Any]:
    """What the two logs have."""
    a, b = (read_records(f / FOLDER / FILE) for f in (one, other))
    twice = {
        f.name: sum(n > 1 for n in Counter(r.run for r in lines(f)).values()) for f in (one, other)
    }
    differences = []
    for run in a.keys() & b.keys():
        if a[run].parameters != b[run].parameters or a[run].outcome != b[run].outcome:
            raise SystemExit(f"{run}: {a[run]} and {b[run]}")
        for name, value in a[run].measures.items():
            differences.append(
                float(value != b[run].measures[name])
                if isinstance(value, str)
                else abs(float(value) - float(b[run].measures[name]))
            )
    return {
        "runs": (len(a), len(b)),
        "done": tuple(sum(r.outcome == "done" for r in x.values()) for x in (a, b)),
        "same runs": a.keys() == b.keys(),
        "logged twice": twice,
        "numbers compared": len(differences),
        "largest difference": max(differences, default=None),
    }


def costs(folder: Path) -> dict[str, float]:
    found = list(read_records(folder / FOLDER / FILE).values())
    own = [r.cost.cpu - r.cost.shared_cpu for r in found]
    shared = [r.cost.shared_cpu for r in found if r.cost.shared_cpu > 0]
    return {
        "CPU s of a run": round(sum(own) / len(own), 2),
        "CPU s of a batch's body, mesh and poses": round(sum(shared) / max(len(shared), 1), 2),
        "batches": len(shared),
        "memory, MB": max(r.cost.memory for r in found),
        "bytes sent for a run": round(sum(r.cost.sent for r in found) / len(found)),
        "bytes sent back": round(sum(r.cost.returned for r in found) / len(found)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=200, help="a multiple of 20, from 40 on")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", choices=("one", "cluster"), help="make one of the two")
    options = parser.parse_args()
    one, other = (prepare(options.out / name, options.runs) for name in ("one", "cluster"))
    if options.only != "cluster":
        print(f"one process: {json.dumps(in_one_process(one))}", flush=True)
    if options.only != "one":
        told = on_a_cluster(other, options.runs, options.workers)
        print(f"cluster: {json.dumps(told)}", flush=True)
    if lines(one) and lines(other):
        print(json.dumps(compare(one, other), indent=1))
        for folder in (one, other):
            print(f"{folder.name}: {json.dumps(costs(folder))}")


if __name__ == "__main__":
    main()
