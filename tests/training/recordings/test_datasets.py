"""Datasets of files of every kind, detected from their content."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import TrainingError
from defsense_fab.core.markers import write_markers_file
from defsense_fab.training.options import DataFiles
from defsense_fab.training.recordings.dataset_parquet import write_dataset
from defsense_fab.training.recordings.datasets import load_dataset
from tests.support.errors import raises
from tests.support.places import BAR
from tests.training.recordings.files_of_others import markers, tracks_of, write_signals
from tests.training.recordings.xdf_writer import stream, write_xdf
from tests.training.synthetic import CHANNELS, IDS, REST, dataset, recording


@pytest.fixture
def files(tmp_path):
    """One recording in each kind of file."""
    r = [recording(k, 12.0) for k in range(4)]
    write_dataset(tmp_path / "d", dataset(r[0], layout=""))
    labels = [f"{i}_{a}" for i in IDS.tolist() for a in "xyz"]
    write_xdf(
        tmp_path / "a.XDF",
        stream(1, "Board", "Cords", list(CHANNELS), r[1].sample_time, r[1].signals),
        stream(2, "Cams", "MoCap", labels, r[1].time, r[1].points.reshape(len(r[1].time), -1)),
    )
    write_signals(tmp_path / "s.csv", r[2])
    write_tracks(tmp_path / "t.npz", tracks_of(r[2]))
    write_markers_file(markers(), tmp_path / "markers.json")
    return tmp_path, r


def test_all_kinds_of_files_are_joined(files):
    folder, r = files
    data = DataFiles(
        (folder / "d", folder / "a.XDF"),
        signals=folder / "s.csv",
        tracks=folder / "t.npz",
        markers=folder / "markers.json",
        unit="second",
    )
    result = load_dataset(data)
    assert [x.unit for x in result.recordings] == ["unit-1", "second", "second"]
    for got, true in zip(result.recordings, r, strict=False):
        np.testing.assert_allclose(got.signals, true.signals, atol=1e-6)
        np.testing.assert_allclose(got.points, true.points, atol=1e-9)
    np.testing.assert_array_equal(result.rest_points, REST)
    assert len(result.provenance["sessions"]) == 2


def test_invalid_sources_are_refused(files):
    folder, _ = files
    with raises(TrainingError, "file-not-found", missing="tracks"):
        DataFiles(signals=folder / "s.csv")
    with raises(TrainingError, "no-data"):
        load_dataset(DataFiles())
    with raises(TrainingError, "recording-repeated", recording="session-0/run-1"):
        load_dataset(DataFiles((folder / "d", folder / "d")))
    with raises(TrainingError, "file-not-found"):
        load_dataset(DataFiles((folder / "none",)))
    with raises(TrainingError, "not-a-dataset"):
        load_dataset(DataFiles((folder,)))
    with raises(TrainingError, "unknown-format"):
        load_dataset(DataFiles((folder / "s.csv",)))


def test_recordings_must_be_of_the_device(files):
    """A device that is not built has no order of its channels; its markers are in its folder."""
    folder, _ = files
    shutil.copytree(BAR, folder / "bar", ignore=shutil.ignore_patterns("build", "markers"))
    (folder / "bar" / "markers").mkdir()
    shutil.copy(folder / "markers.json", folder / "bar" / "markers")
    device = load_device(folder / "bar")
    result = load_dataset(DataFiles((folder / "a.XDF",)), device)
    assert result.device == device.name
    np.testing.assert_array_equal(result.rest_points, REST)
    with raises(TrainingError, "devices-differ", devices=("other", "bar")):
        load_dataset(DataFiles((folder / "d",)), replace(device, name="other"))


def test_streams_of_xdf_files_are_chosen_by_options(tmp_path):
    r = recording(1, 12.0)
    labels = [f"{i}_{a}" for i in IDS.tolist() for a in "xyz"]
    cords = [
        stream(k, "Board", "Cords", list(CHANNELS), r.sample_time, k * r.signals) for k in (1, 2)
    ]
    cameras = stream(3, "Cams", "MoCap", labels, r.time, r.points.reshape(len(r.time), -1))
    path = write_xdf(tmp_path / "a.xdf", *cords, cameras)
    with raises(TrainingError, "stream-ambiguous", content="signals"):
        load_dataset(DataFiles((path,)))
    result = load_dataset(DataFiles((path,), signals_stream="Board#2", tracks_stream="Cams"))
    np.testing.assert_allclose(result.recordings[0].signals, 2 * r.signals, atol=1e-9)


@pytest.mark.parametrize("option", ["signals_stream", "tracks_stream"])
def test_streams_without_an_xdf_file_are_refused(tmp_path, option):
    with raises(TrainingError, "options-conflict", option=option):
        DataFiles((tmp_path,), **{option: "Board"})
