"""Text files of other programs: encodings and line ends."""

from __future__ import annotations

import re

_MARKS = (
    (b"\xff\xfe", "utf-16-le"),
    (b"\xfe\xff", "utf-16-be"),
    (b"\xef\xbb\xbf", "utf-8"),
)
_LINE_END = re.compile(r"\r\n|\r|\n")


def decode_text(content: bytes) -> str:
    """Return text in UTF-8 or UTF-16, with or without byte order mark, or in Windows-1252.

    UTF-16 without a mark is detected by the zero bytes of its first two characters.
    """
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, "replace")
    if content[1:4:2] == b"\0\0" and content[:1] != b"\0":
        return content.decode("utf-16-le", "replace")
    if content[0:4:2] == b"\0\0" and content[1:2] != b"\0":
        return content.decode("utf-16-be", "replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def split_lines(text: str) -> list[str]:
    """Return the lines of a text with any line ends; the last one is empty if the text ends one."""
    return _LINE_END.split(text)
