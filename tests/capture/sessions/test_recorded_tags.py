"""Recorded tags are read back, also from damaged files."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.capture.sessions import session as sessions
from defsense_fab.capture.sessions.recorded_tags import read_camera_tags
from defsense_fab.capture.tags.detection import TagView

TAGS = np.arange(6)


def test_tags_are_read_back_from_their_file(tmp_path):
    rng = np.random.default_rng(0)
    corners = rng.uniform(0, 1000, (3, 4, 2)).round(4)
    root = rng.normal(size=(3, 5, 2, 2)) * 0.02
    views = TagView(np.array([4, 0, 9]), corners, root @ root.swapaxes(2, 3), corners)
    tags = sessions.Stream(tmp_path / "c.csv", sessions.TAG_COLUMNS)
    frames = sessions.Stream(tmp_path / "c-frames.csv", sessions.FRAME_COLUMNS)
    for k in range(3):
        frames.line(f"{k},{10**15 + k},nan")
        if k != 1:
            tags.line(sessions.format_tags(k, 10**15 + k, views))
    tags.line("2,55,")  # cut below
    tags.close()
    frames.close()
    path = tmp_path / "c.csv"
    path.write_bytes(path.read_bytes().removesuffix(b"55,\n"))
    recording = read_camera_tags(tmp_path, "c", np.arange(10))
    assert recording.cut == 1
    assert recording.tags.count.tolist() == [3, 0, 3]
    assert recording.time[2] == 10**15 + 2
    for frame in (0, 2):
        rows = recording.tags.store.read(recording.tags.find(np.array([frame]))[0])
        np.testing.assert_array_equal(rows["id"], [4, 0, 9])
        np.testing.assert_allclose(rows["corners"], corners, atol=1e-9)
        np.testing.assert_allclose(rows["covariance"], views.covariance, rtol=1e-3)


@pytest.mark.parametrize("line", [0, 1, 2, 25, 47, 48, 49])
@pytest.mark.parametrize("wrong", ["9{}", "{}0", "{:.5}", "-{}"])
def test_damaged_time_loses_only_its_line(tmp_path, line, wrong):
    """The time has too many or too few digits; a pause loses no line."""
    times = [5_000_000_000_000 + 33_000_000 * k + 20_000_000_000 * (k > 30) for k in range(50)]
    cells = list(map(str, times))
    (tmp_path / "cam_0.csv").write_text(",".join(sessions.TAG_COLUMNS) + "\n")

    def read():
        rows = "".join(f"{k},{t},1\n" for k, t in enumerate(cells))
        (tmp_path / "cam_0-frames.csv").write_text("frame,host_ns,lamp\n" + rows)
        return read_camera_tags(tmp_path, "cam_0", TAGS)

    assert read().time.tolist() == times
    cells[0] = str(times[0] - 2_000_000_000)  # a camera that stalls after its first picture
    assert read().cut == 0
    cells[0] = str(times[0])
    cells[line] = wrong.format(cells[line])
    recording = read()
    assert recording.cut == 1
    assert recording.time.tolist() == times[:line] + times[line + 1 :]


def test_cut_rows_are_left_out(tmp_path):
    """Rows are also cut where a writer marked one and continued."""
    for name, columns in (("c", sessions.TAG_COLUMNS), ("c-frames", sessions.FRAME_COLUMNS)):
        (tmp_path / f"{name}.csv").write_text(",".join(columns) + "\n")
    with (tmp_path / "c-frames.csv").open("a") as file:
        file.write("0,10,nan\n1,2~\n2,30,nan\n3,4")
    recording = read_camera_tags(tmp_path, "c", TAGS)
    assert recording.time.tolist() == [10, 30]
    assert recording.cut == 2
