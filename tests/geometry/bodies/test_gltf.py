"""glTF: accessors, transforms, and extensions that are read, left out or refused.

`DEFSENSE_VARIANTS=1000` reads that many scenes in place of the few of the suite.
"""

from __future__ import annotations

import base64
import json
import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.mesh_files import read_mesh, read_triangles
from tests.support.errors import raises
from tests.support.gltf_files import CUBE, CUBE_FACES, GltfFile

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "60"))
SIZE = [0.12, 0.03, 0.02]  # m, of the box of most tests
SIZES = (1.0, 1e4)
DRACO = "KHR_draco_mesh_compression"


def read(path, file):
    path = path / "a.glb"
    path.write_bytes(file if isinstance(file, bytes) else file.glb())
    return read_triangles(path, ".glb")


def signed_volume(vertices, faces):
    return np.linalg.det(vertices[faces]).sum() / 6


def extents(mesh):
    return np.ptp(mesh.vertices[np.unique(mesh.faces)], axis=0)


def to_mm(points):
    x, y, z = 1e3 * np.asarray(points).T
    return np.stack([x, -z, y], axis=1)


@pytest.mark.parametrize(
    ("kind", "high"), [("u1", 255), ("i1", 127), ("<u2", 65535), ("<i2", 32767)]
)
@pytest.mark.parametrize("normalized", [True, False])
def test_integer_positions_are_scaled_as_their_accessor_says(kind, high, normalized, tmp_path):
    file = GltfFile()
    values = file.add_accessor(CUBE * high, kind, stride=8, normalized=normalized)
    mesh = file.add_cube()
    file.tree["meshes"][mesh]["primitives"][0]["attributes"]["POSITION"] = values
    file.add_node(mesh=mesh, scale=[s / (1 if normalized else high) for s in SIZE])
    file.tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    assert extents(read(tmp_path, file)) == pytest.approx([120, 20, 30])


@pytest.mark.parametrize("is_required", [True, False])
@pytest.mark.parametrize("extension", [DRACO, "EXT_meshopt_compression"])
def test_a_file_with_a_compressed_part_is_refused(extension, is_required, tmp_path):
    file = GltfFile()
    for k in range(2):
        file.add_node(mesh=file.add_cube(), scale=SIZE, translation=[k, 0, 0])
    primitive = file.tree["meshes"][1]["primitives"][0]
    if extension == DRACO:
        primitive["extensions"] = {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    else:
        accessor = file.tree["accessors"][primitive["attributes"]["POSITION"]]
        view = file.tree["bufferViews"][accessor["bufferView"]]
        view["extensions"] = {extension: {"buffer": 0, "mode": "ATTRIBUTES"}}
    if is_required:
        file.tree["extensionsRequired"] = [extension]
    with raises(BodyError, "extension-unsupported"):
        read(tmp_path, file)


def test_only_required_extensions_that_change_the_shape_are_refused(tmp_path):
    file = GltfFile()
    file.add_node(mesh=file.add_cube(), scale=SIZE)
    file.tree["extensionsUsed"] = ["ACME_bent_space"]
    file.tree["extensionsRequired"] = ["KHR_materials_unlit", "KHR_texture_transform"]
    assert extents(read(tmp_path, file)) == pytest.approx([120, 20, 30])
    file.tree["extensionsRequired"] += ["ACME_bent_space"]
    with raises(BodyError, "extension-unsupported"):
        read(tmp_path, file)


@pytest.mark.parametrize("place", ["mesh", "node"])
def test_morph_targets_have_their_default_weights(place, tmp_path):
    file = GltfFile()
    mesh = file.add_cube()
    target = {"POSITION": file.add_accessor(CUBE * [0, 1, 0])}
    file.tree["meshes"][mesh]["primitives"][0]["targets"] = [target, target]
    node = file.add_node(mesh=mesh, scale=SIZE)
    still = read(tmp_path, file)
    assert extents(still) == pytest.approx([120, 20, 30])
    owner = file.tree["meshes"][mesh] if place == "mesh" else file.tree["nodes"][node]
    owner["weights"] = [0.5, 0.0]
    bent = read(tmp_path, file)
    assert extents(bent) == pytest.approx([120, 20, 45])
    assert len(still.notes) == 2
    assert len(bent.notes) == 3


def test_all_instances_are_read(tmp_path):
    file = GltfFile()
    turn = Rotation.from_euler("y", 90, degrees=True).as_quat()
    attributes = {
        "TRANSLATION": file.add_accessor([[0, 0, 0], [0, 0, 5]]),
        "ROTATION": file.add_accessor([[0, 0, 0, 1], turn]),
    }
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    file.add_node(mesh=file.add_cube(), scale=[0.1, 0.1, 0.1], extensions=extensions)
    mesh = read(tmp_path, file)
    assert len(mesh.faces) == 24
    assert extents(mesh) == pytest.approx([100, 500, 100])
    assert len(mesh.notes) == 2


def test_strips_and_fans_are_read_and_lines_are_left_out(tmp_path):
    file = GltfFile()
    mesh = file.add_cube()
    (primitive,) = file.tree["meshes"][mesh]["primitives"]
    position = primitive["attributes"]
    strip = file.add_accessor([[0], [1], [2], [3], [6], [7], [4], [5], [0], [1]], "u1")
    fans = [file.add_accessor([[k] for k in loop], "u1") for loop in ((0, 2, 6, 4), (1, 5, 7, 3))]
    file.tree["meshes"][mesh]["primitives"] = [
        {"attributes": position, "indices": strip, "mode": 5},
        *({"attributes": position, "indices": fan, "mode": 6} for fan in fans),
        {"attributes": position, "mode": 1},
    ]
    file.add_node(mesh=mesh, scale=[0.1, 0.1, 0.1])
    result = read(tmp_path, file)
    assert signed_volume(result.vertices, result.faces) == pytest.approx(1e6)
    assert len(result.notes) == 2


def test_data_in_the_text_of_gltf_are_read(tmp_path):
    file = GltfFile()
    file.add_node(mesh=file.add_cube(), scale=SIZE)
    uri = "data:application/octet-stream;base64," + base64.b64encode(file.data).decode()
    file.tree["buffers"] = [{"byteLength": len(file.data), "uri": uri}]
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(file.tree), encoding="utf-8-sig")
    assert read_mesh(path, 1.0, SIZES)[0].volume == pytest.approx(72_000)


def _damage(file, rng):
    """Damage a scene that was read; return its content and the codes that are allowed."""
    tree = file.tree
    which = int(rng.integers(8))
    if which == 0:
        content = file.glb()
        return content[: int(rng.integers(12, len(content) - 4))], "file-invalid"
    if which == 1:
        tree["extensionsRequired"] = ["ACME_" + "x" * int(rng.integers(1, 200))]
        return file.glb(), "extension-unsupported"
    if which == 2:
        tree["meshes"][-1]["primitives"][0]["extensions"] = {DRACO: {}}
        return file.glb(), "extension-unsupported"
    if which == 3:
        tree["accessors"][tree["meshes"][0]["primitives"][0]["indices"]]["count"] = 10**9
    elif which == 4:
        tree["nodes"][-1]["children"] = [0]
    elif which == 5:
        tree["nodes"][-1]["mesh"] = [99, -1, "0", None][int(rng.integers(4))]
    elif which == 6:
        del tree["accessors"][tree["meshes"][0]["primitives"][0]["indices"]]["type"]
    else:
        faces = np.full((3, 1), 200)
        tree["meshes"][0]["primitives"][0]["indices"] = file.add_accessor(faces, "u1")
        return file.glb(), "vertex-missing"
    return file.glb(), "file-invalid"


def _scene(rng):
    """Return a scene of a few boxes, and their triangles (n, 3, 3) in mm."""
    file, triangles = GltfFile(), []
    parent, parent_matrix = None, np.eye(4)
    for _ in range(int(rng.integers(1, 4))):
        kind = ["<f4", "u1", "i1", "<u2", "<i2"][int(rng.integers(5))]
        normalized = kind != "<f4" and bool(rng.integers(2))
        high = 1 if kind == "<f4" else np.iinfo(kind).max
        mesh = file.add_cube()
        attributes = file.tree["meshes"][mesh]["primitives"][0]["attributes"]
        attributes["POSITION"] = file.add_accessor(
            CUBE * high,
            kind,
            stride=[0, 16][int(rng.integers(2))],
            sparse=bool(rng.integers(2)),
            normalized=normalized,
        )
        turn = Rotation.random(random_state=int(rng.integers(2**31)))
        scale = rng.uniform(0.5, 2, 3) * rng.choice([1, -1], 3) / (1 if normalized else high)
        shift = rng.uniform(-3, 3, 3)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn.as_matrix() @ np.diag(scale), shift
        keys = {"matrix": matrix.T.ravel().tolist()}
        if rng.integers(2):
            keys = {"rotation": turn.as_quat(), "scale": scale, "translation": shift}
            keys = {name: values.tolist() for name, values in keys.items()}
        index = file.add_node(parent, mesh=mesh, **keys)
        world = parent_matrix @ matrix
        corners = to_mm(np.c_[CUBE * (1 if normalized else high), np.ones(8)] @ world[:3].T)
        faces = CUBE_FACES if np.linalg.det(world[:3, :3]) > 0 else CUBE_FACES[:, ::-1]
        triangles.append(corners[faces])
        if rng.integers(2):
            parent, parent_matrix = index, world
    return file, np.concatenate(triangles)


def test_random_scenes_are_read_right_and_damaged_ones_are_refused(tmp_path):
    rng = np.random.default_rng(53)
    for k in range(VARIANTS):
        file, triangles = _scene(rng)
        mesh = read(tmp_path, file)
        order = [
            np.lexsort(t.mean(axis=1).round(2).T) for t in (triangles, mesh.vertices[mesh.faces])
        ]
        scale = np.abs(triangles).max()
        result = mesh.vertices[mesh.faces][order[1]]
        np.testing.assert_allclose(
            result.sum(axis=1), triangles[order[0]].sum(axis=1), atol=1e-5 * scale, err_msg=str(k)
        )
        volume = np.linalg.det(triangles).sum()
        assert np.linalg.det(result).sum() == pytest.approx(volume, rel=1e-4), k
        content, code = _damage(file, rng)
        with raises(BodyError, code):
            read(tmp_path, content)
