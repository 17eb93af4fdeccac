"""Text files of other programs: encodings and line ends."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..arrays import Float

_MARKS = (
    (b"\xff\xfe", "utf-16-le"),
    (b"\xfe\xff", "utf-16-be"),
    (b"\xef\xbb\xbf", "utf-8"),
)
_LINE_END = re.compile(r"\r\n|\r|\n")


def decode_text(content: bytes) -> str:
    """Return text in UTF-8 or UTF-16, with or without byte order mark, or in Windows-1252."""
    mark, encoding = find_encoding(content)
    if encoding:
        return content[mark:].decode(encoding, "replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def find_encoding(content: bytes) -> tuple[int, str]:
    """Return the bytes of the byte order mark, and the encoding; "" where nothing states it.

    UTF-16 without a mark is detected by the zero bytes of its first two characters.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return len(mark), encoding
    if content[1:4:2] == b"\0\0" and content[:1] != b"\0" and content[2:3] != b"\0":
        return 0, "utf-16-le"
    if content[0:4:2] == b"\0\0" and content[1:2] != b"\0" and content[3:4] != b"\0":
        return 0, "utf-16-be"
    return 0, ""


def parse_numbers(cells: Sequence[str]) -> Float:
    """Return cells as numbers (n,), NaN where empty.

    Raises:
        ValueError: If a cell is not a number; so is 1_000, which Python reads.
    """
    if any("_" in cell for cell in cells):
        raise ValueError("underscore")
    return np.fromiter((float(cell) if cell else np.nan for cell in cells), float, len(cells))


def split_lines(text: str) -> list[str]:
    """Return the lines of a text with any line ends; the last one is empty if the text ends one."""
    return _LINE_END.split(text)
