"""Tracks are written as CSV and read back."""

import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.capture.files.tracks_csv import read_csv, write_csv
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.core.markers import Tracks
from tests.support.errors import raises

HEADER = "frame,time,id,x,y,z,sx,sy,sz"
ROW = "0,0.5,7,1,2,3,0.1,0.1,0.4"


def random_tracks(t, m, seed=0, missing=0.3, known=True):
    """Return tracks in which every frame and marker is visible at least once."""
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 200, (t, m, 3))
    gone = rng.random((t, m)) < missing
    gone[np.arange(t), np.arange(t) % m] = False
    gone[np.arange(m) % t, np.arange(m)] = False
    points[gone] = np.nan
    sigma = rng.uniform(0.01, 1, (t, m, 3)) if known else np.full((t, m, 3), np.nan)
    sigma[gone] = np.nan
    frame = 3 + np.cumsum(rng.integers(1, 3, t))
    ids = np.sort(rng.choice(50, m, replace=False))
    return Tracks(12.5 + frame / 30, ids, points, sigma, frame)


def same(a, b, places=1e-6, times=1e-9):
    assert a.ids.tolist() == b.ids.tolist()
    assert a.frame.tolist() == b.frame.tolist()
    np.testing.assert_allclose(a.time, b.time, rtol=0, atol=times)
    np.testing.assert_allclose(a.points, b.points, rtol=0, atol=places)
    np.testing.assert_allclose(a.sigma, b.sigma, rtol=0, atol=places)


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 6), st.integers(1, 4), st.integers(0, 99), st.booleans())
def test_round_trip(tmp_path_factory, t, m, seed, known):
    path = tmp_path_factory.mktemp("t") / "tracks.csv"
    tracks = random_tracks(t, m, seed, known=known)
    write_csv(path, tracks)
    same(tracks, read_csv(path))
    assert path.read_text("utf-8").splitlines()[0] == HEADER
    assert [p.name for p in path.parent.iterdir()] == ["tracks.csv"]


def test_markers_that_are_not_visible_have_no_position(tmp_path):
    points = np.full((3, 2, 3), np.nan)
    points[[0, 2], 1] = [[1, 2, 3], [4, 5, 6]]
    tracks = Tracks(np.arange(3.0), np.array([4, 9]), points, points, np.arange(3))
    nothing = Tracks(tracks.time, tracks.ids, points * np.nan, points * np.nan, tracks.frame)
    for of in (tracks, nothing):
        write_csv(tmp_path / "a.csv", of)
        same(of, read_csv(tmp_path / "a.csv"))
    write_csv(tmp_path / "a.csv", tracks)
    nan = ",nan" * 6
    assert (tmp_path / "a.csv").read_text("utf-8").splitlines()[1:4] == [
        f"0,0.000000000,4{nan}", "0,0.000000000,9,1.000000,2.000000,3.000000,1.000000,2.000000,"
        "3.000000", f"1,1.000000000,4{nan}",
    ]  # fmt: skip
    (tmp_path / "b.csv").write_text(HEADER + "\n")
    assert read_csv(tmp_path / "b.csv").points.shape == (0, 0, 3)


def test_rows_in_any_order_and_as_spreadsheets_save_them(tmp_path):
    lines = ["5,0.2,2,1,1,1,nan,nan,nan", "4,0.1,3,2,2,2,nan,nan,nan", "4,0.1,2,3,3,3,nan,nan,nan"]
    path = tmp_path / "a.csv"
    path.write_bytes(("\ufeff" + "\r\n".join([HEADER, *lines, ""])).encode())
    result = read_csv(path)
    assert result.frame.tolist() == [4, 5]
    assert result.points[:, :, 0] == pytest.approx(np.array([[3, 2], [1, np.nan]]), nan_ok=True)


def test_long_table_is_fast(tmp_path):
    tracks = random_tracks(5000, 20, missing=0.1)
    started_at = time.process_time()
    write_csv(tmp_path / "a.csv", tracks)
    result = read_csv(tmp_path / "a.csv")
    assert time.process_time() - started_at < 5
    same(tracks, result)


@pytest.mark.parametrize(
    ("text", "code", "data"),
    [
        ("", "header-wrong", {"line": 1}),
        ("time,id\n1,2\n", "header-wrong", {"line": 1}),
        (f"{HEADER}\n{ROW},5\n", "cell-count-differs", {"line": 2, "count": 10}),
        (f"{HEADER}\n{ROW}\n1,0.6,7,1\n", "cell-count-differs", {"line": 3, "count": 4}),
        (
            f"{HEADER}\n{ROW}\n\n1,0.6,7,1,2,3,a,0.1,0.1\n",
            "not-a-number",
            {"line": 4, "column": "sx", "value": "a"},
        ),
        (
            f"{HEADER}\n{ROW}\n1,0.6,7,1,2,3,,,\n",
            "not-a-number",
            {"line": 3, "column": "sx", "value": ""},
        ),
        (f"{HEADER}\n{ROW}\n1,0.6,7,1,nan,3,1,1,1\n", "not-a-number", {"row": 2}),
        (f"{HEADER}\n{ROW}\n1,0.6,7,1,2,3,1,nan,1\n", "sigma-invalid", {"row": 2}),
        (f"{HEADER}\n{ROW}\n1,0.6,7,1,2,3,1,-1,1\n", "sigma-invalid", {"row": 2}),
        (f"{HEADER}\n{ROW}\n1.5,0.6,7,1,2,3,1,1,1\n", "not-a-whole-number", {"row": 2}),
        (f"{HEADER}\n{ROW}\n1,0.6,7.2,1,2,3,1,1,1\n", "not-a-whole-number", {"row": 2}),
        (f"{HEADER}\n{ROW}\n{ROW}\n", "marker-repeated", {"row": 2}),
        (f"{HEADER}\n{ROW}\n0,0.6,8,1,2,3,1,1,1\n", "times-differ", {"row": 2}),
        (f"{HEADER}\n{ROW}\n1,0.5,7,1,2,3,1,1,1\n", "times-not-increasing", {"row": 2}),
        (b"\xff\xfe\x00", "not-a-tracks-file", {}),
    ],
)
def test_bad_files(tmp_path, text, code, data):
    path = tmp_path / "bad.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with raises(CaptureError, code, **data) as error:
        read_csv(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_missing_file_and_folder(tmp_path):
    with raises(CaptureError, "file-unreadable"):
        read_csv(tmp_path / "none.csv")
    with pytest.raises(StorageError):
        write_csv(tmp_path / "none" / "a.csv", random_tracks(2, 2))


def test_implausibly_many_frames_and_markers_are_rejected_at_once(tmp_path):
    """20,000 rows, each of another frame and marker, would need 19 GB."""
    path = tmp_path / "a.csv"
    rows = (f"{k},{k}.5,{k},1,2,3,nan,nan,nan" for k in range(20_000))
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    tracemalloc.start()
    with raises(CaptureError, "tracks-too-large") as error:
        read_csv(path)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    assert str(error.value).startswith(str(path))
    path.write_text("\n".join([HEADER, *path.read_text("utf-8").split("\n")[1:801]]) + "\n")
    assert read_csv(path).points.shape == (800, 800, 3)
