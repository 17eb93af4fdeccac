"""Read PLY files, text and binary, with polygons or triangle strips."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from .polygons import divide_faces
from .text import (
    Words,
    decode_text,
    find_wrong_number,
    number_error,
    parse_integers,
    show,
    text_error,
)
from .triangles import Triangles

_TYPES = {
    f"{name}{bits}": f"{code}{bits // 8}"
    for name, code in (("int", "i"), ("uint", "u"), ("float", "f"))
    for bits in (8, 16, 32, 64)
    if (name, bits) != ("float", 8)
} | {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LINE_END = re.compile(rb"\r\n|\r|\n")
_CORNER_NAMES = ("vertex_indices", "vertex_index")
_STRIP_END = -1  # in a list of strips
#: Properties that are read, by element; others are skipped.
_USED = {"vertex": ("x", "y", "z"), "face": _CORNER_NAMES, "tristrips": _CORNER_NAMES}


@dataclass
class _Property:
    """A property; `count_type` is the type of a list's length, or None for a single value."""

    name: str
    type: str
    count_type: str | None = None


@dataclass
class _Element:
    """An element of the header."""

    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)

    def index(self, *names: str) -> int | None:
        """Return the index of the first property that has one of the names, or None."""
        return next((k for k, p in enumerate(self.properties) if p.name in names), None)

    def has_lists(self) -> bool:
        """Return whether a property is a list."""
        return any(p.count_type for p in self.properties)


def read_ply(content: bytes) -> Triangles:
    """Read the faces and triangle strips of a file. Other elements and properties are not used.

    Args:
        content: Content of the file.

    Raises:
        BodyError: The file cannot be read.
    """
    # A binary number after the header may look like a line end: only that of the header counts.
    first_end = _LINE_END.search(content)
    end_of_line = rb"\r" if first_end and first_end[0] == b"\r" else rb"\r?\n"
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*(" + end_of_line + rb"|$)", content)
    if end is None:
        raise BodyError("has no end_header", code="file-invalid", action="Export the mesh again")
    head = decode_text(content[: end.end()])
    elements, order = _read_header(head)
    if order:
        reader: _BinaryReader | _TextReader = _BinaryReader(content, end.end(), order)
    else:
        body = decode_text(content[end.end() :])
        reader = _TextReader(Words(b"\n" * head.count(b"\n") + body))
    vertices = np.zeros((0, 3))
    corners, counts = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    last = max((k for k, e in enumerate(elements) if e.name in _USED), default=-1)
    for element in elements[: last + 1]:
        used = _find_used(element)
        if element.name == "vertex":
            vertices = reader.read_values(element, used)
            continue
        values, lengths = reader.read_lists(element, used[0] if used else None)
        if element.name == "tristrips":
            values, lengths = _divide_strips(values, lengths)
        if element.name in _USED:
            corners.append(values)
            counts.append(lengths)
    if last == len(elements) - 1:
        reader.check_end()
    faces = divide_faces(vertices, np.concatenate(corners), np.concatenate(counts))
    return Triangles(vertices, faces)


def _read_header(text: bytes) -> tuple[list[_Element], str]:
    """Return the elements, and the order of bytes, which is "" for text."""
    elements: list[_Element] = []
    order: str | None = None
    for number, line in enumerate(text.split(b"\n"), 1):
        words = line.decode("latin-1").split()
        key = words[0] if words else ""
        if key == "format" and len(words) > 1 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif key == "element" and len(words) == 3 and words[2].isdigit():
            elements.append(_Element(words[1], int(words[2])))
        elif key == "property" and elements and len(words) == 3 and words[1] in _TYPES:
            elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
        elif key == "property" and elements and len(words) == 5 and words[1] == "list":
            if words[2] not in _TYPES or words[3] not in _TYPES:
                raise text_error(number, f"{show(line)} has an unknown type")
            types = _TYPES[words[3]], _TYPES[words[2]]
            elements[-1].properties.append(_Property(words[4], *types))
        elif key not in ("", "ply", "comment", "obj_info", "end_header"):
            raise text_error(number, f"{show(line)} is not a line of a PLY header")
    if order is None:
        raise text_error(2, "the header states no format", "file-invalid")
    return elements, order


def _find_used(element: _Element) -> list[int]:
    """Return the indices of the properties that are read.

    Raises:
        BodyError: An element lacks one of them.
    """
    names = _USED.get(element.name, ())
    is_vertex = element.name == "vertex"
    used = [element.index(n) for n in names] if is_vertex else [element.index(*names)]
    found = [
        k for k in used if k is not None and bool(element.properties[k].count_type) != is_vertex
    ]
    if names and (len(found) < len(used) or (is_vertex and element.has_lists())):
        needs = "values x, y and z and no lists" if is_vertex else "list vertex_indices"
        raise BodyError(
            f"its element {element.name} has no {needs}"
            if not is_vertex
            else f"its vertices must have {needs}",
            code="file-invalid",
            action="Export the mesh again",
            element=element.name,
        )
    return found


def _divide_strips(values: Int, counts: Int) -> tuple[Int, Int]:
    """Return the triangles of strips; -1 ends a strip within a list.

    Each vertex makes a triangle with the two before it; every other triangle is reversed.
    """
    ends = np.cumsum(counts)
    triangles = []
    for row in np.split(values, ends[:-1]):
        for strip in np.split(row, np.flatnonzero(row == _STRIP_END)):
            strip = strip[strip != _STRIP_END]
            faces = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
            faces[1::2] = faces[1::2, [1, 0, 2]]
            triangles.append(faces)
    faces = np.concatenate(triangles) if triangles else np.zeros((0, 3), np.int64)
    # Strips repeat vertices to turn.
    is_flat = (faces == np.roll(faces, 1, axis=1)).any(1)
    faces = faces[~is_flat]
    return faces.reshape(-1), np.full(len(faces), 3)


class _TextReader:
    """Reader of elements in text."""

    def __init__(self, words: Words) -> None:
        self._words = words

    def read_values(self, element: _Element, used: list[int]) -> Float:
        """Return properties of all rows (n, u) of an element without lists."""
        rows = self._words.rows(element.count, len(element.properties), used, element.name)
        with np.errstate(over="ignore"):  # rounded as in a binary file
            columns = [rows[:, i].astype(element.properties[k].type) for i, k in enumerate(used)]
        return np.stack(columns, axis=1).astype(float)

    def read_lists(self, element: _Element, used: int | None) -> tuple[Int, Int]:
        """Return the values of one list in all rows, and their number in each row (n,)."""
        words, all_words = self._words, self._words.words
        at, values, lengths = words.at, list[bytes](), list[int]()
        for _ in range(element.count if element.properties else 0):
            for k, p in enumerate(element.properties):
                words.at, at = at, at + 1
                if p.count_type is not None:
                    length = words.count(f"values in {element.name}")
                    at = words.at + length
                if k == used:
                    values += all_words[words.at : at]
                    lengths.append(length)
            if at > len(all_words):
                raise words.end_error(f"{element.count} rows of {element.name}")
        words.at = at
        try:
            return parse_integers(values), np.array(lengths, np.int64)
        except ValueError:
            wrong = values[find_wrong_number(values, int)]
            line = words.line(all_words.index(wrong, 0))
            raise number_error(line, wrong, "a whole number") from None

    def check_end(self) -> None:
        """Raise BodyError if words follow."""
        words = self._words
        if words.at < len(words.words):
            problem = f"{show(words.words[words.at])} follows after the last element"
            raise text_error(words.line(), problem)


class _BinaryReader:
    """Reader of elements in binary, from a byte on, in an order of bytes, "<" or ">"."""

    def __init__(self, content: bytes, at: int, order: str) -> None:
        self._content, self._at, self._order = content, at, order

    def check_end(self) -> None:
        """Accept bytes after the last element."""

    def read_values(self, element: _Element, used: list[int]) -> Float:
        """Return properties of all rows (n, u) of an element without lists."""
        rows = self._read_rows(element, [0] * len(element.properties))
        return np.stack([rows[f"v{k}"].astype(float) for k in used], axis=1)

    def read_lists(self, element: _Element, used: int | None) -> tuple[Int, Int]:
        """Return the values of one list in all rows, and their number in each row (n,)."""
        none = np.zeros(0, np.int64)
        if not element.count or not element.properties:
            return none, none
        start = self._at
        lengths = [row[1] for row in self._walk_row(element)]
        self._at = start
        try:
            rows = self._read_rows(element, lengths)
        except BodyError:
            return self._walk_rows(element, used)
        lists = [k for k, p in enumerate(element.properties) if p.count_type]
        if any((rows[f"n{k}"] != lengths[k]).any() for k in lists):
            self._at = start
            return self._walk_rows(element, used)
        if used is None:
            return none, none
        values = rows[f"v{used}"].astype(np.int64).reshape(-1)
        return values, np.full(element.count, lengths[used])

    def _read_rows(self, element: _Element, lengths: list[int]) -> np.ndarray:
        """Return all rows, as if their lists had the lengths of the first row."""
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for k, p in enumerate(element.properties):
            if p.count_type is None:
                fields.append((f"v{k}", self._order + p.type))
            else:
                fields.append((f"n{k}", self._order + p.count_type))
                fields.append((f"v{k}", self._order + p.type, (lengths[k],)))
        dtype = np.dtype(fields)
        if element.count * dtype.itemsize > len(self._content) - self._at:
            raise self._end_error(element)
        rows = np.frombuffer(self._content, dtype, element.count, self._at)
        self._at += rows.nbytes
        return rows

    def _walk_row(self, element: _Element) -> list[tuple[int, int]]:
        """Pass over one row; return the place and the length of each list, or zeros."""
        places = []
        for p in element.properties:
            length, size = 1, int(p.type[1])
            if p.count_type is not None:
                end = self._at + int(p.count_type[1])
                length = self._length(self._content[self._at : end], p.count_type)
                self._at = end
            places.append((self._at, length if p.count_type else 0))
            self._at += length * size
            if length < 0 or self._at > len(self._content):
                raise self._end_error(element)
        return places

    def _length(self, content: bytes, kind: str) -> int:
        if kind[0] == "f":
            return int(np.frombuffer(content, self._order + kind)[0])
        is_little = self._order == "<"
        return int.from_bytes(content, "little" if is_little else "big", signed=kind[0] == "i")

    def _walk_rows(self, element: _Element, used: int | None) -> tuple[Int, Int]:
        parts, lengths = [], []
        for _ in range(element.count):
            places = self._walk_row(element)
            if used is not None:
                at, length = places[used]
                parts.append(
                    self._content[at : at + length * int(element.properties[used].type[1])]
                )
                lengths.append(length)
        if used is None:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        kind = self._order + element.properties[used].type
        return np.frombuffer(b"".join(parts), kind).astype(np.int64), np.array(lengths, np.int64)

    def _end_error(self, element: _Element) -> BodyError:
        return BodyError(
            f"ends before its {element.count} rows of {element.name}",
            code="file-truncated",
            action="Export or copy the file again",
        )
