"""Read STL files, binary and text."""

from __future__ import annotations

import re

import numpy as np

from ....core.arrays import Float
from ....core.errors import BodyError
from .text import (
    Words,
    decode_text,
    find_wrong_number,
    number_error,
    parse_floats,
    show,
    text_error,
)
from .triangles import Triangles

HEAD_BYTES = 84
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
#: Counts that programs write before they know how many triangles follow.
UNSET_COUNTS = (0, 2**32 - 1)
#: Largest coordinate of a plausible record, and share of records whose normal is that of the
#: triangle, or zero.
MAX_COORDINATE, MIN_PLAUSIBLE_SHARE = 1e12, 0.9
MIN_NORMAL_COSINE = 0.9
CHECKED_RECORDS = 10_000
#: Words of a triangle of a text file, None for numbers.
_FACET = b"facet normal - - - outer loop vertex - - - vertex - - - vertex - - - endloop endfacet"
_WORDS = [word if word != b"-" else None for word in _FACET.split()]
_NUMBERS = [k for k, word in enumerate(_WORDS) if word is None][3:]  # without the normal
_FACET_WORD = re.compile(rb"(?i)facet")
#: A line that names a solid. Names may be anything but the start of a triangle.
_SOLID = re.compile(rb"solid\b(?:(?!\bfacet\s+normal\b)[^\n])*")


def is_stl(content: bytes) -> bool:
    """Return whether content is STL: text, or records of triangles after a head of 84 bytes."""
    return _is_text(content) or _is_binary(content)


def _is_text(content: bytes) -> bool:
    return _starts_as_text(content) and _FACET_WORD.search(decode_text(content)) is not None


def _starts_as_text(content: bytes) -> bool:
    start = decode_text(content[:4096])
    return b"\0" not in start and start.lstrip()[:5].lower() == b"solid"


def _is_binary(content: bytes) -> bool:
    count, records, rest = _split_binary(content)
    if count and count == len(records) and not rest:
        return True
    return _are_plausible(_stated(records, count))


def _stated(records: np.ndarray, count: int) -> np.ndarray:
    """Return the stated number of records, or all if there are fewer or none is stated."""
    return records[:count] if count else records


def _split_binary(content: bytes) -> tuple[int, np.ndarray, int]:
    """Return the stated number of triangles, the records, and the number of bytes after them."""
    if len(content) < HEAD_BYTES:
        return 0, np.zeros(0, RECORD), 0
    count = int.from_bytes(content[HEAD_BYTES - 4 : HEAD_BYTES], "little")
    whole, rest = divmod(len(content) - HEAD_BYTES, RECORD.itemsize)
    return count, np.frombuffer(content, RECORD, whole, HEAD_BYTES), rest


def _are_plausible(records: np.ndarray) -> bool:
    """Return whether records are triangles with their normals, and not any bytes."""
    records = records[:CHECKED_RECORDS]
    if not len(records):
        return False
    with np.errstate(all="ignore"):
        x, normals = records["corners"].astype(float), records["normal"].astype(float)
        crosses = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        areas, lengths = np.linalg.norm(crosses, axis=1), np.linalg.norm(normals, axis=1)
        cosines = np.abs(np.einsum("ni,ni->n", crosses, normals)) / (areas * lengths)
        is_real = np.abs(x).max((1, 2)) < MAX_COORDINATE
        is_plausible = is_real & ((lengths == 0) | (areas == 0) | (cosines > MIN_NORMAL_COSINE))
    return bool(is_plausible.mean() >= MIN_PLAUSIBLE_SHARE and (areas[is_plausible] > 0).any())


def read_stl(content: bytes) -> Triangles:
    """Read the triangles of all solids.

    Args:
        content: Content of the file.

    Raises:
        BodyError: The file cannot be read, or ends too early.
    """
    if _is_text(content) or (_starts_as_text(content) and not _is_binary(content)):
        vertices, notes = _read_text(decode_text(content))
    else:
        vertices, notes = _read_binary(content)
    return Triangles(vertices, np.arange(len(vertices)).reshape(-1, 3), notes)


def _read_binary(content: bytes) -> tuple[Float, tuple[str, ...]]:
    count, records, rest = _split_binary(content)
    held = len(records)
    if len(content) >= HEAD_BYTES and not held and (count or rest):
        raise _truncated(count, held)
    notes: tuple[str, ...] = ()
    if len(content) >= HEAD_BYTES and count == held and not rest:
        pass
    elif not _are_plausible(_stated(records, count)):
        raise BodyError(
            "is neither text nor binary STL", code="file-invalid", action="Export the mesh again"
        )
    elif count > held or _are_plausible(records[count:]):
        is_whole = count in UNSET_COUNTS or count < held or _is_closed(records)
        if rest or not is_whole:
            raise _truncated(count, held)
        notes = (f"read the {held} triangles that the file holds; it states {count}",)
    else:
        extra = len(content) - HEAD_BYTES - RECORD.itemsize * count
        noun = "byte" if extra == 1 else "bytes"
        notes = (f"ignored {extra} {noun} after the last triangle",)
        records = records[:count]
    return records["corners"].reshape(-1, 3).astype(float), notes


def _truncated(count: int, held: int) -> BodyError:
    stated = "" if count in UNSET_COUNTS else f" of {count}"
    return BodyError(
        f"is cut off: it ends after {held}{stated} triangles",
        code="file-truncated",
        action="Export or copy the file again",
        held=held,
        stated=count,
    )


def _is_closed(records: np.ndarray) -> bool:
    """Return whether each edge has two triangles."""
    _, corners = np.unique(records["corners"].reshape(-1, 3), axis=0, return_inverse=True)
    faces = corners.reshape(-1, 3)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def _read_text(text: bytes) -> tuple[Float, tuple[str, ...]]:
    """Return the corners of triangles (3 n, 3), and notes."""
    text = text.lower()
    is_ended = b"endsolid" in text
    words = Words(_SOLID.sub(b"", text.replace(b"endsolid", b"solid")))
    count, rest = divmod(len(words.words), len(_WORDS))
    size = len(_WORDS)
    for k, word in enumerate(_WORDS):
        if rest or (word is not None and words.words[k::size].count(word) != count):
            raise _find_wrong_word(words)
    corners = np.empty((count, 9))
    for column, k in enumerate(_NUMBERS):
        numbers = words.words[k::size]
        try:
            corners[:, column] = parse_floats(numbers)
        except ValueError:
            at = find_wrong_number(numbers, float)
            raise number_error(words.line(at * size + k), numbers[at]) from None
    note = "the file has no endsolid: it may be cut off"
    return corners.reshape(-1, 3), () if is_ended else (note,)


def _find_wrong_word(words: Words) -> BodyError:
    """Return the error for the first word that is not as in a triangle."""
    for at, word in enumerate(words.words):
        expected = _WORDS[at % len(_WORDS)]
        if expected is not None and word != expected:
            problem = f"{show(word)} follows where '{expected.decode()}' should"
            return text_error(words.line(at), problem)
        if expected is None and word in _WORDS:
            return text_error(words.line(at), f"{show(word)} follows where a number should")
    return words.end_error("last triangle is complete")
