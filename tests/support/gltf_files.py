"""Write glTF scenes of boxes, with the encodings that exporters choose between."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

#: Corners (8, 3) of a unit cube, and its triangles (12, 3), outward.
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
_COMPONENTS = {"i1": 5120, "u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}


class GltfFile:
    """A glTF file in memory: its JSON tree and its data."""

    def __init__(self) -> None:
        self.data = b""
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
        }

    def add(self, kind: str, member: dict[str, Any]) -> int:
        """Append a member, and return its index."""
        self.tree[kind].append(member)
        return len(self.tree[kind]) - 1

    def add_view(self, data: bytes, **keys: Any) -> int:
        """Append data, and return the index of their view."""
        self.data += b"\0" * (-len(self.data) % 4)
        place = {"byteOffset": len(self.data), "byteLength": len(data)}
        self.data += data
        return self.add("bufferViews", {"buffer": 0, **place, **keys})

    def add_accessor(
        self, values: Any, kind: str = "<f4", *, stride: int = 0, sparse: bool = False, **keys: Any
    ) -> int:
        """Append an accessor of values (n, width), and return its index.

        Args:
            values: The stored numbers.
            kind: Type of the numbers, as in numpy.
            stride: Bytes per row; 0 for rows without gaps.
            sparse: Whether the values are stored as replacements of zeros.
            keys: More keys of the accessor.
        """
        values = np.asarray(values, kind)
        count, width = values.shape
        accessor: dict[str, Any] = {
            "componentType": _COMPONENTS[kind],
            "count": count,
            "type": {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[width],
            **keys,
        }
        if sparse:
            rows = np.arange(count, dtype="<u2")
            accessor["sparse"] = {
                "count": count,
                "indices": {"bufferView": self.add_view(rows.tobytes()), "componentType": 5123},
                "values": {"bufferView": self.add_view(values.tobytes())},
            }
        elif stride:
            rows = np.zeros((count, stride), "u1")
            size = values.itemsize * width
            rows[:, :size] = np.ascontiguousarray(values).view("u1").reshape(count, size)
            accessor["bufferView"] = self.add_view(rows.tobytes(), byteStride=stride)
        else:
            accessor["bufferView"] = self.add_view(values.tobytes())
        return self.add("accessors", accessor)

    def add_cube(self, *, kind: str = "<f4", indices: str = "<u2", **keys: Any) -> int:
        """Append a mesh that is a unit cube, and return its index."""
        attributes = {"POSITION": self.add_accessor(CUBE, kind, **keys)}
        faces = self.add_accessor(CUBE_FACES.reshape(-1, 1), indices)
        return self.add("meshes", {"primitives": [{"attributes": attributes, "indices": faces}]})

    def add_node(self, parent: int | None = None, **keys: Any) -> int:
        """Append a node to the scene or to another node, and return its index."""
        index = self.add("nodes", keys)
        siblings = self.tree["scenes"][0]["nodes"]
        if parent is not None:
            siblings = self.tree["nodes"][parent].setdefault("children", [])
        siblings.append(index)
        return index

    def glb(self) -> bytes:
        """Return the file as GLB."""
        data = self.data + b"\0" * (-len(self.data) % 4)
        text = json.dumps(self.tree | {"buffers": [{"byteLength": len(data)}]}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
