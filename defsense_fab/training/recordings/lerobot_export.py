"""A dataset in the folder format of LeRobot, version 2.1, for those who train policies with it.

A run is an episode; `observation.state` are the signals, `action` the markers' coordinates in mm in
the device's frame: what learns the action from the state, decodes. The format has one whole number
of frames a second: each of its frames is the nearest picture there is, NaN where there is none, or
where a marker was not seen; places are never interpolated.

https://github.com/huggingface/lerobot, at version 2.1: meta/{info.json, tasks.jsonl,
episodes.jsonl, episodes_stats.jsonl}, data/chunk-000/episode_000000.parquet.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...core.storage.files import replace_folder, write_text
from ..data.dataset import Dataset, Recording
from .dataset_parquet import parquet_library

_VERSION, _CHUNK = "v2.1", 1000
_FILE = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
_TASK = "tell the markers' places from the signals"
_COUNTS = ("frame_index", "episode_index", "index", "task_index")


def write_lerobot(folder: Path, dataset: Dataset, rate: int | None = None) -> None:
    """Into a `folder` that is not there yet, whole or not at all, at `rate` frames a second (the
    pictures' own). Raises TrainingError for a folder that is there, StorageError."""
    check_free(folder)
    arrow, parquet = parquet_library(folder)
    steps = np.concatenate([np.diff(r.time) for r in dataset.recordings])
    fps = rate or (round(1 / float(np.median(steps))) if len(steps) else 1)
    if fps < 1:
        raise TrainingError(f"{folder}: {fps} frames a second cannot be; give 1 or more")
    with replace_folder(folder) as part:
        (part / "meta").mkdir()
        _write(part, dataset, fps, arrow, parquet)


def check_free(folder: Path) -> None:
    """Raises TrainingError where something is in the way."""
    if folder.exists():
        raise TrainingError(f"{folder}: is there already; name a folder that is not there yet")


def _write(part: Path, dataset: Dataset, fps: int, arrow: Any, parquet: Any) -> None:
    episodes, stats, first = [], [], 0
    for k, recording in enumerate(dataset.recordings):
        columns = _episode(recording, fps, k, first)
        path = part / _FILE.format(episode_chunk=k // _CHUNK, episode_index=k)
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(
            arrow.table({name: _column(arrow, values) for name, values in columns.items()}), path
        )
        length = len(columns["index"])
        first += length
        episodes.append(
            {"episode_index": k, "tasks": [_TASK], "length": length, "recording": recording.name}
        )
        stats.append({"episode_index": k, "stats": {n: _stats(v) for n, v in columns.items()}})
    count = len(episodes)
    places = [f"{i}_{a}" for i in dataset.ids.tolist() for a in "xyz"]
    scalars: dict[str, Any] = {n: _feature("int64", 1) for n in _COUNTS}
    info = {
        "codebase_version": _VERSION, "robot_type": dataset.device, "total_episodes": count,
        "total_frames": first, "total_tasks": 1, "total_videos": 0,
        "total_chunks": (count - 1) // _CHUNK + 1, "chunks_size": _CHUNK, "fps": fps,
        "splits": {"train": f"0:{count}"}, "data_path": _FILE, "video_path": None,
        "features": {
            "observation.state": _feature("float32", len(dataset.channels), list(dataset.channels)),
            "action": _feature("float32", len(places), places),
            "timestamp": _feature("float32", 1), **scalars,
        },
    }  # fmt: skip
    meta = part / "meta"
    write_text(meta / "info.json", json.dumps(info, indent=4) + "\n")
    for name, lines in (
        ("tasks", [{"task_index": 0, "task": _TASK}]),
        ("episodes", episodes),
        ("episodes_stats", stats),
    ):
        text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
        write_text(meta / f"{name}.jsonl", text)


def _feature(kind: str, length: int, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": kind, "shape": [length], "names": names}


def _episode(r: Recording, fps: int, number: int, first: int) -> dict[str, Any]:
    """The columns of a run, at even times."""
    count = int(np.floor((r.time[-1] - r.time[0]) * fps + 1e-6)) + 1
    k = np.arange(count)
    when = r.time[0] + k / fps
    near = np.clip(np.searchsorted(r.time, when), 1, max(len(r.time) - 1, 1))
    near -= when - r.time[near - 1] <= r.time[np.minimum(near, len(r.time) - 1)] - when
    far = np.abs(r.time[near] - when) > 0.5 / fps + 1e-6
    places = r.points[near].reshape(count, -1)
    places[far] = np.nan
    # A picture's own time counts, not that of its place in the grid.
    at = np.where(far, when, r.time[near])
    return {
        "observation.state": r.signals_at(at).astype(np.float32),
        "action": places.astype(np.float32),
        "timestamp": (k / fps).astype(np.float32),
        "frame_index": k,
        "episode_index": np.full(count, number),
        "index": first + k,
        "task_index": np.zeros(count, np.int64),
    }


def _column(arrow: Any, values: Float) -> Any:
    """A list of fixed length a row; of one number, that number."""
    if values.ndim == 1 or values.shape[1] == 1:
        return arrow.array(values.ravel())
    return arrow.FixedSizeListArray.from_arrays(arrow.array(values.ravel()), values.shape[1])


def _stats(values: Float) -> dict[str, Any]:
    """Of columns (n, d), over what is known; zeros where nothing is."""
    table = values.reshape(len(values), -1).astype(float)
    known = [column[np.isfinite(column)] for column in table.T]
    known = [column if len(column) else np.zeros(1) for column in known]
    out: dict[str, Any] = {
        name: [float(of(column)) for column in known]
        for name, of in (("min", np.min), ("max", np.max), ("mean", np.mean), ("std", np.std))
    }
    return out | {"count": [len(values)]}
