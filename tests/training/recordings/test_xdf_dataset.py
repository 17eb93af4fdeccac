"""Datasets of XDF files, read by pyxdf."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.recordings.pair_dataset import RecordingInfo
from defsense_fab.training.recordings.xdf_dataset import xdf_dataset
from tests.support.errors import raises
from tests.training.recordings.files_of_others import markers
from tests.training.recordings.xdf_writer import stream, write_xdf
from tests.training.synthetic import CHANNELS, IDS, R0, recording

START = 5021.25  # s, on the computer's clock
PLACES = [f"tag_{i}_{a}" for i in IDS.tolist() for a in "xyz"]


@pytest.fixture(scope="module")
def r():
    return recording(4, 12.0)


def cords(r, number=1, name="Board", kind="Resistance", labels=CHANNELS, ohm=True, **more):
    values = r.ohm if ohm else r.signals
    more = {"units": "ohm" if ohm else "", "rate": 60.0} | more
    return stream(number, name, kind, list(labels), r.sample_time + START, values, **more)


def mocap(r, labels=PLACES, scale=1.0, number=2, name="Cameras", kind="MoCap", **more):
    values = scale * r.points.reshape(len(r.time), -1)
    return stream(number, name, kind, labels, r.time + START, values, rate=30.0, **more)


@pytest.mark.parametrize("suffix", [".xdf", ".xdfz"])
def test_two_streams_become_a_recording_on_the_common_clock(tmp_path, r, suffix):
    """One stream is from a computer whose clock is 730 s ahead."""
    path = write_xdf(tmp_path / "take.xdf", cords(r), mocap(r, units="mm", clock=730.0))
    if suffix == ".xdfz":
        import gzip

        (tmp_path / "take.xdfz").write_bytes(gzip.compress(path.read_bytes()))
    result = xdf_dataset(tmp_path / f"take{suffix}", RecordingInfo(markers=markers()))
    (got,) = result.recordings
    assert result.channels == CHANNELS
    assert result.ids.tolist() == IDS.tolist()
    np.testing.assert_allclose(got.time, r.time, atol=1e-4)
    np.testing.assert_allclose(got.sample_time, r.sample_time, atol=1e-4)
    np.testing.assert_allclose(got.ohm, r.ohm)
    np.testing.assert_allclose(got.points, r.points)
    assert got.rest == pytest.approx(R0, rel=1e-3)


def test_signals_meters_and_short_labels(tmp_path, r):
    short = [f"{i}_{a.upper()}" for i in IDS.tolist() for a in "xyz"]
    path = write_xdf(
        tmp_path / "take.xdf",
        cords(r, kind="Cords", ohm=False),
        mocap(r, short, scale=1e-3, units="m"),
    )
    (got,) = xdf_dataset(path, RecordingInfo(markers=markers())).recordings
    np.testing.assert_allclose(got.signals, r.signals, atol=1e-12)
    np.testing.assert_allclose(got.points, r.points, atol=1e-9)
    assert (got.rest == 1).all()
    named = [f"{c}_ohm" for c in CHANNELS]
    path = write_xdf(tmp_path / "n.xdf", cords(r, kind="x", labels=named, units=""), mocap(r))
    assert xdf_dataset(path).recordings[0].rest == pytest.approx(R0, rel=1e-3)


def test_streams_are_chosen_by_name_or_type(tmp_path, r):
    spare = cords(r, 7, "Spare", "EEG", ["Cz", "Pz", "Oz"], ohm=False)
    path = write_xdf(tmp_path / "take.xdf", spare, cords(r), mocap(r))
    names = ("Spare", "Board", "Cameras")
    with raises(TrainingError, "stream-ambiguous", content="signals", streams=names):
        xdf_dataset(path)
    for wanted in ("Board", "Resistance"):
        assert xdf_dataset(path, signals=wanted).channels == CHANNELS
    assert xdf_dataset(path, signals="EEG", tracks="Cameras").channels == ("Cz", "Pz", "Oz")
    with raises(TrainingError, "stream-not-found", streams=names):
        xdf_dataset(path, tracks="Rig")
    with raises(TrainingError, "no-markers", stream="Spare"):
        xdf_dataset(path, signals="Board", tracks="Spare")


def test_unusable_files_are_refused(tmp_path, r):
    path = write_xdf(tmp_path / "a.xdf", cords(r))
    with raises(TrainingError, "stream-not-found", content="markers"):
        xdf_dataset(path)
    path = write_xdf(tmp_path / "b.xdf", mocap(r))
    with raises(TrainingError, "stream-not-found", content="signals"):
        xdf_dataset(path)
    path = write_xdf(tmp_path / "c.xdf", cords(r, units="mV"), mocap(r))
    with raises(TrainingError, "unknown-unit", channel="left", unit="mV"):
        xdf_dataset(path)
    path = write_xdf(tmp_path / "d.xdf", cords(r), mocap(r, units="inch"))
    with raises(TrainingError, "unknown-unit", units=("inch",)):
        xdf_dataset(path)
    path = write_xdf(tmp_path / "e.xdf", cords(r, labels=["left", "", "right"]), mocap(r))
    with raises(TrainingError, "labels-invalid", stream="Board"):
        xdf_dataset(path)
    (tmp_path / "f.xdf").write_text("time,a\n")
    with raises(TrainingError, "wrong-file-format"):
        xdf_dataset(tmp_path / "f.xdf")
    with raises(TrainingError, "file-unreadable"):
        xdf_dataset(tmp_path / "none.xdf")


def test_missing_samples_of_a_stream_are_detected(tmp_path, r):
    header, samples, footer = cords(r)
    said = footer.replace(b"<sample_count>720<", b"<sample_count>820<")
    assert said != footer
    path = write_xdf(tmp_path / "take.xdf", (header, samples, said), mocap(r))
    with raises(TrainingError, "file-damaged"):
        xdf_dataset(path)


@pytest.mark.parametrize("part", [0.3, 0.5, 0.9])
def test_truncated_files_are_refused(tmp_path, r, part):
    path = write_xdf(tmp_path / "take.xdf", cords(r), mocap(r))
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    with raises(TrainingError, "file-damaged"):
        xdf_dataset(path)
