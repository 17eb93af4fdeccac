"""The synthetic device in files of other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from defsense_fab.core.markers import Markers, Tracks
from defsense_fab.training.data.dataset import Recording
from tests.training.synthetic import CHANNELS, IDS, REST


def tracks_of(r: Recording) -> Tracks:
    return Tracks(r.time, IDS, r.points, r.sigma, np.arange(len(r.time)))


def markers() -> Markers:
    """Return the markers; 1, 2 and 8 are on the anchor."""
    axes = np.tile(np.eye(3), (len(IDS), 1, 1))
    return Markers("bar", "4X4_50", 10.0, IDS, REST, axes, np.isin(IDS, (1, 2, 8)))


def write_csv(path: Path, names: list[str], columns: np.ndarray) -> Path:
    rows = [",".join("" if np.isnan(x) else f"{x:.7g}" for x in row) for row in columns]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return path


def write_signals(path: Path, r: Recording) -> Path:
    """Write signals as `capture process` does."""
    count = len(r.sample_time)
    columns = [np.arange(count), r.sample_time, *r.signals.T, np.full(count, 0.1)]
    names = ["frame", "time", *CHANNELS, "alignment_residual"]
    return write_csv(path, names, np.column_stack(columns))
