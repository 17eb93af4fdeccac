"""Videos of the twin's cameras, good and bad, to tracks."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from defsense_fab.capture.cameras.rig_file import write_rig
from defsense_fab.capture.files.formats import read_tracks, write_tracks
from defsense_fab.capture.files.track_conversion import change_axes
from defsense_fab.capture.videos.video_tracks import process_videos
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CaptureError, DeviceError, StorageError
from defsense_fab.twin.scenes.scene import Scene
from defsense_fab.workflow.sessions.options import ConversionOptions, VideoOptions
from defsense_fab.workflow.sessions.track_files import convert_tracks, track_videos
from tests.support.errors import raises
from tests.support.films import LEFT, RIGHT, SIZE, aligned, images, tags, take
from tests.twin.film import Shutter, load_truth

pytestmark = pytest.mark.slow


def scene(t):
    return Scene(tags(t))


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    folder = tmp_path_factory.mktemp("films")
    take(folder / "a.mkv", LEFT, scene)
    take(folder / "b.mkv", RIGHT, scene)
    take(folder / "late.mkv", RIGHT, lambda t: scene(t + 0.05))
    write_rig(folder / "cameras.toml", [LEFT, RIGHT], {})
    write_rig(folder / "one.toml", [LEFT], {})
    return folder


@pytest.fixture
def process(films):
    """Make tracks from videos of the folder; return them and their quality."""

    def run(*videos, calibration="cameras.toml", size=SIZE, family="4X4_50", **options):
        paths = [films / video for video in videos]
        result = process_videos(paths, films / calibration, size, family, **options)
        return result.tracks, result.quality

    return run


def codes(quality):
    return [warning.code for warning in quality["warnings"]]


@pytest.fixture
def refuse(films, tmp_path, monkeypatch):
    """Run the command `process`; check that it raises an error and writes nothing."""
    monkeypatch.chdir(films)

    def run(kind, code, *more, out=None, **data):
        words = ["--videos", "a.mkv", "b.mkv", "--calibration", "cameras.toml"]
        words += ["--tag-size", str(SIZE), "--out", str(out or tmp_path / "out.csv")]
        before = {p: p.stat().st_mtime_ns for p in tmp_path.iterdir()}
        with raises(kind, code, **data):
            run_command(["capture", "process", *words, *more])
        assert before == {p: p.stat().st_mtime_ns for p in tmp_path.iterdir()}

    return run


@pytest.fixture
def undetected(monkeypatch):
    """No video is read: tests of what is checked before."""
    monkeypatch.setattr("defsense_fab.capture.videos.video_tracks.detect_videos", None)


def compare(tracks, path):
    """Return errors (n, 3) mm in the first camera's frame, in units of sigma, and aligned (n,)."""
    truth = load_truth(path.with_suffix(".npz"))
    exact = LEFT.to_camera(truth.centers)[tracks.frame][:, np.searchsorted(truth.ids, tracks.ids)]
    error = tracks.points - exact
    visible = tracks.visible
    rigid = [aligned(p[v], e[v]) for p, e, v in zip(tracks.points, exact, visible, strict=True)]
    return error[visible], (error / tracks.sigma)[visible], np.concatenate(rigid)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def test_two_cameras(process, films):
    tracks, quality = process("a.mkv", "b.mkv")
    error, z, rigid = compare(tracks, films / "a.mkv")
    assert len(error) == 18 * 6
    assert rms(np.linalg.norm(error, axis=1)) < 0.04  # of 300 mm, at 340 px
    assert rms(rigid) < 0.03
    assert rms(z) < 1.3
    assert tracks.time == pytest.approx(np.arange(18) / 30, abs=1e-3)
    assert quality["warnings"] == []
    assert quality["offsets"] == [0, 0]
    assert quality["size"] == pytest.approx(SIZE, abs=0.02)


def test_frames_of_the_tracks(process, films):
    truth = load_truth(films / "a.npz").centers
    own, quality = process("a.mkv", "b.mkv")
    assert "left" in quality["frame"]
    world, quality = process("a.mkv", "b.mkv", world=True)
    assert "cameras.toml" in quality["frame"]
    assert np.abs(LEFT.rotation - np.eye(3)).max() > 0.5  # another frame than the first camera's
    assert rms(np.linalg.norm(world.points - truth[world.frame], axis=-1)) < 0.05
    assert np.allclose(LEFT.to_camera(world.points), own.points, atol=1e-3)
    x, y, z = np.moveaxis(own.points, -1, 0)
    sx, sy, sz = np.moveaxis(own.sigma, -1, 0)
    for up, axes, sigma in (("y", (x, -y, -z), (sx, sy, sz)), ("z", (x, z, -y), (sx, sz, sy))):
        tracks = change_axes(own, "camera", up)
        assert np.allclose(tracks.points, np.stack(axes, -1), atol=0)
        assert np.allclose(tracks.sigma, np.stack(sigma, -1), atol=0)


def test_only_the_axes_of_the_first_camera_are_turned(refuse, undetected):
    refuse(CaptureError, "options-conflict", "--frame", "world", "--up", "y", option="up")


def test_converted_tracks_are_turned_on_request(process, tmp_path):
    tracks, _ = process("a.mkv", "b.mkv")
    source, out, back = (tmp_path / n for n in ("out.csv", "z.npz", "back.csv"))
    write_tracks(source, tracks)
    tracks = read_tracks(source)
    convert_tracks(source, out, ConversionOptions(up="z", source_up="camera"))
    x, y, z = np.moveaxis(tracks.points, -1, 0)
    assert np.allclose(read_tracks(out).points, np.stack([x, z, -y], -1), atol=0)
    run_command(["capture", "convert", str(out), str(back), "--up", "y", "--source-up", "z"])
    assert np.allclose(read_tracks(back).points, np.stack([x, -y, -z], -1), atol=0)
    result = convert_tracks(source, back)
    assert result.frame == "unchanged"
    assert np.allclose(read_tracks(back).points, tracks.points, atol=0)


@pytest.mark.parametrize(("given", "missing"), [("up", "source_up"), ("source_up", "up")])
def test_both_axes_are_needed_to_turn_tracks(tmp_path, given, missing):
    with raises(CaptureError, "options-incomplete", option=missing):
        convert_tracks(tmp_path / "a.csv", tmp_path / "b.csv", ConversionOptions(**{given: "y"}))


def test_one_camera_gives_an_uncertain_depth(process, films):
    tracks, quality = process("a.mkv", calibration="one.toml")
    error, z, _ = compare(tracks, films / "a.mkv")
    assert rms(error[:, 2]) < 0.6
    assert np.median(tracks.sigma[..., 2]) > 3 * np.median(tracks.sigma[..., 0])
    assert rms(z) < 1.3
    assert quality["residual"] is None


def test_videos_that_started_at_different_times(process, films):
    tracks, quality = process("a.mkv", "late.mkv")
    assert quality["offsets"] == pytest.approx([0, 0.05], abs=1e-3)
    assert codes(quality)[0] == "videos-not-synchronous"
    _, z, rigid = compare(tracks, films / "a.mkv")
    assert rms(rigid) < 0.1  # the last frames have one camera
    assert rms(z) < 1.5
    again, quality = process("a.mkv", "late.mkv", offsets=[1, 1.05])
    assert quality["offsets"] == pytest.approx([0, 0.05])
    assert np.nanmax(np.abs(again.points - tracks.points)) < 0.3
    assert again.time[0] == 0  # of the first video, whatever is added


def test_other_rates_codecs_and_folders_of_images(process, films):
    take(films / "slow.avi", RIGHT, scene, shutter=Shutter(rate=20.0), codec="MJPG")
    tracks, _ = process("a.mkv", "slow.avi")
    error, z, _ = compare(tracks, films / "a.mkv")
    assert rms(np.linalg.norm(error, axis=1)) < 0.2
    assert rms(z) < 1.3
    (films / "pictures").mkdir()
    for k, image in enumerate(images(films / "b.mkv")):
        cv2.imwrite(str(films / "pictures" / f"{k:02d}.png"), image)
    with_images, _ = process("a.mkv", "pictures", rate=30.0)
    plain, _ = process("a.mkv", "b.mkv")
    assert with_images.points == pytest.approx(plain.points, abs=1e-6)
    with raises(CaptureError, "frame-rate-missing"):
        process("a.mkv", "pictures")


def test_damaged_videos(process, films):
    whole = (films / "b.mkv").read_bytes()
    bad = bytearray(whole)
    for k in np.random.default_rng(0).integers(len(bad) // 3, len(bad), 300):
        bad[k] ^= 0xFF
    (films / "bad.mkv").write_bytes(bytes(bad))
    tracks, quality = process("a.mkv", "bad.mkv")
    error, z, _ = compare(tracks, films / "a.mkv")
    assert "frames-repeated" in codes(quality)
    assert np.abs(error).max() < 1.0
    assert rms(z) < 1.3
    (films / "half.mkv").write_bytes(whole[: len(whole) // 2])
    _, quality = process("a.mkv", "half.mkv")
    assert "video-ends-early" in codes(quality)
    for name, content in (("empty", b""), ("text", b"hello\n" * 999), ("head", whole[:3000])):
        (films / f"{name}.mkv").write_bytes(content)
        with raises(CaptureError, "video-unreadable") as caught:
            process("a.mkv", f"{name}.mkv")
        assert caught.value.where.endswith(f"{name}.mkv")


def test_cameras_that_do_not_belong_to_the_videos(process, films):
    text = (films / "cameras.toml").read_text("utf-8")

    def check(code, calibrated, videos=("a.mkv", "b.mkv"), **data):
        write_rig(films / "x.toml", calibrated, {})
        with raises(CaptureError, code, **data):
            process(*videos, calibration="x.toml")

    check("camera-order-differs", [LEFT, RIGHT], ("b.mkv", "a.mkv"))
    in_m = [replace(c, translation=1e-3 * c.translation) for c in (LEFT, RIGHT)]
    check("tag-size-wrong", in_m)
    check("image-size-differs", [replace(c, size=(640, 480)) for c in (LEFT, RIGHT)])
    moved = replace(RIGHT, translation=RIGHT.translation + np.array([0, 60, 0]))
    check("calibration-wrong", [LEFT, moved])
    check("camera-poses-missing", [replace(c, translation=np.zeros(3)) for c in (LEFT, RIGHT)])
    check("camera-count-differs", [LEFT, RIGHT], ("a.mkv",), cameras=2, count=1)
    check("video-repeated", [LEFT, RIGHT], ("a.mkv", "a.mkv"))
    for pattern, value, code in (
        (r"translation = \[[^,]*", "translation = [nan", None),
        (r"size = .*", "size = [nan, 360]", "not-a-number"),
        (r"size = .*", "size = [1e300, 360]", "image-size-invalid"),
        (r"matrix = .*", 'matrix = "no"', "not-a-number"),
    ):
        (films / "x.toml").write_text(re.sub(pattern, value, text, count=1))
        with pytest.raises(CaptureError) as caught:
            process("a.mkv", "b.mkv", calibration="x.toml")
        assert code in (None, caught.value.code)
        assert str(caught.value).count("x.toml") == 1
        assert caught.value.data["table"] == "cam_0"


def test_wrong_tags(process, films):
    with raises(CaptureError, "tag-size-wrong") as caught:
        process("a.mkv", "b.mkv", size=20)
    assert caught.value.data["measured"] == pytest.approx(22, abs=0.5)
    with raises(CaptureError, "no-tag-in-video"):
        process("a.mkv", "b.mkv", family="APRILTAG_36H11")

    def twice(t):
        return Scene(tags(t, [0, 1, 2, 3, 4, 0]))

    def nothing(t):
        return Scene(tuple(p.moved_to(np.array([0, -900.0, 0]), p.axes) for p in tags(t)))

    take(films / "twice.mkv", LEFT, twice, 0.3)
    tracks, quality = process("twice.mkv", "b.mkv")
    assert (np.isin(tracks.ids, range(6))).all()
    assert "tags-repeated" in codes(quality)
    take(films / "nothing.mkv", RIGHT, nothing, 0.3)
    _, quality = process("a.mkv", "nothing.mkv")
    assert "no-tag-in-video" in codes(quality)


def test_repeated_tags_are_named_if_none_can_be_located(process, films):
    def one_number(t):
        return Scene(tags(t, [0] * 6))

    for name, camera in (("same_left", LEFT), ("same_right", RIGHT)):
        take(films / f"{name}.mkv", camera, one_number, 0.3)
    with raises(CaptureError, "no-tag-located") as caught:
        process("same_left.mkv", "same_right.mkv")
    assert list(caught.value.data["repeated"].values()) == [[0], [0]]


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"offsets": [0.0]}, "offset-count-differs"),
        ({"offsets": [0.0, np.nan]}, "offset-invalid"),
        ({"family": "9X9"}, "unknown-tag-dictionary"),
        ({"size": np.nan}, "out-of-range"),
    ],
)
def test_invalid_arguments_are_refused_before_detection(process, monkeypatch, options, code):
    monkeypatch.setattr("defsense_fab.capture.videos.video_tracks.detect_videos", None)
    with raises(CaptureError, code):
        process("a.mkv", "b.mkv", **options)


@pytest.mark.parametrize(
    ("kind", "code", "words"),
    [
        (DeviceError, "argument-invalid", ("--offsets", "0,x")),
        (CaptureError, "out-of-range", ("--rate", "nan")),
        (CaptureError, "out-of-range", ("--smooth", "0")),
        (DeviceError, "options-conflict", ("--align", "all")),
        (DeviceError, "options-incomplete", ("session",)),
    ],
)
def test_invalid_options_are_refused_before_detection(refuse, undetected, kind, code, words):
    refuse(kind, code, *words)


def test_options_of_videos_do_not_apply_to_sessions(tmp_path):
    with raises(DeviceError, "options-conflict", option="--tag-size"):
        run_command(["capture", "process", str(tmp_path), "--tag-size", "15"])


def test_size_of_the_tags_is_required():
    with raises(CaptureError, "options-incomplete", option="tag_size"):
        track_videos(VideoOptions(videos=(Path("a.mkv"),)))


def test_offsets_may_be_negative(process, films, tmp_path, monkeypatch):
    monkeypatch.chdir(films)
    out = tmp_path / "out.csv"
    words = ["--videos", "a.mkv", "late.mkv", "--tag-size", str(SIZE), "--out", str(out)]
    run_command(["capture", "process", *words, "--offsets=-1,-0.95"])
    tracks, _ = process("a.mkv", "late.mkv", offsets=[-1, -0.95])
    assert np.allclose(read_tracks(out).points, tracks.points, atol=1e-3, equal_nan=True)


def test_outputs_that_cannot_be_written_are_refused_before_detection(
    refuse, undetected, films, tmp_path
):
    (films / "dir.csv").mkdir()
    refuse(StorageError, "folder-not-found", out=tmp_path / "none" / "x.csv")
    refuse(StorageError, "not-a-file", out=films / "dir.csv")
    refuse(CaptureError, "unknown-format", out=tmp_path / "x.docx")


def test_full_disk_leaves_no_file(refuse, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("defsense_fab.core.storage.files.Path.replace", full)
    refuse(StorageError, "disk-full")
