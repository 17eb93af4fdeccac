"""Store a dataset in a folder: two tables in Parquet with all metadata.

`samples.parquet` has `recording` (its number), `time` in s, and a resistance `<channel>_ohm` of
each channel. `frames.parquet` has `recording`, `time`, and for each marker `<id>_x`, `_y`, `_z`,
`_sx`, `_sy`, `_sz` in mm. Unknown values are NaN. Both have the same JSON under the key `defsense`
of their schema: schema number, device, layout, channels, markers at rest; of each recording its
session, unit, R0, clock error and poses; provenance; and the SHA-256 of all of this and of the
numbers. Of a sensor that is no device, readings are in `<channel>_reading`, scalar targets in
`<id>_x` and `<id>_sx`, and the JSON has the names and units of both.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...core.machine.optional_libraries import optional
from ...core.storage import typed_json
from ...core.storage.files import replace_folder
from ...core.version import __version__
from ...decoding.quantities import Readings, Targets
from ..data.dataset import Dataset, Recording

SAMPLES, FRAMES = "samples.parquet", "frames.parquet"
SCHEMA = 1

_OHM, _READING = "_ohm", "_reading"  # endings of the names of columns
_KEY = b"defsense"
_READ_KEYS = ("file", "sha256")  # which reading adds to the provenance
_AXES = {3: ("x", "y", "z", "sx", "sy", "sz"), 1: ("x", "sx")}


def write_dataset(path: Path, dataset: Dataset) -> None:
    """Write a dataset into a folder, completely or not at all; an existing dataset is replaced.

    Args:
        path: The folder.
        dataset: The dataset.

    Raises:
        TrainingError: If the folder contains something else, or pyarrow is not installed.
        StorageError: If the folder cannot be written.
    """
    check_folder(path)
    arrow, parquet = parquet_library(path)
    samples, frames = _sample_columns(dataset), _frame_columns(dataset)
    metadata = json.loads(json.dumps(_describe(dataset), allow_nan=False))
    text = json.dumps(metadata | {"sha256": _hash(metadata, samples, frames)})
    with replace_folder(path, overwrite=True) as new:
        for name, columns in ((SAMPLES, samples), (FRAMES, frames)):
            table = arrow.table(columns).replace_schema_metadata({_KEY: text.encode()})
            parquet.write_table(table, new / name)


def check_folder(path: Path) -> None:
    """Raise a TrainingError if a folder contains anything other than a dataset."""
    if not path.exists():
        return
    others = [path] if path.is_file() else sorted(path.iterdir())
    others = [p for p in others if p.name not in (SAMPLES, FRAMES)]
    if others:
        problem = "is a file" if path.is_file() else f"contains {others[0].name}"
        raise TrainingError(
            f"{problem}, is not a dataset, and would be overwritten",
            code="not-a-dataset",
            where=path,
            action="Give another folder",
            file=others[0].name,
        )


def is_dataset(path: Path) -> bool:
    """Return whether a folder contains a dataset."""
    return (path / SAMPLES).exists() or (path / FRAMES).exists()


def read_dataset(path: Path) -> Dataset:
    """Read a dataset that `write_dataset` wrote.

    Args:
        path: The folder.

    Returns:
        The dataset; its provenance has the `file` and the `sha256`.

    Raises:
        TrainingError: If the dataset is incomplete, damaged, changed, or of another schema.
    """
    samples, metadata = _read_parquet(path / SAMPLES)
    frames, other = _read_parquet(path / FRAMES)
    if metadata != other:
        raise TrainingError(
            f"{SAMPLES} and {FRAMES} are of different datasets",
            code="files-differ",
            where=path,
            action="Export it again",
        )
    if metadata.get("schema") != SCHEMA:
        raise TrainingError(
            f"has schema {metadata.get('schema')}, but this version reads schema {SCHEMA}",
            code="wrong-schema",
            where=path,
            action="Export it again",
        )
    if metadata.pop("sha256", None) != (sha256 := _hash(metadata, samples, frames)):
        raise TrainingError(
            "was changed after it was written: its SHA-256 does not match",
            code="content-changed",
            where=path,
            action="Copy it again, or export it again",
        )
    try:
        return _make_dataset(path, metadata | {"sha256": sha256}, samples, frames)
    except (KeyError, TypeError, ValueError) as error:
        raise TrainingError(
            f"is not a dataset as defsense writes it ({error!r})",
            code="file-damaged",
            where=path,
            action="Export it again",
        ) from None


def parquet_library(path: Path) -> tuple[Any, Any]:
    """Return pyarrow and its Parquet module; raise a TrainingError if it is not installed."""
    with optional(TrainingError, path, "exchange"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow, pyarrow.parquet


def _recording_numbers(lengths: list[int]) -> Any:
    return np.repeat(np.arange(len(lengths), dtype=np.int32), lengths)


def _sample_columns(d: Dataset) -> dict[str, Any]:
    ohm = np.concatenate([r.ohm for r in d.recordings])
    suffix = _OHM if d.readings is None else _READING
    return {
        "recording": _recording_numbers([len(r.sample_time) for r in d.recordings]),
        "time": np.concatenate([r.sample_time for r in d.recordings]),
        **{f"{name}{suffix}": ohm[:, k] for k, name in enumerate(d.channels)},
    }


def _frame_columns(d: Dataset) -> dict[str, Any]:
    columns = {
        "recording": _recording_numbers([len(r.time) for r in d.recordings]),
        "time": np.concatenate([r.time for r in d.recordings]),
    }
    points = np.concatenate([r.points for r in d.recordings])
    sigma = np.concatenate([r.sigma for r in d.recordings])
    for k, number in enumerate(d.ids.tolist()):
        both = np.concatenate([points[:, k], sigma[:, k]], axis=1)
        axes = _AXES[points.shape[2]]
        columns |= {f"{number}_{a}": both[:, i] for i, a in enumerate(axes)}
    return columns


def _hash(metadata: Mapping[str, Any], *tables: Mapping[str, Any]) -> str:
    """Return the SHA-256 of all numbers and metadata, except the version that wrote them."""
    rest = {key: value for key, value in metadata.items() if key != "version"}
    h = hashlib.sha256(json.dumps(rest, sort_keys=True).encode())
    for table in tables:
        for name, column in table.items():
            kind = "<i4" if name == "recording" else "<f8"
            h.update(name.encode() + b"\0" + np.ascontiguousarray(column, kind).tobytes())
    return h.hexdigest()


def _to_lists(values: Float) -> Any:
    """Return nested lists with None for NaN."""
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _to_array(values: Any) -> Float:
    return np.array(values, float)  # None becomes NaN


def _describe(d: Dataset) -> dict[str, Any]:
    """Return the metadata of a dataset in plain values."""
    return {
        "schema": SCHEMA,
        "version": __version__,
        "device": d.device,
        "layout": d.layout,
        "channels": list(d.channels),
        "ids": d.ids.tolist(),
        "rest_points": _to_lists(d.rest_points),
        "recordings": [
            {
                "name": r.name,
                "session": r.session,
                "unit": r.unit,
                "rest": _to_lists(r.rest),
                "sync_error": r.sync_error,
                "poses": [list(p) for p in r.poses],
            }
            for r in d.recordings
        ],
        "provenance": {k: v for k, v in d.provenance.items() if k not in _READ_KEYS},
        **({} if d.targets is None else {"targets": typed_json.to_json(d.targets)}),
        **({} if d.readings is None else {"readings": typed_json.to_json(d.readings)}),
    }


def _read_parquet(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the columns of a table, and its metadata."""
    arrow, parquet = parquet_library(path)
    try:
        with path.open("rb") as file:
            table = parquet.read_table(file)
        metadata = json.loads((table.schema.metadata or {})[_KEY])
        columns = {name: table[name].to_numpy() for name in table.column_names}
    except FileNotFoundError:
        raise TrainingError(
            "is missing", code="file-not-found", where=path, action="Copy the whole folder"
        ) from None
    except (arrow.ArrowException, EOFError, OSError):
        raise TrainingError(
            "is not a complete Parquet file",
            code="file-damaged",
            where=path,
            action="Copy it again",
        ) from None
    except (KeyError, ValueError):
        metadata = None
    if not isinstance(metadata, dict):
        raise TrainingError(
            f"is not a dataset: its schema has no JSON object under {_KEY.decode()!r}",
            code="not-a-dataset",
            where=path,
        )
    return columns, metadata


def _make_dataset(
    path: Path, metadata: dict[str, Any], samples: dict[str, Any], frames: dict[str, Any]
) -> Dataset:
    channels, ids = tuple(metadata["channels"]), np.array(metadata["ids"], np.int64)
    targets, readings = _quantities(metadata)
    suffix, r_axes = _OHM if readings is None else _READING, 3 if targets is None else targets.axes
    ohm = np.column_stack([samples[f"{name}{suffix}"] for name in channels])
    axes = _AXES[r_axes]
    both = np.stack(
        [np.column_stack([frames[f"{number}_{a}"] for a in axes]) for number in ids.tolist()], 1
    )
    recordings = []
    for k, r in enumerate(metadata["recordings"]):
        is_sample, is_frame = samples["recording"] == k, frames["recording"] == k
        recordings.append(
            Recording(
                name=str(r["name"]),
                session=str(r["session"]),
                unit=str(r["unit"]),
                sample_time=samples["time"][is_sample],
                ohm=ohm[is_sample],
                rest=_to_array(r["rest"]),
                time=frames["time"][is_frame],
                points=both[is_frame, :, :r_axes],
                sigma=both[is_frame, :, r_axes:],
                sync_error=r["sync_error"],
                poses=tuple((float(at), str(pose)) for at, pose in r["poses"]),
                scale=None if readings is None else readings.scale,
            )
        )
    added = {"file": str(path), "sha256": str(metadata["sha256"])}
    return Dataset(
        str(metadata["device"]),
        str(metadata["layout"]),
        channels,
        ids,
        _to_array(metadata["rest_points"]).reshape(-1, r_axes),
        tuple(recordings),
        dict(metadata["provenance"]) | added,
        targets,
        readings,
    )


def _quantities(metadata: Mapping[str, Any]) -> tuple[Targets | None, Readings | None]:
    """Return the targets and readings of the metadata; None for those of a device."""
    targets, readings = metadata.get("targets"), metadata.get("readings")
    return (
        None
        if targets is None
        else Targets(tuple(targets["names"]), tuple(targets["units"]), int(targets["axes"])),
        None
        if readings is None
        else Readings(
            tuple(readings["units"]),
            _to_array(readings["reference"]),
            _to_array(readings["scale"]),
            str(readings["meaning"]),
        ),
    )
