"""Find the line of every key and list item in a TOML text, for error messages.

`tomllib` keeps no positions. The scanner here expects a text that `tomllib` has accepted, so it
only follows the structure: headers, dotted and quoted keys, strings, lists and inline tables.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping

#: Keys of tables, and positions from 0 in lists, from the top of the file.
KeyPath = tuple[str | int, ...]

_SPACE = re.compile(r"[ \t]*")
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
#: Longest first: three quotes open a string over several lines.
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"""(?:"{0,2})|'
    r"'''.*?'''(?:'{0,2})|"
    r'"(?:[^"\\\n]|\\.)*"|'
    r"'[^'\n]*'",
    re.DOTALL,
)
_SCALAR = re.compile(r"[^,\]}\n#]+")


def key_lines(text: str) -> Mapping[KeyPath, int]:
    """Return the line, from 1, on which each key or list item of a valid TOML text first appears.

    A table has the line of its header, or of the first key that implies it.
    """
    return _Scanner(text.replace("\r\n", "\n")).run()


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text, self.position = text, 0
        self.lines: dict[KeyPath, int] = {}
        self._counted, self._line = 0, 1
        self._list_lengths: dict[KeyPath, int] = {}  # of lists of tables, such as [[poses]]

    def run(self) -> Mapping[KeyPath, int]:
        table: KeyPath = ()
        while self._skip(_BLANK) < len(self.text):
            if self.text[self.position] == "[":
                table = self._header()
            else:
                self._pair(table)
        return self.lines

    def _header(self) -> KeyPath:
        is_list = self.text.startswith("[[", self.position)
        line = self._line_here()
        self.position += 2 if is_list else 1
        *parents, last = self._key()
        self.position += 2 if is_list else 1
        path: KeyPath = ()
        for name in parents:
            path = self._newest(self._record((*path, name), line))
        path = self._record((*path, last), line)
        if not is_list:
            return path
        count = self._list_lengths.get(path, 0)
        self._list_lengths[path] = count + 1
        return self._record((*path, count), line)

    def _newest(self, path: KeyPath) -> KeyPath:
        """Return the last item so far where `path` is a list of tables, else `path`."""
        count = self._list_lengths.get(path)
        return path if count is None else (*path, count - 1)

    def _pair(self, table: KeyPath) -> None:
        line, path = self._line_here(), table
        for name in self._key():
            path = self._record((*path, name), line)
        self.position += 1  # the equals sign
        self._skip(_SPACE)
        self._value(path)

    def _key(self) -> list[str]:
        """Read a dotted key, and the spaces around it."""
        names: list[str] = []
        while True:
            self._skip(_SPACE)
            start = self.position
            if self.text[start] in "\"'":
                quoted = self.text[start : self._skip(_STRING)]
                names.append(str(tomllib.loads(f"x = {quoted}")["x"]))
            else:
                names.append(self.text[start : self._skip(_BARE_KEY)])
            self._skip(_SPACE)
            if self.text[self.position] != ".":
                return names
            self.position += 1

    def _value(self, path: KeyPath) -> None:
        first = self.text[self.position]
        if first in "\"'":
            self._skip(_STRING)
        elif first not in "[{":
            self._skip(_SCALAR)
        else:
            self.position += 1
            count = 0
            while self._skip(_BLANK) < len(self.text) and self.text[self.position] not in "]}":
                if self.text[self.position] == ",":
                    self.position += 1
                elif first == "{":
                    self._pair(path)
                else:
                    self._value(self._record((*path, count), self._line_here()))
                    count += 1
            self.position += 1

    def _skip(self, pattern: re.Pattern[str]) -> int:
        match = pattern.match(self.text, self.position)
        self.position = match.end() if match else self.position + 1
        return self.position

    def _record(self, path: KeyPath, line: int) -> KeyPath:
        self.lines.setdefault(path, line)
        return path

    def _line_here(self) -> int:
        self._line += self.text.count("\n", self._counted, self.position)
        self._counted = self.position
        return self._line
