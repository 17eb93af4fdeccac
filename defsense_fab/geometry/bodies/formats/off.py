"""Read OFF files of Geomview, with normals, colors and texture coordinates."""

from __future__ import annotations

import re

import numpy as np

from ....core.arrays import Int
from ....core.errors import BodyError
from .polygons import divide_faces
from .text import Words, decode_text, number_error, parse_integers, text_error, without_comments
from .triangles import Triangles

#: Start of the text: comments, the name of the format, and what follows it.
OFF_HEADER = re.compile(rb"(?i)\s*(#[^\n]*\n\s*)*(ST)?(C)?(N)?(4)?(n)?OFF\s+(?=BINARY|[#\d])")
_NORMAL_WORDS, _TEXTURE_WORDS = 3, 2
_COLOR_WORDS = (0, 1, 3, 4)  # possible numbers of words of a color


def read_off(content: bytes) -> Triangles:
    """Read the faces of a file. Lines may be broken anywhere.

    Args:
        content: Content of the file.

    Raises:
        BodyError: The file cannot be read.
    """
    text = decode_text(content)
    header = OFF_HEADER.match(text)
    if header is None:
        raise text_error(1, "the file does not start with OFF and its counts")
    if header[5] or header[6] or text[header.end() :].upper().startswith(b"BINARY"):
        raise BodyError(
            "is binary or four-dimensional OFF, which is not read",
            code="format-variant-unsupported",
            action="Export OFF as text in three dimensions",
        )
    # The header's lines stay as blank lines, so that lines are counted from the file's start.
    blank = b"\n" * text[: header.end()].count(b"\n")
    words = Words(without_comments(blank + text[header.end() :]))
    vertex_count, face_count = words.count("vertices"), words.count("faces")
    counts_line = words.line(words.at - 1)
    if words.line() == counts_line or words.words_of_line() == 1:
        words.take(1, "number of edges")  # some programs leave it out
    start, problem = words.at, None
    for width in _vertex_widths(words, header):
        words.at = start
        try:
            vertices = words.rows(vertex_count, width, range(3), "vertices")
            corners, counts, first = _read_faces(words, face_count)
        except BodyError as error:
            problem = problem or error
        else:
            break
    else:
        assert problem is not None
        raise problem
    faces = divide_faces(vertices, corners, counts, lambda k: words.line(int(first[k])))
    return Triangles(vertices, faces)


def _vertex_widths(words: Words, header: re.Match[bytes]) -> list[int]:
    """Return the possible numbers of words of a vertex, the likeliest first."""
    width = 3 + _NORMAL_WORDS * bool(header[4]) + _TEXTURE_WORDS * bool(header[2])
    in_line = words.words_of_line()
    if header[3]:
        return list(dict.fromkeys([max(in_line, width), width + 4, width + 3]))
    return [width, in_line] if in_line > width else [width]


def _read_faces(words: Words, face_count: int) -> tuple[Int, Int, Int]:
    """Return the corners of all faces, the number of each, and the index of its first word."""
    rest = words.words[words.at :]
    if len(rest) == 4 * face_count and rest[::4].count(b"3") == face_count:
        corners = words.integers(4 * face_count, "faces").reshape(-1, 4)[:, 1:].reshape(-1)
        first = np.arange(len(words.words) - len(rest), len(words.words), 4)
        return corners, np.full(face_count, 3), first
    start = words.at
    try:
        return _walk_faces(words, face_count, has_colors=True)
    except BodyError as error:
        # Lines that hold several faces look like faces with colors, and are too few.
        words.at = start
        try:
            return _walk_faces(words, face_count, has_colors=False)
        except BodyError:
            raise error from None


def _walk_faces(words: Words, face_count: int, has_colors: bool) -> tuple[Int, Int, Int]:
    """Read faces; with colors, the rest of a line in which a face ends is its color."""
    all_words, at = words.words, words.at
    line_ends = np.cumsum([len(line.split()) for line in words.text.split(b"\n")])
    ends = np.repeat(line_ends, np.diff(line_ends, prepend=0)).tolist()  # of each word's line
    corner_words: list[bytes] = []
    counts: list[int] = []
    first: list[int] = []
    what = f"{face_count} faces"
    for _ in range(face_count):
        words.at = at
        count = words.count("corners")
        corner_words += words.take(count, what)
        counts.append(count)
        first.append(at)
        at = words.at
        if has_colors:
            color = ends[at - 1] - at
            if color not in _COLOR_WORDS:
                problem = f"{color} words follow a face of {count} corners"
                raise text_error(words.line(at), problem)
            at += color
    words.at = at
    if at < len(all_words):
        raise text_error(words.line(at), f"more follows than the {what} that the file states")
    try:
        corners = parse_integers(corner_words)
    except ValueError:
        raise _find_wrong_corner(words, counts, first) from None
    return corners, np.array(counts, np.int64), np.array(first, np.int64)


def _find_wrong_corner(words: Words, counts: list[int], first: list[int]) -> BodyError:
    for count, start in zip(counts, first, strict=True):
        for index in range(start + 1, start + 1 + count):
            try:
                parse_integers([words.words[index]])
            except ValueError:
                return number_error(words.line(index), words.words[index], "a whole number")
    raise AssertionError("all corners are numbers")
