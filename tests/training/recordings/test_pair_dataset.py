"""Datasets of two files: signals, and tracks of any motion-capture system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.capture.files.formats import write_tracks
from defsense_fab.core.errors import TrainingError
from defsense_fab.core.markers import Tracks
from defsense_fab.training.data.dataset_checks import check_dataset
from defsense_fab.training.recordings.pair_dataset import RecordingInfo, pair_dataset
from tests.support.errors import raises
from tests.training.recordings.files_of_others import markers, tracks_of, write_csv, write_signals
from tests.training.synthetic import CHANNELS, IDS, QUIET, R0, REST, recording


@pytest.fixture(scope="module")
def r():
    return recording(3, 30.0)


def rigid(points, time):
    """Return positions as seen by a fixed system while the device is carried around."""
    turns = Rotation.from_rotvec(
        np.outer(0.3 * np.sin(time), [1, 2, 0.5]) + np.array([0.5, 0.2, -1])
    )
    moved = np.einsum("tij,tmj->tmi", turns.as_matrix(), points)
    return moved + np.stack([50 * np.sin(0.7 * time), 900 + time, 200 - time], axis=1)[:, None]


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet", ".c3d", ".trc"])
def test_tracks_of_every_format_are_combined_with_signals(tmp_path, r, suffix):
    signals = write_signals(tmp_path / "signals.csv", r)
    write_tracks(tmp_path / f"take{suffix}", tracks_of(r))
    result = pair_dataset(signals, tmp_path / f"take{suffix}", RecordingInfo(markers=markers()))
    (got,) = result.recordings
    assert result.channels == CHANNELS
    assert result.device == "bar"
    assert result.ids.tolist() == IDS.tolist()
    np.testing.assert_array_equal(result.rest_points, REST)
    np.testing.assert_allclose(got.time, r.time, atol=1e-4)
    np.testing.assert_allclose(got.sample_time, r.sample_time, atol=1e-5)
    np.testing.assert_allclose(got.signals, r.signals, atol=1e-6)
    np.testing.assert_allclose(got.points, r.points, atol=2e-3)
    notes = result.provenance["sessions"][0]["notes"]
    assert any(note.startswith("R0: unknown") for note in notes)


def test_r0_is_measured_at_rest(tmp_path, r):
    write_tracks(tmp_path / "take.csv", tracks_of(r))
    names = ["time", *(f"{c}_ohm" for c in CHANNELS)]
    path = write_csv(tmp_path / "ohm.csv", names, np.column_stack([r.sample_time, r.ohm]))
    for given, said in ((markers(), "s in which the markers are at rest"), (None, "the first 3 s")):
        result = pair_dataset(path, tmp_path / "take.csv", RecordingInfo(markers=given))
        assert result.recordings[0].rest == pytest.approx(R0, rel=1e-3)
        assert said in " ".join(result.provenance["sessions"][0]["notes"])
        np.testing.assert_allclose(result.recordings[0].ohm, r.ohm, rtol=1e-6)
        np.testing.assert_allclose(result.rest_points, REST, atol=0.05)
    # This device rests later, not at the start.
    later = tracks_of(r)
    start = np.searchsorted(r.time, 8.0)
    points = np.concatenate([r.points[start:], r.points[:start]])
    back = Tracks(later.time, IDS, points, later.sigma, later.frame)
    write_tracks(tmp_path / "later.csv", back)
    split = np.searchsorted(r.sample_time, 8.0)
    ohm = np.concatenate([r.ohm[split:], r.ohm[:split]])
    turned = write_csv(tmp_path / "t.csv", names, np.column_stack([r.sample_time, ohm]))
    result = pair_dataset(turned, tmp_path / "later.csv", RecordingInfo(markers=markers()))
    assert result.recordings[0].rest == pytest.approx(R0, rel=3e-3)
    both = [*names, *CHANNELS]
    whole = np.column_stack([r.sample_time, ohm, ohm / R0 - 1])
    result = pair_dataset(write_csv(tmp_path / "b.csv", both, whole), tmp_path / "take.csv")
    assert result.recordings[0].rest == pytest.approx(R0, rel=1e-5)
    with raises(TrainingError, "quantities-differ", channel="right"):
        pair_dataset(write_csv(tmp_path / "m.csv", both[:-1], whole[:, :-1]), tmp_path / "take.csv")


def test_the_offset_is_given_or_found_by_motion(tmp_path, r):
    signals = write_signals(tmp_path / "s.csv", replace(r, sample_time=r.sample_time + 105.25))
    write_tracks(tmp_path / "take.c3d", tracks_of(r))
    with raises(TrainingError, "no-common-time") as caught:
        pair_dataset(signals, tmp_path / "take.c3d")
    assert caught.value.data["signals"] == pytest.approx((105.25, 135.25), abs=0.1)
    assert caught.value.data["tracks"] == pytest.approx((0.0, 30.0), abs=0.1)
    given = pair_dataset(signals, tmp_path / "take.c3d", RecordingInfo(offset=-105.25)).recordings[
        0
    ]
    assert given.sample_time == pytest.approx(r.sample_time, abs=2e-4)
    assert given.sync_error is None
    result = pair_dataset(signals, tmp_path / "take.c3d", RecordingInfo(offset="auto")).recordings[
        0
    ]
    # A fifth of the signal relaxes, so it leads.
    assert result.sample_time == pytest.approx(r.sample_time, abs=0.06)
    assert 0 < result.sync_error < 0.05
    assert np.abs(result.sample_time - r.sample_time).mean() < 0.03
    still = tracks_of(r).select(r.time < QUIET)
    write_tracks(tmp_path / "still.csv", still)
    with raises(TrainingError, "offset-not-found"):
        pair_dataset(signals, tmp_path / "still.csv", RecordingInfo(offset="auto"))


def test_tracks_in_another_frame_are_aligned_to_the_rest_pose(tmp_path, r):
    signals = write_signals(tmp_path / "s.csv", r)
    take = replace(
        tracks_of(r), points=rigid(r.points, r.time), sigma=np.full(r.points.shape, np.nan)
    )
    write_tracks(tmp_path / "take.trc", take)
    result = pair_dataset(signals, tmp_path / "take.trc", RecordingInfo(markers=markers()))
    (got,) = result.recordings
    off = np.linalg.norm(got.points - r.points, axis=2)
    assert np.nanmedian(off) < 0.2
    assert np.isfinite(off).mean() > 0.9
    assert "aligned by anchor" in " ".join(result.provenance["sessions"][0]["notes"])
    # Tracks with other rest positions do not match, however they are aligned.
    wrong = replace(markers(), centers=REST[[4, 2, 0, 1, 3]] * [1, 1, 2])
    with raises(TrainingError, "not-in-device-frame"):
        pair_dataset(signals, tmp_path / "take.trc", RecordingInfo(markers=wrong))
    meters = replace(take, points=r.points / 1000)
    write_tracks(tmp_path / "m.csv", meters)
    with raises(TrainingError, "not-in-device-frame"):
        pair_dataset(signals, tmp_path / "m.csv", RecordingInfo(markers=markers()))
    exchanged = replace(take, ids=IDS[[1, 0, 2, 3, 4]])
    write_tracks(tmp_path / "e.csv", exchanged)
    with raises(TrainingError, "markers-misplaced"):
        pair_dataset(signals, tmp_path / "e.csv", RecordingInfo(markers=markers()))
    others = replace(take, ids=IDS + 30)
    write_tracks(tmp_path / "o.csv", others)
    with raises(TrainingError, "markers-differ", found=(31, 32, 35, 37, 38)):
        pair_dataset(signals, tmp_path / "o.csv", RecordingInfo(markers=markers()))


@pytest.mark.parametrize(
    ("table", "code", "data"),
    [
        ("a,b\n1,2\n", "column-missing", {"column": "time"}),
        ("time,a\n0,0.1\n20,0.1\n40,0.2\n", "wrong-unit", {"quantity": "times", "step": 20.0}),
        ("time,a\n0,1200\n0.1,1201\n0.2,1200\n", "signals-too-large", {"value": 1200.0}),
        ("time,a,a\n0,1,1\n", "column-repeated", {"column": "a"}),
        ("0,1,2\n", "header-missing", {}),
        ("", "file-empty", {}),
        ("time,a\n0,x\n", "not-a-number", {"column": "a", "line": 2}),
        ("time,a\n0,\n0.1,\n", "no-samples", {}),
        ("time,frame\n0,1\n0.1,2\n", "no-samples", {}),
        ("run,time,a\nx,0,1\ny,0.1,1\n", "several-runs", {"count": 2}),
    ],
)
def test_unusable_tables_are_refused(tmp_path, r, table, code, data):
    (tmp_path / "s.csv").write_text(table)
    write_tracks(tmp_path / "take.csv", tracks_of(r).select(slice(0, 10)))
    with raises(TrainingError, code, **data):
        pair_dataset(tmp_path / "s.csv", tmp_path / "take.csv")


def test_rows_without_signals_are_ignored(tmp_path, r):
    """`capture process` writes such rows for dropped frames."""
    lines = write_signals(tmp_path / "s.csv", r).read_text(encoding="utf-8").splitlines()
    for k in range(600, 720):
        lines[k] = ",".join(lines[k].split(",")[:2]) + ",,,,"
    (tmp_path / "s.csv").write_text("\n".join(lines))
    write_tracks(tmp_path / "take.csv", tracks_of(r))
    result = pair_dataset(
        tmp_path / "s.csv", tmp_path / "take.csv", RecordingInfo(markers=markers())
    )
    assert len(result.recordings[0].sample_time) == len(r.sample_time) - 120
    assert {p.code for p in check_dataset(result)} == {"few-frames"}


def test_tracks_without_visible_markers_are_refused(tmp_path, r):
    nothing = replace(tracks_of(r), points=np.full_like(r.points, np.nan))
    nothing = replace(nothing, sigma=nothing.points)
    write_tracks(tmp_path / "take.csv", nothing)
    signals = write_signals(tmp_path / "s.csv", r)
    with raises(TrainingError, "no-markers", frames=900):
        pair_dataset(signals, tmp_path / "take.csv")
    with raises(TrainingError, "file-not-found"):
        pair_dataset(tmp_path / "none.csv", tmp_path / "take.csv")


def test_samples_and_frames_keep_their_own_rates(tmp_path):
    """Samples between frames are kept, and nothing is interpolated between samples."""
    for frames in (15.0, 30.0):
        r = recording(5, 20.0, rate=60.0, frames=frames)
        write_tracks(tmp_path / "take.csv", tracks_of(r))
        got = pair_dataset(write_signals(tmp_path / "s.csv", r), tmp_path / "take.csv").recordings[
            0
        ]
        assert len(got.sample_time) == 1200
        assert len(got.time) == 20 * frames
        assert np.diff(got.sample_time) == pytest.approx(1 / 60, abs=1e-5)
        assert np.diff(got.time) == pytest.approx(1 / frames, abs=1e-5)
        np.testing.assert_allclose(got.signals, r.signals, atol=1e-6)


def test_movement_during_the_initial_rest_is_noted(tmp_path, r):
    signals = write_signals(tmp_path / "signals.csv", r)
    later = r.time > QUIET + 5
    tracks = tracks_of(r).select(later)
    write_tracks(tmp_path / "take.csv", tracks)
    notes = pair_dataset(signals, tmp_path / "take.csv").provenance["sessions"][0]["notes"]
    assert any("R0 are wrong" in note for note in notes)
    notes = pair_dataset(
        signals, tmp_path / "take.csv", RecordingInfo(markers=markers())
    ).provenance
    assert not any("R0 are wrong" in note for note in notes["sessions"][0]["notes"])


def rename(path, labels):
    """Replace labels in a file of tracks by others of the same length."""
    text = path.read_text(encoding="utf-8")
    for old, new in labels.items():
        assert text.count(f"{old}\t") == 1
        text = text.replace(f"{old}\t", f"{new}\t")
    path.write_text(text, encoding="utf-8")


def test_other_markers_in_the_volume_change_nothing_and_are_noted(tmp_path, r):
    signals, path = write_signals(tmp_path / "s.csv", r), tmp_path / "take.trc"
    write_tracks(path, tracks_of(r))
    expected = pair_dataset(signals, path, RecordingInfo(markers=markers()))
    points = np.concatenate([r.points + 500, r.points], axis=1)[:, 4:]
    more = Tracks(r.time, np.array([99, *IDS]), points, points * np.nan, np.arange(len(r.time)))
    for name in ("wand", "*60", "rod3"):
        write_tracks(path, more)
        rename(path, {"tag_99": name})
        result = pair_dataset(signals, path, RecordingInfo(markers=markers()))
        assert result.ids.tolist() == expected.ids.tolist()
        np.testing.assert_array_equal(result.recordings[0].points, expected.recordings[0].points)
        assert any(name in note for note in result.provenance["sessions"][0]["notes"])


def test_labels_without_numbers_are_refused_for_a_device_with_markers(tmp_path, r):
    signals, path = write_signals(tmp_path / "s.csv", r), tmp_path / "take.trc"
    write_tracks(path, tracks_of(r))
    rename(path, {f"tag_{i}": f"SI{'ABCDEFGHIJ'[i]}" for i in IDS.tolist()})
    with raises(TrainingError, "markers-differ"):
        pair_dataset(signals, path, RecordingInfo(markers=markers()))
    assert pair_dataset(signals, path).ids.tolist() == list(range(len(IDS)))
