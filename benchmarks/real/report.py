"""Tables and pictures of the results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.regression import PeerResult
from benchmarks.real.ours import Curves, OurResult, geometric_mean
from benchmarks.real.recordings import Task
from benchmarks.real.shifts import ShiftResult

MAX_PANELS = 3  # components of the targets in a picture: those that move most
FAMILIES = ("ridge", "kernel ridge", "extra trees", "boosting", "recurrent network")


@dataclass(frozen=True)
class Row:
    """Results of all decoders on one split of a recording.

    Attributes:
        name: Name of the recording, with the runs left out.
        unit: Unit of the targets; "of spread" for several.
        seconds: Duration of the usable frames, s.
        frames: Number of frames to train on, and to test on.
        mean: Error of the mean of the training on the test frames.
        ours: The trained model.
        peers: All choices of all peers.
        published: What the sensor's paper states.
    """

    name: str
    unit: str
    seconds: float
    frames: tuple[int, int]
    mean: float
    ours: OurResult
    peers: list[PeerResult]
    published: str

    def chosen(self, family: str | None = None) -> PeerResult:
        """Return the choice with the smallest error on the folds, of a family or of all."""
        of_family = [p for p in self.peers if family in (None, p.family)]
        return min(of_family, key=lambda p: p.cross_validated)

    @property
    def ratio(self) -> float:
        """Our error on the test frames over that of the best peer by the folds."""
        return self.ours.test / self.chosen().test

    def cpu_s(self, family: str) -> float:
        """Return the CPU seconds of all choices of a family."""
        return sum(p.cpu_s for p in self.peers if p.family == family)

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain values."""
        chosen = {f: asdict(self.chosen(f)) for f in FAMILIES}
        return asdict(self) | {"chosen": chosen, "best": asdict(self.chosen()), "ratio": self.ratio}


def _table(header: str, rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [header, "|" + "---|" * (header.count("|") - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def number(value: float) -> str:
    """Return a value with three digits."""
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def error_table(rows: Sequence[Row]) -> str:
    """Return the table of errors: on folds / on the test."""
    body = []
    for r in rows:
        of_peers = []
        for family in FAMILIES:
            p = r.chosen(family)
            of_peers.append(f"{number(p.cross_validated)} / {number(p.test)}")
        best = r.chosen()
        body.append(
            [
                r.name,
                r.unit,
                f"{r.seconds:.0f}",
                f"{r.frames[0]} + {r.frames[1]}",
                number(r.mean),
                f"{r.ours.kind}: {number(r.ours.cross_validated)} / {number(r.ours.test)}",
                *of_peers,
                f"{best.family} ({best.choice})",
                f"{r.ratio:.2f}",
            ]
        )
    peers = " | ".join(f"{f} CV / test" for f in FAMILIES)
    return _table(
        "| recording | unit | s | frames | mean | ours: CV / test | "
        f"{peers} | best peer by folds | ours / best |",
        body,
    )


def published_text(rows: Sequence[Row]) -> str:
    """Return a line for each recording whose sensor's paper states an error."""
    lines = [f"{r.name}, published: {r.published}" for r in rows if r.published]
    return "\n".join(lines or ["No published errors are known."])


def time_table(rows: Sequence[Row]) -> str:
    """Return the table of CPU seconds."""
    body = [[r.name, f"{r.ours.cpu_s:.1f}", *(f"{r.cpu_s(f):.1f}" for f in FAMILIES)] for r in rows]
    return _table(f"| CPU s | ours | {' | '.join(FAMILIES)} |", body)


def interval_table(rows: Sequence[Row]) -> str:
    """Return the table of intervals."""
    body = []
    for r in rows:
        ours, plain = r.ours.coverage, r.ours.plain
        body.append(
            [
                r.name,
                f"{ours.share:.0%} ({ours.worst_tenth:.0%})",
                f"{plain.share:.0%} ({plain.worst_tenth:.0%})",
                number(ours.median_width),
                f"{ours.median_width / plain.median_width:.2f}",
                f"{r.ours.grown:.0%}",
                f"{r.ours.withheld:.0%}",
                ", ".join(" ".join(f"{100 * c:.0f}" for c in ours.by_tenth).split(" ")),
            ]
        )
    return _table(
        "| 90 % interval | ours (worst tenth) | plain split conformal | median half width | over"
        " plain | grown | withheld | by tenth, % |",
        body,
    )


def channel_table(rows: Sequence[Row]) -> str:
    """Return the table of errors without each channel."""
    body = []
    for r in rows:
        without = sorted(r.ours.without.items(), key=lambda item: -item[1])
        text = ", ".join(f"{n} {number(e)}" for n, e in without[:6])
        more = f", {len(without) - 6} more down to {number(without[-1][1])}"
        body.append([r.name, number(r.ours.test), text + (more if len(without) > 6 else "")])
    return _table("| test error | all channels | without a channel |", body)


def shift_table(results: dict[str, list[ShiftResult]]) -> str:
    """Return the table of shifts that were put in: how many runs are found, unknown, or wrong.

    Runs that are judged together have the same correction, which is listed once.
    """
    body = []
    for name, each in results.items():
        for put_in in dict.fromkeys(r.put_in_s for r in each):
            of_shift = [r for r in each if r.put_in_s == put_in]
            verdicts = [r.verdict for r in of_shift]
            counts = [f"{v} {verdicts.count(v)}" for v in dict.fromkeys(verdicts)]
            known = {f"{r.found_s:+.2f}": None for r in of_shift if r.found_s is not None}
            changes = {f"{r.change_s:+.2f}": None for r in of_shift if r.change_s is not None}
            body.append(
                [
                    name,
                    f"{put_in:+.1f}",
                    ", ".join(counts),
                    ", ".join(known) or "-",
                    ", ".join(changes) or "-",
                    str(sum(r.is_error for r in of_shift)),
                    f"{of_shift[0].cpu_s:.1f}",
                ]
            )
    return _table(
        "| recording | put in, s | runs | correction found, s | change, s | false | CPU s |", body
    )


def summary(rows: Sequence[Row]) -> str:
    """Return the geometric mean of the ratios, and in how many recordings ours is better."""
    ratios = [r.ratio for r in rows]
    better = sum(r < 1 for r in ratios)
    return (
        f"ours / best peer by folds: geometric mean {geometric_mean(ratios):.2f}, largest"
        f" {max(ratios):.2f}, better in {better} of {len(ratios)}"
    )


def draw(row: Row, task: Task, curves: Curves, path: Path) -> None:
    """Draw truth, prediction and interval over the test, and errors without each channel."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    truth = task.test.points
    spread = np.nanstd(truth, axis=0)
    order = np.argsort(-spread, axis=None)[:MAX_PANELS]
    figure, axes = plt.subplots(
        len(order) + 1, 1, figsize=(11, 2.4 * (len(order) + 1)), layout="constrained"
    )
    at = np.arange(len(truth))
    ends = np.flatnonzero(np.diff(task.test.recording_index)) + 1
    has_time = not len(ends)
    x = task.test.time if has_time else at
    for axis, flat in zip(axes, order, strict=False):
        m, k = np.unravel_index(flat, spread.shape)
        center, radius = curves.points[:, m, k], curves.radius[:, m]
        axis.fill_between(
            x, center - radius, center + radius, color="#9ecae1", lw=0, label="90 % interval"
        )
        axis.plot(x, truth[:, m, k], color="black", lw=1, label="truth")
        axis.plot(x, center, color="#d95f02", lw=1, label="decoded")
        name = f"target {m}" if task.dataset.targets is None else task.dataset.targets.names[m]
        part = f" {'xyz'[k]}" if spread.shape[1] == 3 else ""
        axis.set_ylabel(f"{name}{part} [{task.dataset.units[m]}]")
        low, high = np.nanmin(truth[:, m, k]), np.nanmax(truth[:, m, k])
        axis.set_ylim(low - 0.6 * (high - low), high + 0.6 * (high - low))
        for end in ends:
            axis.axvline(end, color="0.7", lw=0.6)
    axes[0].legend(loc="upper right", ncols=3, fontsize=8)
    axes[0].set_title(f"{row.name}: {row.ours.kind}, test error {number(row.ours.test)} {row.unit}")
    axes[-2].set_xlabel("time, s" if has_time else "test frame; lines between runs")
    names = list(row.ours.without)
    axes[-1].bar(names, [row.ours.without[n] for n in names], color="#7570b3")
    axes[-1].axhline(row.ours.test, color="black", lw=1)
    axes[-1].set_ylabel(f"without it [{row.unit}]")
    axes[-1].tick_params(axis="x", rotation=45 if len(names) > 8 else 0, labelsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
