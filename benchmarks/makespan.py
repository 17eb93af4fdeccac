"""How long a study takes on 10, 100 and 1,000 workers, simulated from what its runs were measured
to cost.

    python -m benchmarks.makespan STUDY/study/runs.log [--runs 10000] [--fraction 0.05] [--mtbf 24]

Runs are drawn from the log's, with their own CPU seconds; each group of `--together` runs shares a
simulation, whose seconds are drawn from the log, too. They are batched as `defsense study` batches
them for so many workers, and given to whichever worker is free, two ahead. A share `--fraction` of
the batches is on a worker that takes `--slower` times as long, workers fail after `--mtbf` hours on
average (what they were at begins again elsewhere after `--notice` s), and the scheduler takes
`--overhead` s for each batch and sends through `--bandwidth` bytes/s. Told are the makespan, how
much of the workers' time it uses, the time that neither more workers nor better ones could go
below, and what limits it most: the longest batch, the scheduler, or the work.
"""

from __future__ import annotations

import argparse
import heapq
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from defsense_fab.core.errors import DefsenseError
from defsense_fab.workflow.study.runs.making import LOST
from defsense_fab.workflow.study.runs.planned import Run, batches
from defsense_fab.workflow.study.runs.run_log import RunRecord, read_records

START = 0.7  # CPU s of a batch's process until its first run begins, measured


@dataclass(frozen=True)
class Costs:
    """As measured: CPU seconds of runs without what they share, and of what a batch shares; bytes
    of a run, both ways."""

    own: np.ndarray
    shared: np.ndarray
    size: float

    @staticmethod
    def of(records: list[RunRecord]) -> Costs:
        own = np.array([r.cost.cpu - r.cost.shared_cpu for r in records])
        shared = np.array([r.cost.shared_cpu for r in records if r.cost.shared_cpu > 0])
        size = float(np.mean([r.cost.sent + r.cost.returned for r in records]))
        return Costs(own, shared if len(shared) else np.zeros(1), size)


def batch_seconds(
    costs: Costs, runs: int, together: int, workers: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Seconds of each batch, and how many runs it has, the longest first."""
    own = rng.choice(costs.own, runs)
    shared = rng.choice(costs.shared, -(-runs // together))
    made = batches([Run(str(n), {}, str(n // together)) for n in range(runs)], workers, LOST)
    seconds = [
        START + shared[int(b[0].simulation)] + own[[int(r.name) for r in b]].sum() for b in made
    ]
    return np.array(seconds), np.array([len(b) for b in made])


def makespan(
    seconds: np.ndarray,
    sizes: np.ndarray,
    workers: int,
    o: argparse.Namespace,
    costs: Costs,
    rng: np.random.Generator,
) -> tuple[float, float, float, int]:
    """s until all is done, s of work including what was lost, s of the longest batch, and how many
    batches were lost."""
    free = [(0.0, w) for w in range(workers)]
    heapq.heapify(free)
    fails = rng.exponential(3600 * o.mtbf, workers)
    slow = np.where(rng.random(len(seconds)) < o.fraction, o.slower, 1.0)
    waiting = [(0.0, n) for n in range(len(seconds))]
    sent, end, work, lost = 0.0, 0.0, 0.0, 0
    while waiting:
        ready, n = waiting.pop(0)
        at, worker = heapq.heappop(free)
        sent = max(sent, ready) + o.overhead + sizes[n] * costs.size / o.bandwidth
        begin = max(at, sent)
        takes = seconds[n] * slow[n]
        if begin + takes > fails[worker] > begin:  # it fails on the way, and comes back new
            lost += 1
            work += fails[worker] - begin
            waiting.append((fails[worker] + o.notice, n))
            heapq.heappush(free, (fails[worker] + o.notice, worker))
            fails[worker] += o.notice + rng.exponential(3600 * o.mtbf)
            continue
        while fails[worker] <= begin:
            fails[worker] += rng.exponential(3600 * o.mtbf)
        work += takes
        end = max(end, begin + takes)
        heapq.heappush(free, (begin + takes, worker))
    return end, work, float((seconds * slow).max()), lost


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", type=Path)
    parser.add_argument("--runs", type=int, nargs="+", default=[200, 10_000])
    parser.add_argument("--together", type=int, default=50)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 10, 100, 1000])
    parser.add_argument("--fraction", type=float, default=0.05)
    parser.add_argument("--slower", type=float, default=3.0)
    parser.add_argument("--mtbf", type=float, default=24.0, help="hours, of a worker")
    parser.add_argument("--notice", type=float, default=60.0)
    parser.add_argument("--overhead", type=float, default=0.005)
    parser.add_argument("--bandwidth", type=float, default=12.5e6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--scale", type=float, default=1.0, help="runs that take so many times as long"
    )
    o = parser.parse_args()
    try:
        records = [r for r in read_records(o.log).values() if r.outcome == "done"]
    except DefsenseError as error:
        sys.exit(f"error: {error}")
    if not records:
        sys.exit(f"error: {o.log}: holds no run that is done; give the runs.log of a study")
    costs = Costs.of(records)
    costs = Costs(o.scale * costs.own, o.scale * costs.shared, costs.size)
    print(
        f"{len(records)} runs measured: {costs.own.mean():.2f} CPU s each,"
        f" {costs.shared.mean():.1f} s of what a batch shares, {costs.size / 1e3:.1f} kB of a run"
    )
    for runs in o.runs:
        alone = 0.0
        for workers in o.workers:
            rng = np.random.default_rng(o.seed)
            seconds, sizes = batch_seconds(costs, runs, o.together, workers, rng)
            end, work, longest, lost = makespan(seconds, sizes, workers, o, costs, rng)
            alone = end if workers == 1 else alone
            sending = len(seconds) * o.overhead + runs * costs.size / o.bandwidth
            bounds = {
                "the longest batch": longest,
                "the scheduler": sending,
                "the work": work / workers,
            }
            limit = max(bounds, key=lambda k: bounds[k])
            print(
                f"{runs:>7} runs {workers:>5} workers: {len(seconds):>5} batches, {end:>9.0f} s,"
                f" {work / (workers * end):4.0%} of the workers used, {lost:>3} batches lost"
                + (f", {alone / end:6.1f} times as fast as one" if alone else "")
                + f"; limited by {limit} ({bounds[limit]:.0f} s)"
            )


if __name__ == "__main__":
    main()
