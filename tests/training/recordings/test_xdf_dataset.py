"""Datasets of XDF files, read by pyxdf."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.recordings.pair_dataset import RecordingInfo
from defsense_fab.training.recordings.xdf_dataset import xdf_dataset
from tests.support.errors import raises
from tests.training.recordings.files_of_others import markers
from tests.training.recordings.xdf_writer import stream, write_xdf
from tests.training.synthetic import CHANNELS, IDS, R0, recording

pytestmark = pytest.mark.slow

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
    points = more.pop("points", r.points)
    values = scale * points.reshape(len(r.time), -1)
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
    with raises(TrainingError, "file-not-found"):
        xdf_dataset(tmp_path / "none.xdf")


def notes_of(dataset):
    (session,) = dataset.provenance["sessions"]
    return session["notes"]


def test_missing_samples_of_a_stream_are_noted(tmp_path, r):
    header, samples, footer = cords(r)
    stated = footer.replace(b"<sample_count>720<", b"<sample_count>820<")
    assert stated != footer
    path = write_xdf(tmp_path / "take.xdf", (header, samples, stated), mocap(r))
    whole = xdf_dataset(write_xdf(tmp_path / "whole.xdf", cords(r), mocap(r)))
    result = xdf_dataset(path)
    assert len(notes_of(result)) == len(notes_of(whole)) + 1
    assert result.recordings[0].sample_time.tolist() == whole.recordings[0].sample_time.tolist()


@pytest.mark.parametrize("share", [0.7, 0.9])
def test_truncated_files_are_read_up_to_the_cut(tmp_path, r, share):
    path = write_xdf(tmp_path / "take.xdf", cords(r), mocap(r))
    (whole,) = xdf_dataset(path).recordings
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    result = xdf_dataset(path)
    (part,) = result.recordings
    count = len(part.time)
    assert 0.2 < count / len(r.time) < 1
    np.testing.assert_array_equal(part.points, whole.points[:count])
    np.testing.assert_allclose(part.time, whole.time[:count], atol=1e-6)
    assert len(notes_of(result)) > len(notes_of(xdf_dataset(write_xdf(path, cords(r), mocap(r)))))


def test_file_without_its_tracks_is_refused(tmp_path, r):
    path = write_xdf(tmp_path / "take.xdf", cords(r), mocap(r))
    path.write_bytes(path.read_bytes()[:600])
    with raises(TrainingError, "file-damaged"):
        xdf_dataset(path)


def test_streams_of_a_restarted_sender_are_joined(tmp_path, r):
    first, second = select(r, slice(0, 300)), select(r, slice(420, None))
    path = write_xdf(tmp_path / "take.xdf", cords(first), cords(second, 3), mocap(r))
    whole = xdf_dataset(write_xdf(tmp_path / "whole.xdf", cords(r), mocap(r))).recordings[0]
    result = xdf_dataset(path)
    (joined,) = result.recordings
    is_recorded = np.r_[0:300, 420:720]
    np.testing.assert_allclose(joined.sample_time, whole.sample_time[is_recorded], atol=1e-6)
    np.testing.assert_array_equal(joined.ohm, whole.ohm[is_recorded])
    assert xdf_dataset(path, signals="Board").recordings[0].ohm.shape == joined.ohm.shape
    assert len(xdf_dataset(path, signals="Board#1").recordings[0].ohm) == 300


def test_streams_of_one_name_that_overlap_are_chosen_by_number(tmp_path, r):
    path = write_xdf(tmp_path / "take.xdf", cords(r), cords(r, 3), mocap(r))
    for requested in (None, "Board", "Resistance"):
        with raises(TrainingError, "stream-ambiguous", content="signals"):
            xdf_dataset(path, signals=requested)
    assert xdf_dataset(path, signals="Board#3").channels == CHANNELS


def test_zeros_of_unseen_markers_are_absent(tmp_path, r):
    points = np.nan_to_num(r.points, nan=0.0)
    points[100:140, 2] = 0
    points[200:210, 3] = np.nan
    is_absent = ~(np.isfinite(points) & (points != 0)).all(axis=2)
    path = write_xdf(tmp_path / "take.xdf", cords(r), mocap(r, points=points))
    (result,) = xdf_dataset(path).recordings
    np.testing.assert_array_equal(np.isnan(result.points).all(axis=2), is_absent)


def test_other_markers_do_not_renumber_tags(tmp_path, r):
    labels = [f"wand1_{a}" for a in "xyz"] + PLACES
    points = np.concatenate([np.ones((len(r.time), 1, 3)), r.points], axis=1)
    path = write_xdf(tmp_path / "take.xdf", cords(r), mocap(r, labels, points=points))
    result = xdf_dataset(path)
    assert result.ids.tolist() == IDS.tolist()
    np.testing.assert_allclose(result.recordings[0].points, r.points)


def test_labels_that_repeat_numbers_are_not_numbers_of_markers(tmp_path, r):
    labels = [f"{'abcde'[k]}1_{axis}" for k in range(len(IDS)) for axis in "xyz"]
    path = write_xdf(tmp_path / "take.xdf", cords(r), mocap(r, labels))
    with raises(TrainingError, "markers-differ"):
        xdf_dataset(path, RecordingInfo(markers=markers()))


def test_pauses_keep_the_times_around_them(tmp_path, r):
    """A pause of 3 s must not be spread over the samples before and after it."""
    rest = np.r_[0:200, 380:720]
    path = write_xdf(tmp_path / "take.xdf", cords(select(r, rest)), mocap(r))
    (result,) = xdf_dataset(path).recordings
    np.testing.assert_allclose(result.sample_time, r.sample_time[rest], atol=1e-3)


def select(r, rows):
    """Return a recording of some samples."""
    return replace(r, sample_time=r.sample_time[rows], ohm=r.ohm[rows])


def test_lost_offsets_of_a_clock_are_refused(tmp_path, r):
    """Its first chunks hold the only offsets of a clock that is 730 s ahead."""
    header, samples, footer = mocap(r, clock=730.0)
    damaged = samples[:8] + b"\xff" * 40 + samples[48:]
    path = write_xdf(tmp_path / "take.xdf", cords(r), (header, damaged, footer))
    with raises(TrainingError, "clock-unknown", stream="Cameras"):
        xdf_dataset(path)
