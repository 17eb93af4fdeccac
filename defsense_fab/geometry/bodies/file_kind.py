"""What kind of body a file holds, by its content: names lie."""

from __future__ import annotations

import re

_STEP = re.compile(rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;", re.DOTALL)
_VERTEX = re.compile(rb"^\s*v\s+[-+.\d]", re.MULTILINE)
_FACE = re.compile(rb"^\s*f\s+[-\d]", re.MULTILINE)
_HEAD, _TRIANGLE = 84, 50  # bytes of a binary STL file
_BEGINNING = 4096


def kind_of_file(content: bytes) -> str | None:
    """The suffix of the file that these bytes are: .step, .stl, .obj, .ply, .3mf; None for what is
    none of them. That it can be read is not said."""
    start = content[:_BEGINNING]
    if _STEP.match(start):
        return ".step"
    if re.match(rb"ply\s", start):
        return ".ply"
    if start.startswith(b"PK\x03\x04") and b"3D/" in content:
        return ".3mf"
    if len(content) >= _HEAD:
        count = int.from_bytes(content[_HEAD - 4 : _HEAD], "little")
        if count and len(content) == _HEAD + _TRIANGLE * count:
            return ".stl"
    if start.lstrip().startswith(b"solid") and b"facet" in content:
        return ".stl"
    if b"\0" not in start and _VERTEX.search(content) and _FACE.search(content):
        return ".obj"
    return None
