"""Read text of mesh files: encodings, line ends, numbers, and the lines of errors."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from ....core.storage.text import find_encoding

_COMMENT = re.compile(rb"#[^\n]*")
_DECIMAL_COMMA = re.compile(rb"[-+]?\d*,\d+([eE][-+]?\d+)?")
MAX_SHOWN = 40  # characters of a file in a message


def decode_text(content: bytes) -> bytes:
    r"""Return text whose lines end in "\n", without byte order mark, in one byte a character.

    Letters beyond ASCII, which only names and comments have, are in any encoding.
    """
    mark, encoding = find_encoding(content)
    if encoding:
        content = content[mark:].decode(encoding, "replace").encode("utf-8")
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return content


def without_comments(text: bytes) -> bytes:
    """Return text without comments, which "#" starts, and with the same lines."""
    return _COMMENT.sub(b"", text) if b"#" in text else text


def text_error(line: int, problem: str, code: str = "file-invalid", action: str = "") -> BodyError:
    """Return the error for a line of a file, without the file's name."""
    return BodyError(
        f"line {line}: {problem}", code=code, action=action or "Export the mesh again", line=line
    )


def show(word: bytes) -> str:
    """Return a word or line of a file as messages show it."""
    text = " ".join(word.decode("utf-8", "replace").split())
    text = "".join(c if c.isprintable() else "?" for c in text)
    return f"'{text[:MAX_SHOWN]}...'" if len(text) > MAX_SHOWN else f"'{text}'"


def number_error(line: int, word: bytes, kind: str = "a number") -> BodyError:
    """Return the error for a word that is not a number."""
    if _DECIMAL_COMMA.fullmatch(word):
        problem = f"{show(word)} has a decimal comma"
        return text_error(
            line, problem, "decimal-comma", "Export the mesh again with decimal points"
        )
    return text_error(line, f"{show(word)} is not {kind}", "not-a-number")


def parse_floats(words: Sequence[bytes]) -> Float:
    """Return words as numbers (n,).

    Raises:
        ValueError: A word is not a number.
    """
    if b"_" in b"".join(words):  # Python reads 1_000
        raise ValueError
    return np.array(list(map(float, words)), float)


def parse_integers(words: Sequence[bytes]) -> Int:
    """Return words as whole numbers (n,).

    Raises:
        ValueError: A word is not a whole number of at most 18 digits.
    """
    if b"_" in b"".join(words):
        raise ValueError
    try:
        return np.array(list(map(int, words)), np.int64)
    except OverflowError:
        raise ValueError from None


def find_wrong_number(words: Sequence[bytes], kind: type) -> int:
    """Return the index of the first word that is not of the kind, int or float."""
    parse = parse_integers if kind is int else parse_floats
    for index, word in enumerate(words):
        try:
            parse([word])
        except ValueError:
            return index
    raise AssertionError("all words are numbers")


class Words:
    """Words of a text, read one after the other.

    Args:
        text: Text from `decode_text` without comments.

    Attributes:
        text: The text.
        words: Its words.
        at: Index of the next word.
    """

    def __init__(self, text: bytes) -> None:
        self.text, self.words, self.at = text, text.split(), 0

    def line(self, index: int | None = None) -> int:
        """Return the line, from 1, of a word; by default of the next one."""
        index = self.at if index is None else index
        count = 0
        lines = self.text.rstrip().split(b"\n")
        for number, line in enumerate(lines, 1):
            count += len(line.split())
            if count > index:
                return number
        return len(lines)

    def words_of_line(self) -> int:
        """Return the number of words from the next one to the end of its line."""
        count = 0
        for line in self.text.split(b"\n"):
            count += len(line.split())
            if count > self.at:
                return count - self.at
        return 0

    def end_error(self, what: str) -> BodyError:
        """Return the error for a text that ends too early."""
        line = self.line(len(self.words))
        return text_error(line, f"the file ends before its {what}", "file-truncated")

    def take(self, count: int, what: str) -> list[bytes]:
        """Return the next words; `what` names them in the error for a text that ends."""
        if count > len(self.words) - self.at:
            raise self.end_error(what)
        self.at += count
        return self.words[self.at - count : self.at]

    def count(self, what: str) -> int:
        """Read a number of things."""
        value = int(self.integers(1, f"number of {what}")[0])
        if value < 0:
            raise text_error(self.line(self.at - 1), f"{value} is not a number of {what}")
        return value

    def integers(self, count: int, what: str) -> Int:
        """Read whole numbers (count,)."""
        words = self.take(count, what)
        try:
            return parse_integers(words)
        except ValueError:
            at = find_wrong_number(words, int)
            line = self.line(self.at - count + at)
            raise number_error(line, words[at], "a whole number") from None

    def rows(self, count: int, width: int, used: Sequence[int], what: str) -> Float:
        """Read rows of words.

        Args:
            count: Number of rows.
            width: Words of a row.
            used: Indices of the words of each row to return, u of them.
            what: Noun for the rows.

        Returns:
            Numbers (count, u).
        """
        start = self.at
        taken = self.take(count * width, f"{count} {what}")
        columns = []
        for k in used:
            words = taken[k::width]
            try:
                columns.append(parse_floats(words))
            except ValueError:
                at = find_wrong_number(words, float)
                line = self.line(start + at * width + k)
                raise number_error(line, words[at]) from None
        return np.stack(columns, axis=1)
