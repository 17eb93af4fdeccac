"""The same data in any form trains to the same model."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.core.markers import write_markers_file
from defsense_fab.training.fitting.prepare import prepare
from defsense_fab.training.options import DataFiles, TrainOptions
from defsense_fab.training.recordings.dataset_parquet import write_dataset
from defsense_fab.training.recordings.datasets import load_dataset
from defsense_fab.workflow.train.training import train_dataset
from tests.training.recordings.files_of_others import markers, tracks_of
from tests.training.recordings.session_writer import write_samples, write_session
from tests.training.recordings.xdf_writer import stream, write_xdf
from tests.training.synthetic import CHANNELS, IDS, recording

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def r():
    return recording(5, 40.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("forms")
    write_markers_file(markers(), folder / "markers.json")
    return folder


def trained(files):
    """Return the model and its decoded training data."""
    data, _, _ = prepare(load_dataset(files), None)
    model = train_dataset(data, TrainOptions("quadratic", memory=False)).model
    (own,) = data.recordings
    return model, model.decode(own.sample_time, own.signals, own.time).points


@pytest.fixture(scope="module")
def session(folder, r):
    """Return the session's files."""
    return trained(DataFiles((write_session(folder / "session", r),)))


def parquet(folder, r):
    data = load_dataset(DataFiles((folder / "session",)))
    write_dataset(folder / "dataset", data)
    return DataFiles((folder / "dataset",))


def xdf(folder, r):
    labels = [f"tag_{i}_{a}" for i in IDS.tolist() for a in "xyz"]
    places = r.points.reshape(len(r.time), -1)
    path = write_xdf(
        folder / "take.xdf",
        stream(1, "Board", "Cords", list(CHANNELS), r.sample_time, r.signals),
        stream(2, "Cameras", "MoCap", labels, r.time, places, units="mm"),
    )
    return DataFiles((path,), markers=folder / "markers.json")


def pair(suffix):
    def files(folder, r):
        signals, take = folder / "samples.csv", folder / f"take{suffix}"
        write_tracks(take, tracks_of(r))
        return DataFiles(
            signals=write_samples(signals, r), tracks=take, markers=folder / "markers.json"
        )

    return files


@pytest.mark.parametrize(
    ("form", "mm"),
    [
        (parquet, 0.0),
        (xdf, 1e-3),
        (pair(".csv"), 1e-3),
        (pair(".trc"), 1e-3),
        (pair(".c3d"), 1e-3),
    ],
    ids=["parquet", "xdf", "csv", "trc", "c3d"],
)
def test_every_file_format_gives_the_same_model(folder, r, session, form, mm):
    """Differences are due to rounding: none, 7 digits of text, or single precision."""
    model, points = trained(form(folder, r))
    ours, said = session
    assert model.kind == ours.kind
    np.testing.assert_array_equal(model.ids, ours.ids)
    weights = ours.main.decoder.weights
    off = np.abs(model.main.decoder.weights - weights)
    assert off.max() <= 1e-4 * np.abs(weights).max()
    assert np.isfinite(points).mean() > 0.99
    assert np.nanmax(np.linalg.norm(points - said, axis=2)) <= mm
