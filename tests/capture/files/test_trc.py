"""TRC files of other programs: layouts, and faults by their line."""

import pytest

from defsense_fab.capture.files.formats import read_track_file, read_tracks

from .refusals import refused

TRC = (
    "PathFileType\t4\t(X/Y/Z)\twalk.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
    "\tOrigNumFrames\n"
    "60.00\t60.00\t3\t2\tm\t60.00\t1\t3\n"
    "Frame#\tTime\tLASI\t\t\tRASI\t\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "\n"
    "1\t0.00000\t0.1\t0.2\t0.3\t0.4\t0.5\t0.6\n"
    "2\t0.01667\t\t\t\t0.4\t0.5\t0.6\n"
    "3\t0.03333\t0.1\t0.2\t0.3\tnan\tnan\tnan\n"
)


def test_trc_of_other_programs(tmp_path):
    path = tmp_path / "walk.trc"
    for text in (TRC, TRC.replace("\n", "\r\n"), TRC.replace("\n\n", "\n")):
        path.write_text(text, newline="")
        result = read_tracks(path)
        assert result.visible.tolist() == [[True, True], [False, True], [True, False]]
        assert result.points[0].tolist() == [[100, 200, 300], [400, 500, 600]]
        assert result.time.tolist() == [0, 0.01667, 0.03333]


@pytest.mark.parametrize(
    ("old", "new", "code", "data"),
    [
        ("PathFileType", "Path", "not-a-trc-file", {"line": 1}),
        ("\tm\t", "\tfurlong\t", "length-unit-unknown", {"line": 3}),
        ("\t3\t2\tm", "\t3\ttwo\tm", "not-a-number", {"line": 3}),
        ("\t3\t2\tm", "\t3\t1\tm", "labels-differ", {"line": 4, "count": 2}),
        ("\t3\t2\tm", "\t9\t2\tm", "file-truncated", {"count": 3, "frames": 9}),
        ("0.03333", "0.01", "times-not-increasing", {"frame": 3}),
        ("0.1\t0.2\t0.3\tnan", "0.1\tx\t0.3\tnan", "not-a-number", {"line": 9}),
        ("0.1\t0.2\t0.3\tnan", "0.1\t\t0.3\tnan", "marker-incomplete", {"marker": "LASI"}),
        ("nan\tnan\tnan\n", "nan\tnan\tnan\t4\n", "cell-count-differs", {"line": 9, "count": 9}),
        ("3\t0.03333", "3\t", "not-a-number", {"line": 9}),
        ("0.4\t0.5", "0.4\t1_0", "not-a-number", {"line": 7}),
    ],
)
def test_invalid_trc(tmp_path, old, new, code, data):
    path = tmp_path / "bad.trc"
    path.write_text(TRC.replace(old, new))
    refused(path, code, **data)


@pytest.mark.parametrize("lost", range(1, 12))
def test_last_number_that_is_cut_off_is_not_read(tmp_path, lost):
    rows = [[k, f"{k / 60:.5f}", *[f"{100 * k + j:.3f}" for j in range(3)]] for k in range(1, 7)]
    table = "\n".join("\t".join(map(str, row)) for row in rows)
    head = TRC.split("\n")[:3]
    head[2] = "60\t60\t6\t1\tmm\t60\t1\t6"
    text = "\n".join([*head, "Frame#\tTime\ttag_1\t\t", "\t\tX1\tY1\tZ1", "", table])
    path = tmp_path / "cut.trc"
    path.write_text(text)
    whole = read_track_file(path)
    assert len(whole.tracks.time) == 6
    path.write_text(text[:-lost])
    cut = read_track_file(path)
    assert len(cut.tracks.time) == 5
    assert len(cut.notes) == len(whole.notes) + 1
    assert cut.tracks.points.tolist() == whole.tracks.points[:5].tolist()
