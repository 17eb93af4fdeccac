"""Datasets in Parquet and in the format of LeRobot."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from defsense_fab.core.errors import StorageError, TrainingError
from defsense_fab.training.recordings.dataset_parquet import read_dataset, write_dataset
from defsense_fab.training.recordings.lerobot_export import write_lerobot
from tests.support.errors import raises
from tests.training.synthetic import CHANNELS, IDS, dataset, places, recording


@pytest.fixture
def whole():
    first = recording(1, 10.0)
    rest = np.array([1200.0, np.nan, 320.0])
    lost = first.ohm.copy()
    lost[50:90, 1], lost[100, 2] = np.nan, np.inf
    second = recording(2, 8.0, rate=50.0, frames=15.0)
    return dataset(
        replace(first, ohm=lost),
        replace(second, rest=rest, sync_error=None, poses=()),
        provenance={"sessions": [{"folder": "a", "cameras": ["left"]}], "response": None},
    )


def test_a_dataset_round_trip(tmp_path, whole):
    write_dataset(tmp_path / "d", whole)
    again = read_dataset(tmp_path / "d")
    assert (again.device, again.layout, again.channels) == ("bar", "abc", CHANNELS)
    np.testing.assert_array_equal(again.ids, whole.ids)
    np.testing.assert_array_equal(again.rest_points, whole.rest_points)
    assert len(again.recordings) == 2
    for a, b in zip(again.recordings, whole.recordings, strict=True):
        for name in (f.name for f in fields(a)):
            x, y = getattr(a, name), getattr(b, name)
            if isinstance(y, np.ndarray):
                assert x.dtype == y.dtype
                np.testing.assert_array_equal(x, y)
            else:
                assert x == y
    metadata = dict(again.provenance)
    assert len(metadata.pop("sha256")) == 64
    assert metadata.pop("file") == str(tmp_path / "d")
    assert metadata == whole.provenance
    write_dataset(tmp_path / "d", again)  # replaces the first one
    assert read_dataset(tmp_path / "d").provenance["sha256"] == again.provenance["sha256"]


def test_columns_and_metadata_of_the_tables(tmp_path, whole):
    write_dataset(tmp_path / "d", whole)
    samples = pq.read_table(tmp_path / "d" / "samples.parquet")
    assert samples.column_names == ["recording", "time", *(f"{c}_ohm" for c in CHANNELS)]
    frames = pq.read_table(tmp_path / "d" / "frames.parquet")
    assert frames.column_names[2:8] == ["1_x", "1_y", "1_z", "1_sx", "1_sy", "1_sz"]
    metadata = json.loads(frames.schema.metadata[b"defsense"])
    assert metadata["schema"] == 1
    assert metadata["recordings"][1]["rest"] == [1200.0, None, 320.0]


def change_metadata(folder, change):
    """Change the JSON in the schema of both files."""
    for name in ("samples", "frames"):
        table = pq.read_table(folder / f"{name}.parquet")
        metadata = json.loads(table.schema.metadata[b"defsense"]) | change
        other = table.replace_schema_metadata({b"defsense": json.dumps(metadata).encode()})
        pq.write_table(other, folder / f"{name}.parquet")


def test_changed_mixed_and_damaged_files_are_refused(tmp_path, whole):
    folder = tmp_path / "d"
    write_dataset(folder, whole)
    write_dataset(tmp_path / "e", replace(whole, device="bun"))
    good = (folder / "samples.parquet").read_bytes()

    def refused(code):
        with raises(TrainingError, code):
            read_dataset(folder)
        (folder / "samples.parquet").write_bytes(good)

    table = pq.read_table(folder / "samples.parquet")
    shifted = table.set_column(1, "time", pa.array(table["time"].to_numpy() + 0.5))
    pq.write_table(shifted, folder / "samples.parquet")
    refused("content-changed")
    (folder / "samples.parquet").write_bytes((tmp_path / "e" / "samples.parquet").read_bytes())
    refused("files-differ")
    (folder / "samples.parquet").write_bytes(good[: len(good) // 2])
    refused("file-damaged")
    pq.write_table(table.replace_schema_metadata({}), folder / "samples.parquet")
    refused("not-a-dataset")
    (folder / "samples.parquet").unlink()
    refused("file-not-found")
    (folder / "samples.parquet").write_bytes(good)
    for change, code in (({"layout": "x"}, "content-changed"), ({"schema": 2}, "wrong-schema")):
        change_metadata(folder, change)
        with raises(TrainingError, code):
            read_dataset(folder)
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError):
        write_dataset(tmp_path / "file" / "d", whole)


def test_other_folders_are_not_overwritten(tmp_path, whole):
    (tmp_path / "notes.txt").write_text("")
    with raises(TrainingError, "not-a-dataset", file="notes.txt"):
        write_dataset(tmp_path, whole)
    with raises(TrainingError, "not-a-dataset", file="notes.txt"):
        write_dataset(tmp_path / "notes.txt", whole)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_lerobot_folder_has_the_required_files(tmp_path, whole):
    write_lerobot(tmp_path / "out", whole, 30)
    info = json.loads((tmp_path / "out/meta/info.json").read_text(encoding="utf-8"))
    assert info["codebase_version"] == "v2.1"
    assert (info["total_episodes"], info["fps"], info["splits"]) == (2, 30, {"train": "0:2"})
    assert info["features"]["observation.state"]["names"] == list(CHANNELS)
    assert info["features"]["action"]["shape"] == [3 * len(IDS)]
    meta = tmp_path / "out" / "meta"
    lines = {
        name: list(map(json.loads, (meta / f"{name}.jsonl").read_text("utf-8").splitlines()))
        for name in ("tasks", "episodes", "episodes_stats")
    }
    assert lines["tasks"][0]["task_index"] == 0
    tables = []
    for k, episode in enumerate(lines["episodes"]):
        path = info["data_path"].format(episode_chunk=0, episode_index=k)
        table = pq.read_table(tmp_path / "out" / path)
        tables.append(table)
        assert set(table.column_names) == set(info["features"])
        for name, feature in info["features"].items():
            size, kind = feature["shape"][0], pa.type_for_alias(feature["dtype"])
            assert table.schema.field(name).type == (kind if size == 1 else pa.list_(kind, size))
        assert len(table) == episode["length"]
        stamps = table["timestamp"].to_numpy()
        assert stamps[0] == 0
        assert np.diff(stamps) == pytest.approx(1 / 30, abs=1e-4)
        stats = lines["episodes_stats"][k]["stats"]
        assert set(stats) == set(info["features"])
        assert stats["action"]["count"] == [len(table)]
        action = np.stack(table["action"].to_numpy())
        np.testing.assert_allclose(stats["action"]["mean"], np.nanmean(action, 0), rtol=1e-5)
    assert sum(map(len, tables)) == info["total_frames"]
    index = np.concatenate([t["index"].to_numpy() for t in tables])
    np.testing.assert_array_equal(index, np.arange(info["total_frames"]))
    r = whole.recordings[0]
    action = np.stack(tables[0]["action"].to_numpy())
    np.testing.assert_allclose(action, r.points.reshape(len(r.time), -1), rtol=1e-5)
    state = np.stack(tables[0]["observation.state"].to_numpy())
    np.testing.assert_allclose(state[:, 0], r.signals[::2, 0], atol=1e-6)
    # The second recording has 15 frames per second: every other frame has no markers.
    action = np.stack(tables[1]["action"].to_numpy())
    assert np.isnan(action[1::2]).all()
    true = places(np.arange(len(action)) / 30, 2).reshape(len(action), -1)
    assert np.nanmax(np.abs(action - true)) < 0.4
    with raises(TrainingError, "file-exists"):
        write_lerobot(tmp_path / "out", whole)
    write_lerobot(tmp_path / "own", dataset(whole.recordings[1]))
    assert json.loads((tmp_path / "own/meta/info.json").read_text(encoding="utf-8"))["fps"] == 15
