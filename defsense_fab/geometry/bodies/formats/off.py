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
    problem = None
    for start, width in _layouts(words, header, vertex_count):
        words.at = start
        try:
            vertices = words.rows(vertex_count, width, range(3), "vertices")
            corners, counts, first = _read_faces(words, face_count)
            break
        except BodyError as error:
            problem = problem or error
    else:
        assert problem is not None
        raise problem
    faces = divide_faces(vertices, corners, counts, lambda k: words.line(int(first[k])))
    return Triangles(vertices, faces)


def _layouts(words: Words, header: re.Match[bytes], vertex_count: int) -> list[tuple[int, int]]:
    """Return pairs of the first word and the number of words of vertices, likeliest first.

    The number of edges may be missing, and colors have three or four words. Where each vertex has
    a line, the lines show both; other layouts are tried.
    """
    after_counts = words.at
    is_same_line = words.line() == words.line(words.at - 1)
    starts = [after_counts + 1] if is_same_line else [after_counts, after_counts + 1]
    layouts = []
    for start in starts:
        words.at = start
        widths = _vertex_widths(words, header)
        line_width = _width_of_lines(words, vertex_count)
        if line_width in widths:
            return [(start, line_width)]
        layouts += [(start, width) for width in widths]
    return layouts


def _width_of_lines(words: Words, count: int) -> int:
    """Return the number of words of each of the next lines, or 0 if they differ."""
    in_first = words.words_of_line()
    widths = [len(line.split()) for line in words.text.split(b"\n")[words.line() - 1 :]]
    widths = [width for width in widths if width][:count]
    return in_first if len(widths) == count and set(widths) == {in_first} else 0


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
        if error.code == "too-many-faces":
            raise
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
        problem = f"more follows than the {what} that the file states"
        raise text_error(words.line(at), problem, "too-many-faces")
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
