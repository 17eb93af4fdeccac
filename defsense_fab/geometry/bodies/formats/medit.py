"""Read Medit files (.mesh), which are text."""

from __future__ import annotations

import numpy as np

from ....core.arrays import Float, Int
from .text import Words, decode_text, show, text_error, without_comments

#: Kinds of cells by keyword: the name in meshio, and the number of corners.
_CELLS = {
    b"triangles": ("triangle", 3),
    b"quadrilaterals": ("quad", 4),
    b"tetrahedra": ("tetra", 4),
    b"hexahedra": ("hexahedron", 8),
    b"hexaedra": ("hexahedron", 8),
    b"prisms": ("wedge", 6),
    b"pyramids": ("pyramid", 5),
}


def read_medit(content: bytes) -> tuple[Float, list[tuple[str, Int]]]:
    """Read vertices and cells. Other sections of numbers are skipped.

    Args:
        content: Content of the file.

    Returns:
        Vertices (n, d) in d dimensions, and cells as names of kinds with corners (m, c).

    Raises:
        BodyError: The file cannot be read.
    """
    words = Words(without_comments(decode_text(content)))
    dimension, vertices = 3, np.zeros((0, 3))
    cells: list[tuple[str, Int]] = []
    while words.at < len(words.words):
        key = words.take(1, "sections")[0]
        name = key.lower()
        if name == b"end":
            break
        if name == b"meshversionformatted":
            words.take(1, "version")
        elif name == b"dimension":
            dimension = words.count("dimensions")
            if dimension not in (2, 3):
                problem = f"{dimension} is not a number of dimensions"
                raise text_error(words.line(words.at - 1), problem)
        elif name == b"vertices":
            count = words.count("vertices")
            vertices = words.rows(count, dimension + 1, range(dimension), "vertices")
        elif name in _CELLS:
            kind, corners = _CELLS[name]
            count = words.count(kind)
            rows = words.integers(count * (corners + 1), f"{count} cells")
            cells.append((kind, rows.reshape(-1, corners + 1)[:, :corners] - 1))
        elif key.isalpha():
            _skip_section(words)
        else:
            raise text_error(
                words.line(words.at - 1), f"{show(key)} is not a section of a Medit file"
            )
    return vertices, cells


def _skip_section(words: Words) -> None:
    """Pass over the numbers of a section, up to the next keyword."""
    while words.at < len(words.words) and not words.words[words.at].isalpha():
        words.at += 1
