"""A dataset in a folder of its own: two tables in Parquet with all that there is to know of it.

`samples.parquet`: `recording` (its number), `time` s, and a resistance `<channel>_ohm` of each
channel. `frames.parquet`: `recording`, `time`, and of each marker `<id>_x`, `_y`, `_z`, `_sx`,
`_sy`, `_sz`, mm. NaN where not known. Both have, under the key `defsense` of their schema, the same
JSON: schema number, device, layout, channels, markers at rest, of each recording its session, unit,
R0, error of the clocks and poses, provenance, and the SHA-256 of all of this and of the numbers.
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
from ...core.storage.files import replace_folder
from ...core.version import __version__
from ..data.dataset import Dataset, Recording

SAMPLES, FRAMES = "samples.parquet", "frames.parquet"
SCHEMA = 1
_KEY = b"defsense"
#: What reading adds to the provenance.
_OWN = ("file", "sha256")
_AXES = ("x", "y", "z", "sx", "sy", "sz")


def write_dataset(path: Path, dataset: Dataset) -> None:
    """Into the folder `path`, whole or not at all; a dataset that is there is replaced. Raises
    TrainingError for a folder of something else, and where pyarrow is missing, StorageError."""
    check_folder(path)
    arrow, parquet = parquet_library(path)
    samples, frames = _samples(dataset), _frames(dataset)
    told = json.loads(json.dumps(_about(dataset), allow_nan=False))
    about = json.dumps(told | {"sha256": _hash(told, samples, frames)})
    with replace_folder(path, overwrite=True) as new:
        for name, columns in ((SAMPLES, samples), (FRAMES, frames)):
            table = arrow.table(columns).replace_schema_metadata({_KEY: about.encode()})
            parquet.write_table(table, new / name)


def check_folder(path: Path) -> None:
    """Raises TrainingError for what holds something else than a dataset, which would be lost."""
    if not path.exists():
        return
    others = [path] if path.is_file() else sorted(path.iterdir())
    others = [p for p in others if p.name not in (SAMPLES, FRAMES)]
    if others:
        what = "is there" if path.is_file() else f"holds {others[0].name}"
        raise TrainingError(
            f"{path}: {what}, is no dataset and would be overwritten; give another folder"
        )


def is_dataset(path: Path) -> bool:
    """Whether a folder holds one."""
    return (path / SAMPLES).exists() or (path / FRAMES).exists()


def read_dataset(path: Path) -> Dataset:
    """What `write_dataset` wrote. Raises TrainingError for what is missing, damaged or changed, or
    of another schema."""
    samples, told = _read(path / SAMPLES)
    frames, other = _read(path / FRAMES)
    if told != other:
        raise TrainingError(
            f"{path}: {SAMPLES} and {FRAMES} are of different datasets; export it again"
        )
    if told.get("schema") != SCHEMA:
        raise TrainingError(
            f"{path}: has schema {told.get('schema')}, and this version reads {SCHEMA}; export it"
            " again"
        )
    if told.pop("sha256", None) != (found := _hash(told, samples, frames)):
        raise TrainingError(
            f"{path}: its numbers are not those that were written (their SHA-256 differs); copy it"
            " again, or export it again"
        )
    try:
        return _dataset(path, told | {"sha256": found}, samples, frames)
    except (KeyError, TypeError, ValueError) as error:
        raise TrainingError(
            f"{path}: is not as defsense writes datasets ({error!r}); export it again"
        ) from None


def parquet_library(path: Path) -> tuple[Any, Any]:
    """pyarrow and its Parquet. Raises TrainingError where it is missing."""
    with optional(TrainingError, path, "exchange"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow, pyarrow.parquet


def _numbers(lengths: list[int]) -> Any:
    return np.repeat(np.arange(len(lengths), dtype=np.int32), lengths)


def _samples(d: Dataset) -> dict[str, Any]:
    ohm = np.concatenate([r.ohm for r in d.recordings])
    return {
        "recording": _numbers([len(r.sample_time) for r in d.recordings]),
        "time": np.concatenate([r.sample_time for r in d.recordings]),
        **{f"{name}_ohm": ohm[:, k] for k, name in enumerate(d.channels)},
    }


def _frames(d: Dataset) -> dict[str, Any]:
    out = {
        "recording": _numbers([len(r.time) for r in d.recordings]),
        "time": np.concatenate([r.time for r in d.recordings]),
    }
    points = np.concatenate([r.points for r in d.recordings])
    sigma = np.concatenate([r.sigma for r in d.recordings])
    for k, number in enumerate(d.ids.tolist()):
        both = np.concatenate([points[:, k], sigma[:, k]], axis=1)
        out |= {f"{number}_{a}": both[:, i] for i, a in enumerate(_AXES)}
    return out


def _hash(told: Mapping[str, Any], *tables: Mapping[str, Any]) -> str:
    """Of all numbers, and what is told beside them but for the version that wrote them."""
    rest = {key: value for key, value in told.items() if key != "version"}
    h = hashlib.sha256(json.dumps(rest, sort_keys=True).encode())
    for table in tables:
        for name, column in table.items():
            kind = "<i4" if name == "recording" else "<f8"
            h.update(name.encode() + b"\0" + np.ascontiguousarray(column, kind).tobytes())
    return h.hexdigest()


def _plain(values: Float) -> Any:
    """Nested lists with None for NaN."""
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _array(values: Any) -> Float:
    return np.array(values, float)  # None becomes NaN


def _about(d: Dataset) -> dict[str, Any]:
    return {
        "schema": SCHEMA, "version": __version__, "device": d.device, "layout": d.layout,
        "channels": list(d.channels), "ids": d.ids.tolist(), "rest_points": _plain(d.rest_points),
        "recordings": [
            {
                "name": r.name, "session": r.session, "unit": r.unit, "rest": _plain(r.rest),
                "sync_error": r.sync_error, "poses": [list(p) for p in r.poses],
            }
            for r in d.recordings
        ],
        "provenance": {k: v for k, v in d.provenance.items() if k not in _OWN},
    }  # fmt: skip


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The columns of a table, and what is told beside them."""
    arrow, parquet = parquet_library(path)
    try:
        with path.open("rb") as file:
            table = parquet.read_table(file)
        told = json.loads((table.schema.metadata or {})[_KEY])
        columns = {name: table[name].to_numpy() for name in table.column_names}
    except FileNotFoundError:
        raise TrainingError(f"{path}: is missing; copy the whole folder") from None
    except (arrow.ArrowException, EOFError, OSError):
        raise TrainingError(f"{path}: is no whole Parquet file; copy it again") from None
    except (KeyError, ValueError):
        raise TrainingError(
            f"{path}: is no dataset: its schema has nothing under {_KEY.decode()!r}"
        ) from None
    if not isinstance(told, dict):
        raise TrainingError(f"{path}: is no dataset: {_KEY.decode()!r} holds no JSON object")
    return columns, told


def _dataset(
    path: Path, told: dict[str, Any], samples: dict[str, Any], frames: dict[str, Any]
) -> Dataset:
    channels, ids = tuple(told["channels"]), np.array(told["ids"], np.int64)
    ohm = np.column_stack([samples[f"{name}_ohm"] for name in channels])
    both = np.stack(
        [np.column_stack([frames[f"{number}_{a}"] for a in _AXES]) for number in ids.tolist()], 1
    )
    recordings = []
    for k, r in enumerate(told["recordings"]):
        own, seen = samples["recording"] == k, frames["recording"] == k
        recordings.append(
            Recording(
                str(r["name"]), str(r["session"]), str(r["unit"]), samples["time"][own], ohm[own],
                _array(r["rest"]), frames["time"][seen], both[seen, :, :3], both[seen, :, 3:],
                r["sync_error"], tuple((float(at), str(pose)) for at, pose in r["poses"]),
            )
        )  # fmt: skip
    provenance = dict(told["provenance"]) | {"file": str(path), "sha256": str(told["sha256"])}
    rest = _array(told["rest_points"]).reshape(-1, 3)
    return Dataset(
        str(told["device"]), str(told["layout"]), channels, ids, rest, tuple(recordings), provenance
    )
