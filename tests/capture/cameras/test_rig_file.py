"""Cameras in files of aniposelib's convention."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.cameras.rig_file import read_rig, write_rig
from defsense_fab.core.errors import CaptureError
from tests.capture.rigs import rig

#: As aniposelib 0.8 (CameraGroup.dump, by the package toml) writes it.
ANIPOSE = """[cam_0]
name = "A"
size = [ 1280, 720,]
matrix = [ [ 900.0, 0.0, 640.5,], [ 0.0, 901.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.1, 0.02, 0.001, -0.002, 0.0,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]

[cam_1]
name = "B"
size = [ 1280, 720,]
matrix = [ [ 900.0, 0.0, 640.5,], [ 0.0, 901.0, 360.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.1,]
rotation = [ 0.0, 1.5707963267948966, 0.0,]
translation = [ 100.0, 2.0, 300.0,]

[metadata]
adjusted = false
error = 0.21
"""


def test_file_of_aniposelib_is_read(tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(ANIPOSE)
    result = read_rig(path)
    assert [c.name for c in result.cameras] == ["A", "B"]
    assert result.placed
    assert result.metadata == {"adjusted": False, "error": 0.21}
    b = result.cameras[1]
    assert np.allclose(b.rotation, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    assert b.translation.tolist() == [100, 2, 300]
    assert b.distortions.tolist() == [-0.1, 0, 0, 0, 0]
    assert b.size == (1280, 720)


def test_written_cameras_are_read_back(tmp_path):
    path, cameras = tmp_path / "cameras.toml", rig(3)
    metadata = {"error": 0.2, "note": 'a "b" \\ \t\n\x07\x7f ü', "views": [3, 4], "good": True}
    write_rig(path, cameras, metadata)
    back = read_rig(path)
    assert back.metadata == metadata
    for a, b in zip(cameras, back.cameras, strict=True):
        assert (a.name, a.size) == (b.name, b.size)
        assert np.allclose(a.matrix, b.matrix, atol=0)
        assert np.allclose(a.distortions, b.distortions, atol=0)
        assert np.allclose(a.rotation, b.rotation, atol=1e-14)
        assert np.allclose(a.translation, b.translation, atol=0)
    keys = {"name", "size", "matrix", "distortions", "rotation", "translation"}
    assert set(tomllib.loads(path.read_text("utf-8"))["cam_2"]) == keys


@pytest.mark.parametrize("name", ["GoPro 1", "käse", "cam.left", "clip (1)", "it's", "[a]=#"])
def test_names_and_their_keys_are_read_back(tmp_path, name):
    path = tmp_path / "cameras.toml"
    sigma = {f"sigma_{name}": [1.0, 2e-7]}
    write_rig(path, [replace(rig(1)[0], name=name)], sigma)
    back = read_rig(path)
    assert [c.name for c in back.cameras] == [name]
    assert back.metadata == sigma


def test_good_file_is_not_replaced_by_one_that_cannot_be_read(tmp_path):
    path, cameras = tmp_path / "cameras.toml", rig(2)
    write_rig(path, cameras, {})
    before = path.read_bytes()
    with pytest.raises(CaptureError):
        write_rig(path, [cameras[0], replace(cameras[1], name="Left")], {})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["cameras.toml"]


@pytest.mark.parametrize("count", [1, 2, 4, 5, 8, 12])
def test_coefficients_of_all_lengths(tmp_path, count):
    path = tmp_path / "cameras.toml"
    values = [0.01 * (k + 1) if k < 8 else 0.0 for k in range(count)]
    path.write_text(ANIPOSE.replace("[ -0.1,]", repr(values)))
    d = read_rig(path).cameras[1].distortions
    assert len(d) in (5, 8)
    assert d[: min(count, 8)].tolist() == values[:8]
    assert not d[min(count, 8) :].any()


def test_cameras_all_at_one_place_have_no_poses(tmp_path):
    path = tmp_path / "cameras.toml"
    text = ANIPOSE.replace("1.5707963267948966", "0.0").replace("100.0, 2.0, 300.0", "0, 0, 0")
    path.write_text(text)
    assert not read_rig(path).placed


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ('name = "B"', 'name = "A"', None),
        ('name = "B"', 'name = "a"', None),
        ('name = "B"', 'name = "../B"', None),
        ("size = [ 1280, 720,]", "", "key-missing"),
        ("size = [ 1280, 720,]", "size = [1280]", "wrong-shape"),
        ("size = [ 1280, 720,]", "size = [1280, 0]", "image-size-invalid"),
        ("size = [ 1280, 720,]", "size = [nan, 720]", "not-a-number"),
        ("size = [ 1280, 720,]", "size = [inf, 720]", "not-a-number"),
        ("matrix = [ [ 900.0, 0.0, 640.5,],", "matrix = [", "wrong-shape"),
        ("matrix = [ [ 900.0, 0.0,", "matrix = [ [ -900.0, 0.0,", None),
        ("matrix = [ [ 900.0, 0.0,", "matrix = [ [ 900.0,", "not-a-number"),
        ("rotation = [ 0.0, 0.0, 0.0,]", 'rotation = "none"', "not-a-number"),
        ("rotation = [ 0.0, 0.0, 0.0,]", "rotation = [nan, 0, 0]", "not-a-number"),
        ("[ -0.1,]", "[ -0.1,]\nfisheye = true", None),
        ("[ -0.1,]", "[ -0.1,]\nfisheye = 1", "not-a-bool"),
        ("translation = [ 0.0, 0.0, 0.0,]", "translation = [[0, 0, 0]]", "wrong-shape"),
        ("[ -0.1,]", "[0, 0, 0, 0, 0, 0, 0, 0, 1]", None),
        ("[ -0.1,]", "[nan]", None),
        ("[ -0.1,]", "{a = 1}", "not-a-number"),
        ("[cam_0]", "[cam_0", "toml-invalid"),
        ("[cam_0]", "cam_7 = 3\n[cam_0]", "not-a-table"),
        ("[cam_", "[view_", "camera-table-missing"),
    ],
)
def test_invalid_files_are_rejected_in_one_line(tmp_path, old, new, code):
    path = tmp_path / "cameras.toml"
    assert old in ANIPOSE
    path.write_text(ANIPOSE.replace(old, new))
    with pytest.raises(CaptureError) as error:
        read_rig(path)
    assert code in (None, error.value.code)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


def test_files_that_are_not_text_or_do_not_exist(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe\x00")
    for name in ("a.toml", "missing.toml", "."):
        with pytest.raises(CaptureError) as error:
            read_rig(tmp_path / name)
        assert "\n" not in str(error.value)
