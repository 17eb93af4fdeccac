"""Whatever is given is recognised by what is there."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import TrainingError
from defsense_fab.core.markers import write_markers_file
from defsense_fab.training.recordings.dataset_parquet import write_dataset
from defsense_fab.training.recordings.datasets import load_datasets
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


def test_all_kinds_together(files):
    folder, r = files
    found = load_datasets(
        [folder / "d", folder / "a.XDF"], signals=folder / "s.csv", tracks=folder / "t.npz",
        markers=folder / "markers.json", unit="second",
    )  # fmt: skip
    assert [x.unit for x in found.recordings] == ["unit-1", "second", "second"]
    for got, true in zip(found.recordings, r, strict=False):
        np.testing.assert_allclose(got.signals, true.signals, atol=1e-6)
        np.testing.assert_allclose(got.points, true.points, atol=1e-9)
    np.testing.assert_array_equal(found.rest_points, REST)
    assert len(found.provenance["sessions"]) == 2


def test_what_is_given_is_checked(files):
    folder, _ = files
    with pytest.raises(TrainingError, match="a file of signals needs one of tracks with it"):
        load_datasets([], signals=folder / "s.csv")
    with pytest.raises(TrainingError, match="there is nothing to train on"):
        load_datasets([])
    with pytest.raises(TrainingError, match="session-0/run-1 is given twice"):
        load_datasets([folder / "d", folder / "d"])
    with pytest.raises(TrainingError, match="there is no such file or folder"):
        load_datasets([folder / "none"])
    with pytest.raises(TrainingError, match=r"is neither a session .* nor a dataset"):
        load_datasets([folder])
    with pytest.raises(TrainingError, match=r"s\.csv: is no \.xdf file .* with --signals"):
        load_datasets([folder / "s.csv"])


def test_of_a_device_are_its_own_recordings(files):
    """A device that is not built has no order of its channels; its markers are in its folder."""
    folder, _ = files
    shutil.copytree(BAR, folder / "bar", ignore=shutil.ignore_patterns("build", "markers"))
    (folder / "bar" / "markers").mkdir()
    shutil.copy(folder / "markers.json", folder / "bar" / "markers")
    device = load_device(folder / "bar")
    found = load_datasets([folder / "a.XDF"], device)
    assert found.device == device.name
    np.testing.assert_array_equal(found.rest_points, REST)
    with pytest.raises(TrainingError, match="the recordings are of bar, not of other; give this"):
        load_datasets([folder / "d"], replace(device, name="other"))
