"""Videos of the twin's cameras, good and bad, to tracks."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from defsense_fab.capture.cameras.rig_file import write_rig
from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.twin.scenes.scene import Scene
from tests.support.films import LEFT, RIGHT, SIZE, aligned, command, images, tags, take, told
from tests.twin.film import Shutter, load_truth


def scene(t):
    return Scene(tags(t))


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    folder = tmp_path_factory.mktemp("films")
    take(folder / "a.mkv", LEFT, scene)
    take(folder / "b.mkv", RIGHT, scene)
    take(folder / "late.mkv", RIGHT, lambda t: scene(t + 0.05))
    take(folder / "long.mkv", LEFT, scene, 2.0)
    take(folder / "drops.mkv", RIGHT, scene, 2.0, Shutter(dropped=0.05), seed=3)
    write_rig(folder / "cameras.toml", [LEFT, RIGHT], {})
    write_rig(folder / "one.toml", [LEFT], {})
    return folder


@pytest.fixture
def process(films, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(films)

    def run(*videos, calibration="cameras.toml", size=SIZE, out=None, more=()):
        out = out or tmp_path / "out.csv"
        before = {p: p.stat().st_mtime_ns for p in tmp_path.iterdir()}
        code, said, errors = command(
            capsys, "capture", "process", "--videos", *videos, "--calibration", calibration,
            "--tag-size", size, "--out", out, "--json", *more,
        )  # fmt: skip
        if code:
            assert (code, len(errors), said) == (2, 1, "")
            assert before == {p: p.stat().st_mtime_ns for p in tmp_path.iterdir()}
            return errors[0]
        assert not errors
        return read_tracks(out), told(said)

    return run


def compare(tracks, path):
    """Errors (n, 3) mm in the first camera's frame, in units of sigma, and after alignment (n,)."""
    truth = load_truth(path.with_suffix(".npz"))
    exact = LEFT.to_camera(truth.centers)[tracks.frame][:, np.searchsorted(truth.ids, tracks.ids)]
    error = tracks.points - exact
    seen = tracks.seen
    rigid = [aligned(p[s], e[s]) for p, e, s in zip(tracks.points, exact, seen, strict=True)]
    return error[seen], (error / tracks.sigma)[seen], np.concatenate(rigid)


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
    assert quality["frame"] == "of camera left, x right, y down, z ahead"
    world, quality = process("a.mkv", "b.mkv", more=["--frame", "world"])
    assert quality["frame"] == "the world of cameras.toml"
    assert np.abs(LEFT.rotation - np.eye(3)).max() > 0.5  # another frame than the first camera's
    assert rms(np.linalg.norm(world.points - truth[world.frame], axis=-1)) < 0.05
    assert np.allclose(LEFT.to_camera(world.points), own.points, atol=1e-3)
    x, y, z = np.moveaxis(own.points, -1, 0)
    sx, sy, sz = np.moveaxis(own.sigma, -1, 0)
    for up, axes, sigma in (("y", (x, -y, -z), (sx, sy, sz)), ("z", (x, z, -y), (sx, sz, sy))):
        tracks, quality = process("a.mkv", "b.mkv", more=["--up", up])
        assert f"{up} up" in quality["frame"]
        assert np.allclose(tracks.points, np.stack(axes, -1), atol=0)
        assert np.allclose(tracks.sigma, np.stack(sigma, -1), atol=0)
    assert "--source-up" in process("a.mkv", "b.mkv", more=["--frame", "world", "--up", "y"])


def test_converted_tracks_are_turned_when_asked(process, tmp_path, capsys):
    tracks, _ = process("a.mkv", "b.mkv")

    def convert(*words):
        return command(capsys, "capture", "convert", *words)

    source, out, back = (tmp_path / n for n in ("out.csv", "z.npz", "back.csv"))
    code, said, _ = convert(source, out, "--up", "z", "--source-up", "camera")
    assert code == 0
    assert "frame: x right, y ahead, z up" in said
    x, y, z = np.moveaxis(tracks.points, -1, 0)
    assert np.allclose(read_tracks(out).points, np.stack([x, z, -y], -1), atol=0)
    assert "y up" in convert(out, back, "--up", "y", "--source-up", "z")[1]
    assert np.allclose(read_tracks(back).points, np.stack([x, -y, -z], -1), atol=0)
    assert "frame: as it was" in convert(source, back)[1]
    assert np.allclose(read_tracks(back).points, tracks.points, atol=0)
    code, _, (error,) = convert(source, back, "--up", "y")
    assert code == 2
    assert "--source-up" in error
    assert "--up" in convert(source, back, "--source-up", "y")[2][0]


def test_one_camera_says_how_uncertain_its_depth_is(process, films):
    tracks, quality = process("a.mkv", calibration="one.toml")
    error, z, _ = compare(tracks, films / "a.mkv")
    assert rms(error[:, 2]) < 0.6
    assert np.median(tracks.sigma[..., 2]) > 3 * np.median(tracks.sigma[..., 0])
    assert rms(z) < 1.3
    assert quality["residual"] is None


def test_videos_that_began_apart(process, films):
    tracks, quality = process("a.mkv", "late.mkv")
    assert quality["offsets"] == pytest.approx([0, 0.05], abs=1e-3)
    assert "not in step" in quality["warnings"][0]
    _, z, rigid = compare(tracks, films / "a.mkv")
    assert rms(rigid) < 0.1  # the last frames have one camera
    assert rms(z) < 1.5
    again, quality = process("a.mkv", "late.mkv", more=["--offsets", "1,1.05"])
    assert quality["offsets"] == pytest.approx([0, 0.05])
    assert np.nanmax(np.abs(again.points - tracks.points)) < 0.3
    assert again.time[0] == 0  # of the first video, whatever is added


def test_lost_frames_without_a_gap_in_the_stamps(process, films):
    truth = load_truth(films / "drops.npz")
    assert (np.diff(truth.number) > 1).sum() >= 2
    tracks, quality = process("long.mkv", "drops.mkv")
    assert any("fell out of step" in w for w in quality["warnings"])
    error, z, _ = compare(tracks, films / "long.mkv")
    assert np.abs(error).max() < 1.0  # one frame too late is 3 mm and more
    assert np.median(np.linalg.norm(error, axis=1)) < 0.04
    assert rms(z) < 1.5


def test_other_rates_codecs_and_folders_of_images(process, films):
    take(films / "slow.avi", RIGHT, scene, shutter=Shutter(rate=20.0), codec="MJPG")
    tracks, _ = process("a.mkv", "slow.avi")
    error, z, _ = compare(tracks, films / "a.mkv")
    assert rms(np.linalg.norm(error, axis=1)) < 0.2
    assert rms(z) < 1.3
    (films / "pictures").mkdir()
    for k, image in enumerate(images(films / "b.mkv")):
        cv2.imwrite(str(films / "pictures" / f"{k:02d}.png"), image)
    with_images, _ = process("a.mkv", "pictures", more=["--rate", "30"])
    plain, _ = process("a.mkv", "b.mkv")
    assert with_images.points == pytest.approx(plain.points, abs=1e-6)
    assert "--rate" in process("a.mkv", "pictures")


def test_damaged_videos(process, films):
    whole = (films / "b.mkv").read_bytes()
    bad = bytearray(whole)
    for k in np.random.default_rng(0).integers(len(bad) // 3, len(bad), 300):
        bad[k] ^= 0xFF
    (films / "bad.mkv").write_bytes(bytes(bad))
    tracks, quality = process("a.mkv", "bad.mkv")
    error, z, _ = compare(tracks, films / "a.mkv")
    assert any("picture before once more" in w for w in quality["warnings"])
    assert np.abs(error).max() < 1.0
    assert rms(z) < 1.3
    (films / "half.mkv").write_bytes(whole[: len(whole) // 2])
    _, quality = process("a.mkv", "half.mkv")
    assert any("ends early" in w for w in quality["warnings"])
    for name, content in (("empty", b""), ("text", b"hello\n" * 999), ("head", whole[:3000])):
        (films / f"{name}.mkv").write_bytes(content)
        assert f"{name}.mkv" in process("a.mkv", f"{name}.mkv")


def test_cameras_that_are_not_those_of_the_videos(process, films):
    text = (films / "cameras.toml").read_text("utf-8")

    def error(cameras, *videos, **options):
        if isinstance(cameras, str):
            (films / "x.toml").write_text(cameras)
        else:
            write_rig(films / "x.toml", cameras, {})
        return process(*(videos or ("a.mkv", "b.mkv")), calibration="x.toml", **options)

    assert "another order" in error([LEFT, RIGHT], "b.mkv", "a.mkv")
    assert "another order" in error([RIGHT, LEFT])
    for unit, factor in (("m", 1e-3), ("cm", 0.1)):
        scaled = [replace(c, translation=factor * c.translation) for c in (LEFT, RIGHT)]
        assert f"is in {unit}, it must be in mm" in error(scaled)
    assert "resolution" in error([replace(c, size=(640, 480)) for c in (LEFT, RIGHT)])
    moved = replace(RIGHT, translation=RIGHT.translation + np.array([0, 60, 0]))
    assert "been moved" in error([LEFT, moved])
    assert "arrange" in error([replace(c, translation=np.zeros(3)) for c in (LEFT, RIGHT)])
    assert "2 cameras (left, right), there are 1" in error([LEFT, RIGHT], "a.mkv")
    assert "given twice" in error([LEFT, RIGHT], "a.mkv", "a.mkv")
    for pattern, value in (
        (r"translation = \[[^,]*", "translation = [nan"), (r"size = .*", "size = [nan, 360]"),
        (r"size = .*", "size = [1e300, 360]"), (r"matrix = .*", 'matrix = "no"'),
    ):  # fmt: skip
        said = error(re.sub(pattern, value, text, count=1))
        assert said.count("x.toml") == 1
        assert "[cam_0]" in said


def test_wrong_tags(process, films):
    said = process("a.mkv", "b.mkv", size=20)
    assert "look 22 mm large" in said
    said = process("a.mkv", "b.mkv", more=["--dictionary", "APRILTAG_36H11"])
    assert "give --dictionary 4X4_50" in said

    def twice(t):
        return Scene(tags(t, [0, 1, 2, 3, 4, 0]))

    def nothing(t):
        return Scene(tuple(p.moved_to(np.array([0, -900.0, 0]), p.axes) for p in tags(t)))

    take(films / "twice.mkv", LEFT, twice, 0.3)
    tracks, quality = process("twice.mkv", "b.mkv")
    assert (np.isin(tracks.ids, range(6))).all()
    assert any("tags 0 twice" in w for w in quality["warnings"])
    take(films / "nothing.mkv", RIGHT, nothing, 0.3)
    _, quality = process("a.mkv", "nothing.mkv")
    assert any("no tag in any frame" in w for w in quality["warnings"])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--offsets", "0"], "1 given for 2"), (["--offsets", "0,nan"], "give seconds"),
        (["--offsets", "0,x"], "write numbers"), (["--rate", "nan"], "frames per second"),
        (["--smooth", "0"], "give seconds"), (["--dictionary", "9X9"], "not known"),
        (["--tag-size", "nan"], "black square"),
    ],
)  # fmt: skip
def test_bad_options_are_refused_before_the_work(process, monkeypatch, more, words):
    monkeypatch.setattr("defsense_fab.capture.videos.video_tracks.detect_video", None)
    assert words in process("a.mkv", "b.mkv", more=more)


def test_places_that_cannot_be_written(process, films, tmp_path, monkeypatch):
    monkeypatch.setattr("defsense_fab.capture.videos.video_tracks.detect_video", None)
    assert "no folder" in process("a.mkv", "b.mkv", out=tmp_path / "none" / "x.csv")
    assert "suffixes" in process("a.mkv", "b.mkv", out=tmp_path / "x.docx")
    (films / "dir.csv").mkdir()
    assert "is a folder" in process("a.mkv", "b.mkv", out=films / "dir.csv")


def test_a_full_disk(process, films, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("defsense_fab.core.storage.files.Path.replace", full)
    assert "disk is full" in process("a.mkv", "b.mkv")
