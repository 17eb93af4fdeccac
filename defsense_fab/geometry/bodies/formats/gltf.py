"""Read glTF files: GLB, or .gltf that holds its data itself."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from .triangles import Triangles

#: Extensions that a body can do without, or that are read, by the start of their name.
_HARMLESS_EXTENSIONS = (
    "EXT_lights_", "EXT_mesh_gpu_instancing", "EXT_texture_", "KHR_animation_", "KHR_lights_",
    "KHR_materials_", "KHR_mesh_quantization", "KHR_texture_", "KHR_xmp",
    "MSFT_texture_",
)  # fmt: skip
_COMPRESSION = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of primitives
_MAX_ELEMENTS = 2**28  # of an accessor without data of its own, and of instances of triangles
_MAX_DEPTH = 1000  # of nodes


def read_gltf(path: Path, suffix: str) -> Triangles:
    """Read the triangles of a scene, mm with z up. Other files that it names are not read.

    Instances are read, and morph targets have their default weights.

    Args:
        path: The file.
        suffix: Suffix of its format: .glb or .gltf.

    Raises:
        BodyError: The file is damaged (`file-invalid`), needs an extension that is not read
            (`extension-unsupported`), or names another file (`names-another-file`).
    """
    content = path.read_bytes()
    binary: bytes | None = None
    if suffix == ".glb":
        content, binary = _chunks(content)
    try:
        document = _Document(json.loads(content), binary)
        vertices, faces = document.triangles()
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise _damaged("its content does not follow glTF 2.0") from error
    except RecursionError as error:
        raise _damaged("its brackets are nested too deep") from error
    x, y, z = vertices.T
    notes = ("converted metres with y up, as in GLB, to millimetres with z up", *document.notes())
    return Triangles(1e3 * np.stack([x, -z, y], axis=1), faces, notes, 1e3)


def _damaged(problem: str) -> BodyError:
    return BodyError(problem, code="file-invalid", action="Export it again")


def _unsupported(extension: str) -> BodyError:
    action = "Export it again without that extension"
    if extension in _COMPRESSION:
        action = "Export it again without compression"
    return BodyError(
        f"needs the extension {extension[:80]}, which is not read",
        code="extension-unsupported",
        action=action,
        extension=extension,
    )


def _chunks(content: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON text and the binary data of a GLB file."""
    if len(content) < 20:
        raise _damaged(f"ends after {len(content)} bytes")
    _, version, length = struct.unpack_from("<4sII", content)
    if version != 2:
        raise _damaged(f"has version {version} of glTF; version 2 is read")
    if length > len(content):
        raise _damaged(f"is cut off: {len(content)} of its {length} bytes are there")
    chunks: dict[bytes, bytes] = {}
    start = 12
    while start + 8 <= length:
        size, kind = struct.unpack_from("<I4s", content, start)
        if start + 8 + size > length:
            raise _damaged(f"the chunk at byte {start} is longer than the file")
        chunks.setdefault(kind, content[start + 8 : start + 8 + size])
        start += 8 + size
    if b"JSON" not in chunks:
        raise _damaged("has no JSON chunk")
    return chunks[b"JSON"], chunks.get(b"BIN\0")


class _Document:
    """A glTF file, whose members are looked up as they are needed.

    Args:
        tree: The JSON content.
        binary: Data of the GLB file.
    """

    def __init__(self, tree: dict[str, Any], binary: bytes | None) -> None:
        version = str(tree["asset"]["version"])
        if version.partition(".")[0] != "2":
            raise _damaged(f"has version {version[:20]} of glTF; version 2 is read")
        for extension in map(str, tree.get("extensionsRequired", ())):
            if extension not in _COMPRESSION and not extension.startswith(_HARMLESS_EXTENSIONS):
                raise _unsupported(extension)
        self._tree, self._binary = tree, binary
        self._buffers: dict[int, bytes] = {}
        self._counts: Counter[str] = Counter()

    def notes(self) -> Iterator[str]:
        """Yield sentences on what was applied or left out."""
        sentences: Mapping[str, Callable[[int], str]] = {
            "instance": lambda n: f"read {n} instances of a mesh",
            "morph": lambda n: f"applied the default weights of {_counted(n, 'morph target')}",
            "resting": lambda n: f"left out {_counted(n, 'morph target')} of weight 0",
            "skin": lambda n: f"read {_counted(n, 'mesh')} without the pose of its skeleton",
            "curve": lambda n: f"left out {_counted(n, 'set')} of points or lines",
        }
        for kind, sentence in sentences.items():
            if self._counts[kind]:
                yield sentence(self._counts[kind])

    def triangles(self) -> tuple[Float, Int]:
        """Return vertices (n, 3) in m and triangles (m, 3) of the scene."""
        vertices, faces = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)]
        offset = 0
        for node, matrix in self._nodes():
            if "mesh" not in node:
                continue
            mesh = self._member("meshes", node["mesh"])
            self._counts["skin"] += "skin" in node
            matrices = self._instances(node, matrix)
            for primitive in mesh["primitives"]:
                points, corners = self._primitive(
                    primitive, node.get("weights", mesh.get("weights"))
                )
                if len(matrices) * (len(points) + len(corners)) > _MAX_ELEMENTS:
                    raise MemoryError
                for place in matrices:
                    vertices.append(_moved(points, place))
                    is_mirrored = np.linalg.det(place[:3, :3]) < 0
                    faces.append((corners[:, ::-1] if is_mirrored else corners) + offset)
                    offset += len(points)
        return np.concatenate(vertices), np.concatenate(faces)

    def _member(self, kind: str, index: Any) -> Any:
        members = self._tree.get(kind, ())
        if type(index) is not int or not 0 <= index < len(members):
            raise _damaged(f"names {kind}[{str(index)[:20]}], which does not exist")
        return members[index]

    def _nodes(self) -> Iterator[tuple[dict[str, Any], Float]]:
        """Yield the nodes of the scene with their transforms (4, 4) to the scene."""
        if self._tree.get("scenes"):
            roots = self._member("scenes", self._tree.get("scene", 0)).get("nodes", ())
        else:
            nodes = self._tree.get("nodes", ())
            children = {k for node in nodes for k in node.get("children", ())}
            roots = [k for k in range(len(nodes)) if k not in children]
        stack = [(index, np.eye(4), 0) for index in roots]
        visited: set[int] = set()
        while stack:
            index, matrix, depth = stack.pop()
            node = self._member("nodes", index)
            if index in visited or depth > _MAX_DEPTH:
                raise _damaged(f"nodes[{index}] is reached twice; the nodes are not a tree")
            visited.add(index)
            matrix = matrix @ _local_matrix(node)
            yield node, matrix
            stack += [(k, matrix, depth + 1) for k in node.get("children", ())]

    def _instances(self, node: dict[str, Any], matrix: Float) -> list[Float]:
        """Return the transforms (4, 4) of a node's mesh: one, or one per instance."""
        extension = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
        if extension is None:
            return [matrix]
        names = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
        columns = {
            names[name]: self._accessor(index)
            for name, index in extension["attributes"].items()
            if name in names
        }
        counts = {len(values) for values in columns.values()}
        if len(counts) != 1:
            raise _damaged("the attributes of its instances differ in number")
        count = counts.pop()
        self._counts["instance"] += count
        rows = ({name: values[k] for name, values in columns.items()} for k in range(count))
        return [matrix @ _local_matrix(row) for row in rows]

    def _primitive(self, primitive: dict[str, Any], weights: Any) -> tuple[Float, Int]:
        """Return points (n, 3) m and triangles (m, 3) of a primitive; none for lines and points."""
        for extension in _COMPRESSION:
            if extension in primitive.get("extensions", {}):
                raise _unsupported(extension)
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            self._counts["curve"] += 1
            return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        points = self._vectors(primitive["attributes"]["POSITION"])
        for target, weight in zip(primitive.get("targets", ()), weights or (), strict=False):
            if weight and "POSITION" in target:
                points = points + float(weight) * self._vectors(target["POSITION"])
                self._counts["morph"] += 1
        idle = len(primitive.get("targets", ())) - sum(map(bool, weights or ()))
        self._counts["resting"] += max(idle, 0)
        if "indices" in primitive:
            indices = self._accessor(primitive["indices"])[:, 0].astype(np.int64)
        else:
            indices = np.arange(len(points))
        if len(indices) and not 0 <= indices.min() <= indices.max() < len(points):
            raise BodyError(
                f"a triangle names vertex {indices.max()} of {len(points)}", code="vertex-missing"
            )
        return points, _corners(indices, mode)

    def _vectors(self, index: Any) -> Float:
        vectors = self._accessor(index)
        if vectors.shape[1] != 3:
            raise _damaged(f"accessors[{index}] does not hold positions")
        return vectors

    def _accessor(self, index: Any) -> Float:
        """Return the values (n, width) of an accessor; normalized integers are divided."""
        accessor = self._member("accessors", index)
        width, count = _WIDTHS[accessor["type"]], int(accessor["count"])
        kind = np.dtype(_COMPONENTS[accessor["componentType"]])
        if "bufferView" in accessor:
            offset = accessor.get("byteOffset", 0)
            values = self._view(accessor["bufferView"], kind, count, width, offset)
        elif "sparse" not in accessor or count > _MAX_ELEMENTS:
            raise _damaged(f"accessors[{index}] has no data")
        else:
            values = np.zeros((count, width), kind)
        if "sparse" in accessor:
            values = self._with_sparse(accessor["sparse"], values)
        if not accessor.get("normalized") or kind.kind == "f":
            return np.asarray(values, float)
        return np.asarray(np.maximum(values / np.iinfo(kind).max, -1.0))

    def _with_sparse(self, sparse: dict[str, Any], values: Any) -> Any:
        """Return a copy of the values (n, width) in which the listed ones are replaced."""
        places, substitutes = sparse["indices"], sparse["values"]
        rows = self._view(
            places["bufferView"],
            np.dtype(_COMPONENTS[places["componentType"]]),
            sparse["count"],
            1,
            places.get("byteOffset", 0),
        )[:, 0]
        values = values.copy()
        values[rows] = self._view(
            substitutes["bufferView"],
            values.dtype,
            sparse["count"],
            values.shape[1],
            substitutes.get("byteOffset", 0),
        )
        return values

    def _view(self, index: Any, kind: Any, count: int, width: int, offset: int) -> Any:
        """Return `count` rows of `width` numbers from a view of a buffer."""
        view = self._member("bufferViews", index)
        for extension in _COMPRESSION:
            if extension in view.get("extensions", {}):
                raise _unsupported(extension)
        row = kind.itemsize * width
        stride = view.get("byteStride", row)
        data = self._buffer(view["buffer"])
        start, end = view.get("byteOffset", 0), view.get("byteOffset", 0) + view["byteLength"]
        last = offset + (stride * (count - 1) + row if count else 0)
        is_inside = 0 <= start <= end <= len(data) and last <= view["byteLength"]
        if count < 0 or offset < 0 or stride < row or not is_inside:
            raise _damaged(f"bufferViews[{index}] ends before its data")
        return np.ndarray((count, width), kind, data, start + offset, (stride, kind.itemsize))

    def _buffer(self, index: Any) -> bytes:
        if index not in self._buffers:
            self._buffers[index] = self._load_buffer(self._member("buffers", index), index)
        return self._buffers[index]

    def _load_buffer(self, buffer: dict[str, Any], index: int) -> bytes:
        if "uri" not in buffer:
            if index != 0 or self._binary is None:
                raise _damaged(f"buffers[{index}] has no data")
            return self._binary
        head, comma, text = str(buffer["uri"]).partition(",")
        if not (head.startswith("data:") and head.endswith(";base64") and comma):
            raise BodyError(
                f"names another file, {head[:80]!r}, which is not read",
                code="names-another-file",
                action="Export GLB, which holds everything",
                name=head,
            )
        try:
            return base64.b64decode(text, validate=True)
        except binascii.Error as error:
            raise _damaged(f"the data of buffers[{index}] are not in base 64") from error


def _counted(count: int, noun: str) -> str:
    plural = "es" if noun.endswith("sh") else "s"
    return f"{count} {noun}{plural if count != 1 else ''}"


def _corners(indices: Int, mode: int) -> Int:
    """Return the triangles (m, 3) of a list, a strip or a fan of indices."""
    if mode == _TRIANGLES:
        if len(indices) % 3:
            raise _damaged(f"{len(indices)} indices are not a multiple of 3")
        return indices.reshape(-1, 3)
    if len(indices) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == _FAN:
        first = np.full(len(indices) - 2, indices[0])
        return np.stack([indices[1:-1], indices[2:], first], axis=1)
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2] = faces[1::2, [0, 2, 1]]
    return faces


def _local_matrix(node: Mapping[str, Any]) -> Float:
    """Return the transform (4, 4) of a node or instance to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        x, y, z, w = np.array(node["rotation"], float) / np.linalg.norm(node["rotation"])
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), float)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _moved(points: Float, matrix: Float) -> Float:
    """Return points (n, 3) after a transform (4, 4)."""
    if np.array_equal(matrix, np.eye(4)):
        return points
    return np.asarray(np.dot(matrix[:3], np.column_stack((points, np.ones(len(points)))).T).T)
