"""Write datasets in the folder format of LeRobot, version 2.1, for training policies.

A run is an episode. `observation.state` are the signals; `action` are the markers' coordinates in
mm in the device's rest frame. A policy that predicts the action from the state is a decoder. The
format has a whole number of frames per second: each of its frames is the nearest camera frame, with
NaN where there is none or a marker was not visible. Positions are never interpolated.

References:
    https://github.com/huggingface/lerobot, version 2.1: meta/{info.json, tasks.jsonl,
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

_VERSION, _CHUNK_EPISODES = "v2.1", 1000
_EPISODE_FILE = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
_TASK = "find the places of the markers from the signals"
_COUNTERS = ("frame_index", "episode_index", "index", "task_index")


def write_lerobot(folder: Path, dataset: Dataset, rate: int | None = None) -> None:
    """Write a dataset in the format of LeRobot, completely or not at all.

    Args:
        folder: Folder to create.
        dataset: The dataset.
        rate: Frames per second; None for that of the cameras.

    Raises:
        TrainingError: If the folder exists, the rate is below 1, the targets are no markers, or
            pyarrow is not installed.
        StorageError: If the folder cannot be written.
    """
    if dataset.targets is not None:
        raise TrainingError(
            "has positions of markers only, not other targets",
            code="targets-differ",
            where="lerobot",
            action="Export the dataset in Parquet",
        )
    check_free(folder)
    arrow, parquet = parquet_library(folder)
    steps = np.concatenate([np.diff(r.time) for r in dataset.recordings])
    fps = rate or (round(1 / float(np.median(steps))) if len(steps) else 1)
    if fps < 1:
        raise TrainingError(
            f"must be 1 or more, not {fps}",
            code="out-of-range",
            where="rate",
            action="Give the frames per second of the export",
        )
    with replace_folder(folder) as part:
        (part / "meta").mkdir()
        _write_dataset(part, dataset, fps, arrow, parquet)


def check_free(folder: Path) -> None:
    """Raise a TrainingError if a folder exists."""
    if folder.exists():
        raise TrainingError(
            "exists already",
            code="file-exists",
            where=folder,
            action="Name a folder that does not exist",
        )


def _write_dataset(part: Path, dataset: Dataset, fps: int, arrow: Any, parquet: Any) -> None:
    episodes, statistics, first = [], [], 0
    for k, recording in enumerate(dataset.recordings):
        columns = _make_episode(recording, fps, k, first)
        path = part / _EPISODE_FILE.format(episode_chunk=k // _CHUNK_EPISODES, episode_index=k)
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(
            arrow.table({name: _to_column(arrow, values) for name, values in columns.items()}), path
        )
        length = len(columns["index"])
        first += length
        episodes.append(
            {"episode_index": k, "tasks": [_TASK], "length": length, "recording": recording.name}
        )
        stats = {name: _statistics(values) for name, values in columns.items()}
        statistics.append({"episode_index": k, "stats": stats})
    meta = part / "meta"
    info = _describe(dataset, fps, len(episodes), first)
    write_text(meta / "info.json", json.dumps(info, indent=4) + "\n")
    for name, lines in (
        ("tasks", [{"task_index": 0, "task": _TASK}]),
        ("episodes", episodes),
        ("episodes_stats", statistics),
    ):
        text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
        write_text(meta / f"{name}.jsonl", text)


def _describe(dataset: Dataset, fps: int, episodes: int, frames: int) -> dict[str, Any]:
    """Return the content of info.json."""
    coordinates = [f"{i}_{a}" for i in dataset.ids.tolist() for a in "xyz"]
    channels = list(dataset.channels)
    return {
        "codebase_version": _VERSION,
        "robot_type": dataset.device,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "total_videos": 0,
        "total_chunks": (episodes - 1) // _CHUNK_EPISODES + 1,
        "chunks_size": _CHUNK_EPISODES,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": _EPISODE_FILE,
        "video_path": None,
        "features": {
            "observation.state": _feature("float32", len(channels), channels),
            "action": _feature("float32", len(coordinates), coordinates),
            "timestamp": _feature("float32", 1),
            **{name: _feature("int64", 1) for name in _COUNTERS},
        },
    }


def _feature(kind: str, length: int, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": kind, "shape": [length], "names": names}


def _make_episode(r: Recording, fps: int, number: int, first: int) -> dict[str, Any]:
    """Return the columns of a run, at even times."""
    count = int(np.floor((r.time[-1] - r.time[0]) * fps + 1e-6)) + 1
    k = np.arange(count)
    grid = r.time[0] + k / fps
    nearest = np.clip(np.searchsorted(r.time, grid), 1, max(len(r.time) - 1, 1))
    last = len(r.time) - 1
    nearest -= grid - r.time[nearest - 1] <= r.time[np.minimum(nearest, last)] - grid
    is_missing = np.abs(r.time[nearest] - grid) > 0.5 / fps + 1e-6
    positions = r.points[nearest].reshape(count, -1)
    positions[is_missing] = np.nan
    # The time of the frame counts, not that of its position in the grid.
    times = np.where(is_missing, grid, r.time[nearest])
    return {
        "observation.state": r.signals_at(times).astype(np.float32),
        "action": positions.astype(np.float32),
        "timestamp": (k / fps).astype(np.float32),
        "frame_index": k,
        "episode_index": np.full(count, number),
        "index": first + k,
        "task_index": np.zeros(count, np.int64),
    }


def _to_column(arrow: Any, values: Float) -> Any:
    """Return a column of lists of fixed length, or of numbers if the length is 1."""
    if values.ndim == 1 or values.shape[1] == 1:
        return arrow.array(values.ravel())
    return arrow.FixedSizeListArray.from_arrays(arrow.array(values.ravel()), values.shape[1])


def _statistics(values: Float) -> dict[str, Any]:
    """Return statistics of columns (n, d) over known values; zeros for columns without any."""
    table = values.reshape(len(values), -1).astype(float)
    known = [column[np.isfinite(column)] for column in table.T]
    known = [column if len(column) else np.zeros(1) for column in known]
    statistics: dict[str, Any] = {
        name: [float(function(column)) for column in known]
        for name, function in (("min", np.min), ("max", np.max), ("mean", np.mean), ("std", np.std))
    }
    return statistics | {"count": [len(values)]}
