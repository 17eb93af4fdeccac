"""A recording of the synthetic device as a processed session's folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.capture.sessions.session import PoseStep, create
from defsense_fab.training.data.dataset import Recording
from tests.training.recordings.files_of_others import markers, tracks_of, write_csv
from tests.training.synthetic import CHANNELS


def write_samples(path: Path, r: Recording) -> Path:
    """Write the read-out board's samples as `capture process` does."""
    count = len(r.sample_time)
    columns = [np.arange(count), 1e6 * r.sample_time, r.sample_time, *r.signals.T, *r.ohm.T]
    names = ["counter", "device_us", "time", *CHANNELS, *(f"{c}_ohm" for c in CHANNELS)]
    write_csv(path, names, np.column_stack(columns))
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([f"run,{head}", *(f"run-1,{row}" for row in rows)]) + "\n")
    return path


def write_session(folder: Path, r: Recording, device: str = "bar", layout: str = "") -> Path:
    """Write the facts on its only run."""
    create(
        folder,
        device=device,
        steps=[PoseStep("rest", 3.0)],
        channels=CHANNELS,
        reference=[1000.0] * 3,
        calibration=None,
        markers=markers(),
        unit=r.unit,
        layout=layout,
    )
    (folder / "run-1").mkdir()
    write_tracks(folder / "aligned.csv", tracks_of(r))
    write_samples(folder / "samples.csv", r)
    columns = [np.arange(len(r.time)), r.time, *r.signals_at(r.time).T]
    write_csv(folder / "signals.csv", ["frame", "time", *CHANNELS], np.column_stack(columns))
    run = {
        "run": "run-1",
        "begin": float(r.time[0]),
        "end": float(r.time[-1]),
        "steps": [list(step) for step in r.poses],
        "sync": {"error_ms": 3.0},
    }
    quality = {"runs": [run], "skipped": [], "R0": {"run-1": r.rest.tolist()}, "version": "test"}
    (folder / "quality.json").write_text(json.dumps(quality))
    return folder
