"""What kind of body a file holds, by its content: names lie."""

from __future__ import annotations

import re

_STEP = re.compile(rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;", re.DOTALL)
_VERTEX = re.compile(rb"^\s*v\s+[-+.\d]", re.MULTILINE)
_FACE = re.compile(rb"^\s*f\s+[-\d]", re.MULTILINE)
_OFF = re.compile(rb"\s*(#[^\n]*\n\s*)*(ST)?C?N?OFF\b")
_MEDIT = re.compile(rb"\s*(#[^\n]*\n\s*)*MeshVersionFormatted\b")
_VTU = re.compile(
    rb"\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*<VTKFile\b[^>]*UnstructuredGrid", re.DOTALL
)
_GLTF = re.compile(rb'\s*\{.*"asset"\s*:', re.DOTALL)
_HEAD, _TRIANGLE = 84, 50  # bytes of a binary STL file
_BEGINNING = 4096


def kind_of_file(content: bytes) -> str | None:
    """The suffix of the file that these bytes are: .step, .stl, .obj, .ply, .off, .3mf, .glb,
    .gltf, .msh, .vtu, .mesh; None for what is none of them. That it can be read is not said."""
    start = content[:_BEGINNING]
    for suffix, pattern in (
        (".step", _STEP), (".off", _OFF), (".mesh", _MEDIT), (".vtu", _VTU)
    ):  # fmt: skip
        if pattern.match(start):
            return suffix
    if re.match(rb"ply\s", start):
        return ".ply"
    if start.startswith(b"glTF"):
        return ".glb"
    if start.startswith(b"$MeshFormat"):
        return ".msh"
    if start.startswith(b"PK\x03\x04") and b"3D/" in content:
        return ".3mf"
    if len(content) >= _HEAD:
        count = int.from_bytes(content[_HEAD - 4 : _HEAD], "little")
        if count and len(content) == _HEAD + _TRIANGLE * count:
            return ".stl"
    if start.lstrip().startswith(b"solid") and b"facet" in content:
        return ".stl"
    if b"\0" in start:
        return None
    if start.lstrip().startswith(b"{") and _GLTF.match(content) and b'"meshes"' in content:
        return ".gltf"
    if _VERTEX.search(content) and _FACE.search(content):
        return ".obj"
    return None
