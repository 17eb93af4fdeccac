"""Read Wavefront OBJ files."""

from __future__ import annotations

import re

import numpy as np

from ....core.arrays import Int
from .polygons import divide_faces
from .text import (
    decode_text,
    find_wrong_number,
    number_error,
    parse_floats,
    parse_integers,
    show,
    text_error,
    without_comments,
)
from .triangles import Triangles

#: Statements that change no face: names, materials, texture, display, curves and points.
_IGNORED = frozenset(
    b"vt vn vp vc g o s l p usemtl mtllib maplib usemap bevel c_interp d_interp lod mg shadow_obj"
    b" trace_obj ctech stech cstype deg bmat step parm curv curv2 con trim hole scrv sp end".split()
)
#: Statements whose words may be anything, so that a "\" at their end does not continue them.
_NAMES = frozenset(b"g o usemtl mtllib maplib usemap shadow_obj trace_obj".split())
#: What follows the number of a vertex: numbers of its texture and normal.
_TEXTURE = re.compile(rb"/[^ ]*")


def read_obj(content: bytes) -> Triangles:
    """Read the faces of all objects and groups. Materials are not read.

    Args:
        content: Content of the file.

    Raises:
        BodyError: A line cannot be read.
    """
    lines = without_comments(decode_text(content)).split(b"\n")
    if b"\\" in content:
        _join_continued(lines)
    words: list[bytes] = []
    vertex_lines: list[int] = []
    corner_words: list[bytes] = []
    faces: list[tuple[int, int, int]] = []  # line, corners, and vertices before it
    for number, line in enumerate(lines, 1):
        parts = line.split()
        if not parts:
            continue
        key = parts[0]
        if key == b"v":
            if len(parts) < 4:
                raise text_error(number, f"{show(line)} has fewer than three coordinates")
            words += parts[1:4]
            vertex_lines.append(number)
        elif key == b"f" or key == b"fo":
            corner_words += parts[1:]
            faces.append((number, len(parts) - 1, len(vertex_lines)))
        elif key not in _IGNORED:
            raise _statement_error(number, line, key)
    try:
        vertices = parse_floats(words).reshape(-1, 3)
    except ValueError:
        at = find_wrong_number(words, float)
        raise number_error(vertex_lines[at // 3], words[at]) from None
    lines_of_faces, counts, before = np.array(faces, np.int64).reshape(-1, 3).T
    corners = _read_corners(
        corner_words, np.repeat(before, counts), np.repeat(lines_of_faces, counts)
    )
    return Triangles(vertices, divide_faces(vertices, corners, counts, lines_of_faces.__getitem__))


def _join_continued(lines: list[bytes]) -> None:
    r"""Join lines that end in "\" with the next, which keeps its number."""
    for k in range(len(lines) - 1):
        line = lines[k].rstrip()
        if not line.endswith(b"\\"):
            continue
        key = line.split(maxsplit=1)[0]
        if key not in _NAMES:
            lines[k + 1] = line[:-1] + b" " + lines[k + 1]
            lines[k] = b""


def _read_corners(words: list[bytes], vertex_counts: Int, lines: Int) -> Int:
    """Return indices of vertices, from 0, of words such as 3, 3/1, 3//2 or -1.

    Args:
        words: Corners of all faces (k,).
        vertex_counts: Number of vertices before each corner's face (k,).
        lines: Line of each corner's face (k,).
    """
    numbers = _TEXTURE.sub(b"", b" ".join(words)).split()
    try:
        if len(numbers) != len(words):
            raise ValueError
        corners = parse_integers(numbers)
    except ValueError:
        at = find_wrong_number([word.partition(b"/")[0] for word in words], int)
        raise number_error(int(lines[at]), words[at], "a corner") from None
    if (corners == 0).any():
        line = int(lines[np.flatnonzero(corners == 0)[0]])
        raise text_error(line, "a face names vertex 0; the first is 1", "vertex-missing")
    return np.where(corners > 0, corners - 1, vertex_counts + corners)


def _statement_error(number: int, line: bytes, key: bytes) -> Exception:
    if key in (b"surf", b"bzp", b"bsp", b"cdc", b"cdp", b"res"):
        return text_error(number, "free-form surfaces are not read", "surface-not-triangles")
    return text_error(number, f"{show(line)} is not a statement of OBJ")
