"""Tracks in NPZ, Parquet, C3D and TRC; C3D against an independent reader and a file by Vicon."""

import contextlib
import csv
import struct
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.capture.files.c3d import write_c3d
from defsense_fab.capture.files.formats import read_track_file, read_tracks, write_tracks
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.core.markers import Tracks
from tests.support.errors import raises
from tests.support.places import VICON

from . import c3d_format
from .refusals import refused
from .test_tracks_csv import random_tracks, same
from .test_trc import TRC

SUFFIXES = (".csv", ".npz", ".parquet", ".c3d", ".trc")


@settings(max_examples=10, deadline=None)
@given(st.integers(2, 8), st.integers(1, 4), st.integers(0, 99))
def test_round_trips(tmp_path_factory, t, m, seed):
    """Times, numbers, positions, gaps and frames are kept, and sigma if the format has it."""
    folder, tracks = tmp_path_factory.mktemp("t"), random_tracks(t, m, seed)
    steps = np.diff(tracks.frame)
    frame = tracks.frame if (steps == 1).any() else tracks.frame[0] + np.arange(t)
    tracks = Tracks(12.5 + frame / 30, tracks.ids, tracks.points, tracks.sigma, frame)
    whole = np.arange(frame[0], frame[-1] + 1)
    for suffix in SUFFIXES:
        written = write_tracks(folder / f"a{suffix}", tracks)
        assert (written.frames, written.gaps) == (len(whole), len(whole) - t)
        assert written.rate == pytest.approx(30)
        result = read_tracks(folder / f"a{suffix}")
        assert result.frame.tolist() == whole.tolist()
        assert not result.visible[~np.isin(whole, frame)].any()
        there = np.isin(whole, frame)
        result = Tracks(
            *(result.time[there], result.ids, result.points[there], result.sigma[there]), frame
        )
        known = suffix in (".csv", ".npz", ".parquet")
        sigma = tracks.sigma if known else tracks.sigma * np.nan
        expected = Tracks(tracks.time, tracks.ids, tracks.points, sigma, frame)
        same(expected, result, places=1e-4 if suffix == ".c3d" else 1e-6)
    assert len(list(folder.iterdir())) == len(SUFFIXES)


def test_every_format_has_the_same_frames_and_rate(tmp_path):
    """More than half of the frames are dropped, some are empty, and a marker is never visible."""
    rng = np.random.default_rng(2)
    at = np.sort(rng.choice(np.arange(1, 412), 172, replace=False))
    at = np.concatenate([[0], at, [412]])
    points = rng.normal(0, 100, (174, 3, 3))
    points[rng.random((174, 3)) < 0.3] = np.nan
    points[50:60], points[:, 1] = np.nan, np.nan
    ids = np.array([2, 5, 11])
    tracks = Tracks(3.0 + at / 15, ids, points, np.full(points.shape, np.nan), 4 + np.arange(174))
    read = {}
    for suffix in SUFFIXES:
        written = write_tracks(tmp_path / f"a{suffix}", tracks)
        assert (written.frames, written.gaps) == (413, 239)
        assert written.rate == pytest.approx(15)
        read[suffix] = read_tracks(tmp_path / f"a{suffix}")
    for suffix, result in read.items():
        same(read[".npz"], result, places=1e-4 if suffix == ".c3d" else 1e-6)
        assert 1 / np.median(np.diff(result.time)) == pytest.approx(15)
        assert result.frame.tolist() == list(range(4, 417))
        assert result.ids.tolist() == [2, 5, 11]
        np.testing.assert_allclose(result.points[at], points, atol=1e-4)
        assert result.visible.sum() == tracks.visible.sum()
    head = (tmp_path / "a.trc").read_text("utf-8").splitlines()[2].split("\t")
    assert head[:4] == ["15.000000", "15.000000", "413", "3"]
    assert c3d_format.parse((tmp_path / "a.c3d").read_bytes()).rate == pytest.approx(15)


def test_times_without_a_rate_are_unchanged(tmp_path):
    """A camera slows down in the dark, or one stamp is wrong by far."""
    slower = np.cumsum(np.random.default_rng(0).uniform(0.03, 0.07, 20))
    far = np.append(np.arange(19) / 10, 1e6)
    points = np.ones((20, 1, 3))
    for time, rate in ((slower, None), (far, 10)):
        tracks = Tracks(time, np.array([1]), points, points, np.arange(20))
        for suffix in (".csv", ".npz", ".parquet", ".trc"):
            written = write_tracks(tmp_path / f"a{suffix}", tracks)
            assert written.frames == 20
            assert written.rate == (None if rate is None else pytest.approx(rate))
            result = read_tracks(tmp_path / f"a{suffix}")
            np.testing.assert_allclose(result.time, time)
            assert result.frame.tolist() == list(range(20))
        with pytest.raises(CaptureError):
            write_tracks(tmp_path / "a.c3d", tracks)


def test_c3d_reports_the_largest_time_shift(tmp_path):
    time = np.arange(50) / 50 + np.where(np.arange(50) % 2, 1e-3, -1e-3)
    points = np.ones((50, 1, 3))
    tracks = Tracks(time, np.array([1]), points, points, np.arange(50))
    assert write_tracks(tmp_path / "a.trc", tracks).max_time_shift == 0
    assert write_tracks(tmp_path / "a.c3d", tracks).max_time_shift == pytest.approx(1e-3, rel=0.1)


def test_npz_keeps_everything(tmp_path):
    """Frames and markers that were never visible are kept too."""
    points = np.full((3, 2, 3), np.nan)
    tracks = Tracks(np.arange(3.0), np.array([9, 4]), points, points, 7 + np.arange(3))
    write_tracks(tmp_path / "a.npz", tracks)
    same(tracks, read_tracks(tmp_path / "a.npz"), places=0, times=0)


def test_independent_reader_agrees_on_our_c3d(tmp_path):
    tracks = random_tracks(200, 5, seed=3)
    write_c3d(tmp_path / "a.c3d", tracks)
    result = c3d_format.parse((tmp_path / "a.c3d").read_bytes())
    at = tracks.frame - tracks.frame[0]
    assert result.labels == [f"tag_{i}" for i in tracks.ids]
    assert (result.units, result.first) == ("mm", tracks.frame[0] + 1)
    assert result.rate == pytest.approx(30, rel=1e-6)
    assert result.parameters["POINT", "FRAMES"] == [at[-1] + 1]
    is_visible = np.zeros((at[-1] + 1, 5), bool)
    is_visible[at] = tracks.visible
    np.testing.assert_array_equal(result.residual >= 0, is_visible)
    there = tracks.points[tracks.visible]
    np.testing.assert_array_equal(result.points[is_visible], there.astype(np.float32).astype(float))


def test_marker_at_the_origin_is_kept(tmp_path):
    points = np.zeros((2, 1, 3))
    write_c3d(
        tmp_path / "a.c3d", Tracks(np.arange(2.0), np.array([1]), points, points, np.arange(2))
    )
    assert read_tracks(tmp_path / "a.c3d").visible.all()


def test_times_off_the_grid(tmp_path):
    """Frames after long gaps and with jitter get the nearest grid position, or are rejected."""
    rng = np.random.default_rng(1)
    frame = np.concatenate([np.arange(1000), np.arange(9000, 10000)])
    points = rng.normal(0, 100, (2000, 1, 3))
    time = 77.7 + frame / 29.97 + rng.uniform(-0.003, 0.003, 2000)
    tracks = Tracks(time, np.array([0]), points, points * np.nan, frame)
    write_c3d(tmp_path / "a.c3d", tracks)
    result = read_tracks(tmp_path / "a.c3d")
    assert len(result.time) == 10000
    assert result.frame[result.visible[:, 0]].tolist() == frame.tolist()
    assert abs(result.time[frame] - time).max() < 0.1 / 29.97
    time[1500] += 0.01
    with raises(CaptureError, "times-uneven"):
        write_c3d(tmp_path / "b.c3d", Tracks(time, tracks.ids, points, points * np.nan, frame))
    assert not (tmp_path / "b.c3d").exists()


@pytest.mark.parametrize(
    ("time", "code"),
    [(np.array([1.0]), "times-without-rate"), (np.array([0, 0.01, 700]), "too-many-frames")],
)
def test_tracks_that_c3d_cannot_hold(tmp_path, time, code):
    points = np.ones((len(time), 1, 3))
    frame = np.arange(len(time))
    with raises(CaptureError, code):
        write_c3d(tmp_path / "a.c3d", Tracks(time, np.array([0]), points, points, frame))


@pytest.mark.parametrize("processor", [c3d_format.INTEL, c3d_format.DEC, c3d_format.MIPS])
@pytest.mark.parametrize("scale", [-1.0, 0.01])
@pytest.mark.parametrize(("unit", "factor"), [("mm", 1), ("cm", 10), ("m", 1000)])
def test_all_kinds_of_storage(tmp_path, processor, scale, unit, factor):
    points = np.random.default_rng(5).normal(0, 50, (6, 3, 3))
    points[2, 1] = np.nan
    data = c3d_format.build(points, ["LASI", "M12", "RASI"], 120.0, unit, processor, scale, 61)
    (tmp_path / "a.c3d").write_bytes(data)
    result = read_tracks(tmp_path / "a.c3d")
    assert result.ids.tolist() == [0, 1, 2]
    assert result.time == pytest.approx((60 + np.arange(6)) / 120)
    assert np.isnan(result.sigma).all()
    off = 0.5001 * scale if scale > 0 else 1e-5
    np.testing.assert_allclose(result.points / factor, points, rtol=0, atol=off)
    other = c3d_format.parse(data)
    is_visible = result.visible
    np.testing.assert_allclose(
        other.points[is_visible] * factor, result.points[is_visible], rtol=1e-6
    )
    np.testing.assert_array_equal(other.residual >= 0, is_visible)


def test_zeros_in_foreign_files_are_missing_points(tmp_path):
    points = np.ones((3, 2, 3))
    points[1, 0] = 0
    (tmp_path / "a.c3d").write_bytes(c3d_format.build(points, ["a7", "b3"], 50.0))
    result = read_tracks(tmp_path / "a.c3d")
    assert result.visible.tolist() == [[True, True], [False, True], [True, True]]
    assert result.ids.tolist() == [7, 3]


def test_public_file():
    """A file of Vicon Nexus agrees with the independent reader and with what Nexus exported."""
    tracks = read_tracks(VICON / "vicon_jump.c3d")
    other = c3d_format.parse((VICON / "vicon_jump.c3d").read_bytes())
    assert (other.first, other.rate, other.units, len(other.labels)) == (886, 200.0, "mm", 42)
    kept = [i for i, label in enumerate(other.labels) if not label.startswith("USERMO")]
    kept_labels = [other.labels[i] for i in kept]
    assert tracks.points.shape == (40, 32, 3)
    np.testing.assert_array_equal(tracks.visible, other.residual[:, kept] >= 0)
    assert sorted(set(tracks.visible.sum(1).tolist()))[0] < 32
    np.testing.assert_array_equal(
        tracks.points[tracks.visible], other.points[:, kept][tracks.visible]
    )
    assert tracks.time == pytest.approx(885 / 200 + np.arange(40) / 200)

    with (VICON / "vicon_jump.csv").open(newline="") as file:
        names, _, *rows = csv.reader(file)
    labels = [name.partition(":")[2] for name in names[2::3]]
    assert len(labels) == 22
    assert [int(row[0]) - 1 for row in rows] == tracks.frame.tolist()
    for i, label in enumerate(labels):
        cells = [row[2 + 3 * i : 5 + 3 * i] for row in rows]
        exported = np.array([[float(cell or "nan") for cell in cell3] for cell3 in cells])
        if np.isfinite(exported).all():  # Nexus left out those that it modelled
            ours = tracks.points[:, kept_labels.index(label)]
            np.testing.assert_allclose(ours, exported, rtol=2e-7)  # of single precision


def test_bad_files(tmp_path):
    for suffix in SUFFIXES:
        path = tmp_path / f"a{suffix}"
        refused(path, "file-unreadable")
        path.write_bytes(b"")
        refused(path)
        path.write_text("hello, this is a text\n" * 100)
        refused(path)
        write_tracks(path, random_tracks(40, 3))
        whole = path.read_bytes()
        for part in (len(whole) // 2, 700, 300):
            if part < len(whole) and suffix != ".csv":
                path.write_bytes(whole[:part])
                refused(path)
        with pytest.raises(StorageError):
            write_tracks(tmp_path / "none" / f"a{suffix}", random_tracks(4, 3))
    refused(tmp_path / "a.xlsx", "unknown-format", suffixes=SUFFIXES)
    with raises(CaptureError, "unknown-format"):
        write_tracks(tmp_path / "a", random_tracks(4, 3))


def test_invalid_c3d(tmp_path):
    path = tmp_path / "a.c3d"
    points = np.ones((30, 2, 3))
    path.write_bytes(c3d_format.build(points, ["a", "b"], 50.0)[:-512])
    refused(path, "file-truncated", first=1, last=30, needed=960)
    path.write_bytes(c3d_format.build(points, ["a", "b"], 50.0, units="in"))
    refused(path, "length-unit-unknown", unit="in")
    path.write_bytes(c3d_format.build(points, ["a", "b"], 0.0))
    refused(path, "frame-rate-invalid", rate=0)
    path.write_bytes(c3d_format.build(points[:, :0], [], 50.0))
    refused(path, "markers-missing")
    for suffix in (".c3d", ".trc"):
        none = Tracks(
            np.arange(3.0), *(np.empty(s) for s in (0, (3, 0, 3), (3, 0, 3))), np.arange(3)
        )
        with raises(CaptureError, "markers-missing"):
            write_tracks(tmp_path / f"b{suffix}", none)


def test_invalid_npz_and_parquet(tmp_path):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "a.parquet"
    parquet.write_table(arrow.table({"frame": [1]}), path)
    refused(path, "column-missing", column="time")
    names = ("frame", "time", "id", "x", "y", "z", "sx", "sy", "sz")
    parquet.write_table(arrow.table({name: ["a"] for name in names}), path)
    refused(path, "not-a-number")
    parquet.write_table(arrow.table({name: [1.0, 1.0] for name in names}), path)
    refused(path, "marker-repeated", row=2)
    path = tmp_path / "a.npz"
    good = {"time": np.arange(2.0), "ids": np.array([1]), "frame": np.arange(2)}
    good |= {"points": np.ones((2, 1, 3)), "sigma": np.ones((2, 1, 3))}
    for name, value, code in (
        ("time", np.array([1.0, 0.0]), None),
        ("points", np.ones((2, 2, 3)), None),
        ("time", np.array(["a", "b"]), "not-a-number"),
        ("ids", np.array(1), "wrong-shape"),
        ("frame", np.array([object(), 1]), "file-damaged"),
    ):
        np.savez(path, **(good | {name: value}))
        refused(path, code)
    np.savez(path, time=good["time"])
    refused(path, "array-missing")


def test_files_that_would_fill_the_memory_are_rejected(tmp_path):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "a.trc"
    labels = "\t\t\t".join(f"M{k}" for k in range(3000))
    head = TRC.split("\n")[:5]
    head[2] = head[2].replace("\t3\t2\tm", "\t20000\t3000\tm")
    head[3] = f"Frame#\tTime\t{labels}\t\t"
    path.write_text("\n".join([*head, *(f"{k}\t{k}" for k in range(20_000))]) + "\n")
    refused(path, "tracks-too-large")
    path = tmp_path / "a.parquet"
    names = ("frame", "time", "id", "x", "y", "z", "sx", "sy", "sz")
    parquet.write_table(arrow.table({n: np.zeros(2_000_000) for n in names}), path)
    refused(path, "tracks-too-large")
    path = tmp_path / "a.npz"
    nothing = np.zeros((40_000, 100, 3))
    arrays = {"time": np.arange(4e4), "ids": np.arange(100), "frame": np.arange(40_000)}
    np.savez_compressed(path, points=nothing, sigma=nothing, **arrays)
    refused(path, "tracks-too-large")
    path = tmp_path / "a.c3d"
    data = bytearray(c3d_format.build(np.ones((30, 2, 3)), ["a", "b"], 50.0))
    data[6:10] = struct.pack("<2H", 1, 65535)
    data[16:18] = struct.pack("<H", 1)
    path.write_bytes(data)
    refused(path, "file-truncated", first=1, last=65535)


def test_missing_libraries(tmp_path, monkeypatch):
    def write(path):
        write_tracks(path, random_tracks(3, 2))

    for suffix, name, calls in (
        (".parquet", "pyarrow", (read_tracks, write)),
        (".c3d", "ezc3d", (write,)),
    ):
        monkeypatch.setitem(sys.modules, name, None)
        for call in calls:
            with raises(CaptureError, "library-missing"):
                call(tmp_path / f"a{suffix}")
    (tmp_path / "a.c3d").write_bytes(c3d_format.build(np.ones((3, 1, 3)), ["tag_1"], 50.0))
    assert read_tracks(tmp_path / "a.c3d").ids.tolist() == [1]  # without ezc3d


@given(st.binary(max_size=40), st.integers(0, 2000))
@settings(max_examples=25, deadline=None, derandomize=True)  # a crash would end the run
def test_c3d_with_bytes_changed_is_read_or_rejected(tmp_path_factory, junk, at):
    path = tmp_path_factory.getbasetemp() / "junk.c3d"
    data = bytearray(c3d_format.build(np.ones((10, 2, 3)), ["a", "b"], 50.0))
    data[at : at + len(junk)] = junk
    path.write_bytes(data)
    with contextlib.suppress(CaptureError):
        assert len(read_tracks(path).ids)


@pytest.mark.parametrize("suffix", [".c3d", ".trc", ".npz"])
def test_origins_of_own_files_are_positions(tmp_path, suffix):
    points = np.zeros((3, 1, 3))
    tracks = Tracks(np.arange(3.0), np.array([1]), points, points * np.nan, np.arange(3))
    write_tracks(tmp_path / f"a{suffix}", tracks)
    assert read_tracks(tmp_path / f"a{suffix}").visible.all()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_origins_of_unknown_origin_are_hidden_and_noted(tmp_path, suffix):
    points, sigma = np.zeros((3, 2, 3)), np.full((3, 2, 3), 0.1)
    sigma[:, 1] = np.nan
    tracks = Tracks(np.arange(3.0), np.array([1, 4]), points, sigma, np.arange(3))
    write_tracks(tmp_path / f"a{suffix}", tracks)
    file = read_track_file(tmp_path / f"a{suffix}")
    assert file.tracks.visible.tolist() == [[True, False]] * 3
    assert "tag_4 (3)" in file.notes[0]


def test_the_user_states_a_unit_that_is_missing(tmp_path):
    path = tmp_path / "a.trc"
    path.write_text(TRC.replace("\tm\t", "\t\t"))
    refused(path, "length-unit-unknown", unit="", line=3)
    assert read_track_file(path, "cm").tracks.points[0, 0].tolist() == [1, 2, 3]
    path.write_text(TRC)
    with raises(CaptureError, "unit-conflict", unit="m"):
        read_track_file(path, "mm")
    write_tracks(tmp_path / "a.csv", random_tracks(4, 2))
    assert read_track_file(tmp_path / "a.csv", "mm").tracks.visible.any()
    with raises(CaptureError, "unit-conflict"):
        read_track_file(tmp_path / "a.csv", "m")


@pytest.mark.parametrize(
    ("line", "program"),
    [
        ("Format Version,1.23,Take Name,take", "Motive"),
        ("Trajectories", "Nexus"),
        ("time,x,y,z", None),
    ],
)
def test_tables_of_motion_capture_programs_are_named(tmp_path, line, program):
    (tmp_path / "a.csv").write_text(f"{line}\n1,2,3,4\n")
    refused(tmp_path / "a.csv", "header-wrong", line=1, program=program)


def test_header_and_parameters_that_disagree(tmp_path):
    """The header is used if its length and labels confirm it; otherwise the file is refused."""
    points = np.random.default_rng(0).normal(0, 50, (40, 3, 3))
    path, right = tmp_path / "a.c3d", c3d_format.build(points, ["tag_1", "tag_2", "tag_3"], 50.0)
    path.write_bytes(right.replace(b"USED\x07\0\x02\0\x03\0", b"USED\x07\0\x02\0\x05\0"))
    assert path.read_bytes() != right
    np.testing.assert_allclose(read_tracks(path).points, points, rtol=1e-6)
    data = bytearray(right)
    data[2:4] = struct.pack("<H", 2)
    path.write_bytes(data)
    refused(path, "header-differs", name="points", header=2, parameters=3)


def test_cut_file_whose_length_fits_a_wrong_header(tmp_path):
    points = np.random.default_rng(0).normal(0, 50, (40, 3, 3))
    path = tmp_path / "a.c3d"
    data = bytearray(c3d_format.build(points, ["tag_1", "tag_2", "tag_3"], 50.0))
    data[16:18] = struct.pack("<H", 5)
    path.write_bytes(data[: 512 * 4 + 40 * 3 * 16])
    refused(path, "header-differs", name="start", header=5, parameters=6)
