"""USD files are read back by its own library."""

import dataclasses
import sys
from collections import namedtuple

import numpy as np
import pytest
from pxr import Tf, Usd, UsdGeom

from defsense_fab.core.errors import LiveError, StorageError
from defsense_fab.runtime.recording import usd_animation
from defsense_fab.runtime.recording.usd_animation import write_usd
from tests.runtime.recording_bars import animation
from tests.support.errors import raises


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc"])
def test_positions(tmp_path, suffix):
    of = animation(40)
    path = tmp_path / f"bar{suffix}"
    written = write_usd(path, of)
    assert (written.frames, written.error, written.size) == (40, 0, path.stat().st_size)
    assert path.read_bytes().startswith(b"#usda" if suffix == ".usda" else b"PXR-USDC")
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.001
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 39)
    assert stage.GetDefaultPrim().GetPath() == "/a_bar"
    mesh = UsdGeom.Mesh.Get(stage, "/a_bar/surface")
    points = mesh.GetPointsAttr()
    for k in range(40):
        np.testing.assert_array_equal(points.Get(k), of.positions[k])
        low, high = mesh.GetExtentAttr().Get(k)
        np.testing.assert_array_equal(low, of.positions[k].min(axis=0))
        np.testing.assert_array_equal(high, of.positions[k].max(axis=0))
    half = (of.positions[10].astype(float) + of.positions[11]) / 2
    np.testing.assert_allclose(points.Get(10.5), half, atol=1e-5)
    np.testing.assert_array_equal(points.Get(), of.rest.astype(np.float32))
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
    np.testing.assert_array_equal(mesh.GetFaceVertexIndicesAttr().Get(), of.faces.ravel())
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"


def test_long_animation_is_saved_in_parts(tmp_path, monkeypatch):
    """A long animation is written in parts, with the same result."""
    monkeypatch.setattr(usd_animation, "_SAVE_INTERVAL_BYTES", 1)
    of = animation(300)
    write_usd(tmp_path / "bar.usdc", of)
    stage = Usd.Stage.Open(str(tmp_path / "bar.usdc"))
    points = UsdGeom.Mesh.Get(stage, "/a_bar/surface").GetPointsAttr()
    for k in range(300):
        np.testing.assert_array_equal(points.Get(k), of.positions[k])


def test_gaps_and_names_that_are_invalid_in_usd(tmp_path):
    of = dataclasses.replace(animation(3), steps=np.array([0, 1, 50]), name="3 bars & more")
    write_usd(tmp_path / "bar.usdc", of)
    stage = Usd.Stage.Open(str(tmp_path / "bar.usdc"))
    (mesh,) = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    assert mesh.GetPointsAttr().GetTimeSamples() == [0, 1, 50]


def test_failed_write_leaves_no_file(tmp_path):
    of = animation(3)
    of.positions[2, 0, 0] = np.inf
    with raises(LiveError, "not-finite"):
        write_usd(tmp_path / "bar.usdc", of)
    with raises(StorageError, "file-not-found"):
        write_usd(tmp_path / "file" / "bar.usdc", animation(3))
    assert list(tmp_path.iterdir()) == []


def test_without_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with raises(LiveError, "library-missing"):
        write_usd(tmp_path / "bar.usdc", animation(3))


@pytest.mark.parametrize(("free", "code"), [(0, "disk-full"), (1e9, "usd-write-failed")])
def test_failures_of_usd_are_reported(tmp_path, monkeypatch, free, code):
    def refuse(*_):
        Tf.RaiseRuntimeError("no such luck")

    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(usd_animation, "_write", refuse)
    monkeypatch.setattr(usd_animation.shutil, "disk_usage", lambda _: usage(1e9, 0, free))
    with raises(StorageError, code):
        write_usd(tmp_path / "bar.usdc", animation(3))
    assert list(tmp_path.iterdir()) == []
