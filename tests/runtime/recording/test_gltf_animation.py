"""glTF files are read back as specified, from bytes to accessors to morphed vertices.

Their shapes with weights are compared with the frames that they approximate.
"""

import dataclasses
import json
import struct

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError, StorageError
from defsense_fab.runtime.recording.gltf_animation import deformation_basis, write_gltf
from tests.runtime.recording_bars import animation
from tests.support.errors import raises

TYPES = {5126: "<f4", 5125: "<u4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3}


class Reader:
    """The only mesh of a .glb file and the animation of its weights."""

    def __init__(self, path):
        data = path.read_bytes()
        magic, version, size = struct.unpack_from("<4sII", data)
        assert (magic, version, size) == (b"glTF", 2, len(data))
        length, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        assert length % 4 == 0
        self.document = json.loads(data[20 : 20 + length])
        count, kind = struct.unpack_from("<I4s", data, 20 + length)
        assert kind == b"BIN\0"
        self._data = data[28 + length :]
        assert count == len(self._data) == self.document["buffers"][0]["byteLength"]
        (mesh,) = self.document["meshes"]
        (primitive,) = mesh["primitives"]
        self.default = np.array(mesh["weights"])
        self.base = self.accessor(primitive["attributes"]["POSITION"])
        self.faces = self.accessor(primitive["indices"]).reshape(-1, 3)
        self.targets = np.stack([self.accessor(t["POSITION"]) for t in primitive["targets"]])
        (one,) = self.document["animations"]
        (sampler,), (channel,) = one["samplers"], one["channels"]
        assert channel == {"sampler": 0, "target": {"node": 0, "path": "weights"}}
        assert sampler["interpolation"] == "LINEAR"
        self.times = self.accessor(sampler["input"]).ravel()
        self.weights = self.accessor(sampler["output"]).reshape(len(self.times), -1)

    def accessor(self, number):
        one = self.document["accessors"][number]
        view = self.document["bufferViews"][one["bufferView"]]
        width = WIDTHS[one["type"]]
        assert view["byteLength"] == one["count"] * width * 4
        assert view["byteOffset"] % 4 == 0
        start = view["byteOffset"]
        values = np.frombuffer(
            self._data[start : start + view["byteLength"]], TYPES[one["componentType"]]
        ).reshape(-1, width)
        if "min" in one:
            np.testing.assert_array_equal(values.min(axis=0), one["min"])
            np.testing.assert_array_equal(values.max(axis=0), one["max"])
        return values

    def vertices(self, time):
        """Return vertices (v, 3), m, at a time (s)."""
        weights = np.array([np.interp(time, self.times, w) for w in self.weights.T])
        return self.base + np.einsum("k,kvi->vi", weights, self.targets.astype(float))


def turned(gltf):
    """Convert from m with y up to mm with z up."""
    return 1000 * np.stack([gltf[:, 0], -gltf[:, 2], gltf[:, 1]], axis=1)


def test_positions(tmp_path):
    of = animation(120)
    path = tmp_path / "bar.glb"
    written = write_gltf(path, of)
    read = Reader(path)
    errors = [
        np.linalg.norm(turned(read.vertices(t)) - x, axis=1).max()
        for t, x in zip(of.times, of.positions, strict=True)
    ]
    assert max(errors) == pytest.approx(written.error, abs=1e-4)
    assert written.error <= 0.02
    assert written.targets == len(read.targets)
    assert (written.frames, written.size) == (120, path.stat().st_size)
    half = turned(read.vertices(10.5 / 30))
    assert np.linalg.norm(half - (of.positions[10] + of.positions[11]) / 2, axis=1).max() < 0.02


def test_rest_faces_and_names(tmp_path):
    of = animation(10)
    write_gltf(tmp_path / "bar.glb", of)
    read = Reader(tmp_path / "bar.glb")
    np.testing.assert_allclose(turned(read.base), of.rest, atol=1e-5)
    assert not read.default.any()  # at rest while the animation is not played
    np.testing.assert_array_equal(read.faces, of.faces)
    document = read.document
    assert document["nodes"] == [{"mesh": 0, "name": "a bar"}]
    assert len(document["meshes"][0]["extras"]["targetNames"]) == len(read.targets)
    assert ((read.weights >= 0) & (read.weights <= 1)).all()  # Blender clips others
    first = read.document["accessors"][read.document["animations"][0]["samplers"][0]["input"]]
    assert first["min"] == [0]


def test_times_with_gaps(tmp_path):
    of = dataclasses.replace(animation(4), steps=np.array([0, 1, 300, 301]))
    write_gltf(tmp_path / "bar.glb", of)
    np.testing.assert_allclose(Reader(tmp_path / "bar.glb").times, [0, 1 / 30, 10, 301 / 30])


def test_size_grows_with_vertices_plus_frames(tmp_path):
    """Ten times as many frames of the same motion need few more bytes."""
    short = write_gltf(tmp_path / "a.glb", animation(90, fps=30, along=40))
    long = write_gltf(tmp_path / "b.glb", animation(900, fps=300, along=40))
    assert long.targets <= short.targets + 2
    assert long.size < 2.2 * short.size


def test_failed_write_leaves_no_file(tmp_path):
    with raises(StorageError, "file-not-found"):
        write_gltf(tmp_path / "none" / "bar.glb", animation(3))
    assert list(tmp_path.iterdir()) == []


def largest_error(of, basis):
    shapes = np.einsum("nk,kvi->nvi", basis.weights.astype(float), basis.targets.astype(float))
    return np.linalg.norm(of.rest + shapes - of.positions, axis=2).max()


@pytest.mark.parametrize("tolerance", [0.5, 0.02, 0.001])
def test_every_vertex_is_within_the_tolerance(tolerance):
    """Use 300 frames, which are several chunks."""
    of = animation(300)
    basis = deformation_basis(of, tolerance)
    assert basis.error <= tolerance
    assert basis.error == pytest.approx(largest_error(of, basis), rel=1e-9)
    assert len(basis.targets) < 40
    assert (basis.weights.min(), basis.weights.max()) == (0, 1)
    assert (basis.weights[:, 0] == 1).all()


def test_number_of_targets_is_minimal():
    """A motion of three shapes needs three targets and an offset."""
    rng = np.random.default_rng(1)
    of = animation(50)
    shapes = rng.normal(size=(3, *of.rest.shape))
    weights = rng.normal(size=(50, 3)) * [30, 3, 1]
    positions = of.rest + np.einsum("nk,kvi->nvi", weights, shapes)
    basis = deformation_basis(dataclasses.replace(of, positions=positions.astype(np.float32)))
    assert len(basis.targets) == 4
    assert basis.error < 1e-3


def test_error_of_too_few_targets_is_reported():
    """Noise cannot be represented by a few shapes."""
    rng = np.random.default_rng(2)
    of = animation(100)
    noisy = of.positions + rng.normal(size=of.positions.shape).astype(np.float32)
    of = dataclasses.replace(of, positions=noisy)
    basis = deformation_basis(of, max_targets=10)
    assert len(basis.targets) == 11
    assert basis.error > 1
    assert basis.error == pytest.approx(largest_error(of, basis), rel=1e-9)


def test_animation_without_motion():
    of = animation(3)
    still = np.repeat(of.rest[None].astype(np.float32), 3, axis=0)
    basis = deformation_basis(dataclasses.replace(of, positions=still))
    assert len(basis.targets) == 2
    assert basis.error < 1e-4


def test_vertex_without_a_position_is_refused():
    of = animation(3)
    of.positions[1, 4, 2] = np.nan
    with raises(LiveError, "not-finite", start=0):
        deformation_basis(of)
