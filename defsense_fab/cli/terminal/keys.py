"""Read single keys from a terminal, without waiting for the end of a line."""

from __future__ import annotations

import re
import sys
from types import TracebackType

from ...core.errors import DeviceError
from .terminal_input import Terminal

_ESCAPE, _END = b"\x1b", b"\x04"
_MAX_KEY_GAP_S = 0.05  # time between the bytes of one key
#: One complete key: a control sequence or single shift (ECMA-48, 5.4 and 8.3.141), Alt with a
#: character, or a character in UTF-8.
_ESCAPED = re.compile(
    rb"\x1b\[[0-?]*[ -/]*[@-~]|\x1bO.|\x1b[^\[O]"
    rb"|[\x00-\x1a\x1c-\x7f]|[\xc0-\xdf].|[\xe0-\xef]..|[\xf0-\xff]...|[\x80-\xbf]",
    re.DOTALL,
)
_ANY = re.compile(rb"\x1b\[?[0-?]*[ -/]*|.+", re.DOTALL)


class Keys:
    """Reader of keys; use it as a context manager, which restores the terminal.

    Args:
        otherwise: What the user can do without keys, for the error.
    """

    def __init__(self, otherwise: str = "give --auto") -> None:
        self._waiting, self._otherwise = b"", otherwise

    def __enter__(self) -> Keys:
        """Start to read keys.

        Raises:
            DeviceError: Standard input is not a terminal (`terminal-missing`).
        """
        if not sys.stdin.isatty():
            raise DeviceError(
                "standard input is not a terminal, and this command reads keys",
                code="terminal-missing",
                action=f"Run it in a terminal, or {self._otherwise}",
            )
        self._terminal = Terminal()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._terminal.close()

    def get(self, timeout: float) -> str | None:
        """Return the next key.

        Args:
            timeout: Time to wait in s.

        Returns:
            `"enter"`, `"escape"`, or a character in lower case; `"q"` at the end of the input;
            None for no key, an arrow or a function key.
        """
        if not self._waiting and not self._read(timeout):
            return None
        key = _ESCAPED.match(self._waiting)
        while key is None:  # the key is not complete yet
            if self._waiting.endswith(_END) or not self._read(_MAX_KEY_GAP_S):
                key = _ANY.match(self._waiting)
                break
            key = _ESCAPED.match(self._waiting)
        assert key is not None  # _ANY matches everything
        self._waiting = self._waiting[key.end() :]
        return _name(key[0])

    def _read(self, timeout: float) -> bool:
        """Add the bytes that arrive within `timeout` s; return False if there are none."""
        read = self._terminal.read(timeout)
        if read is None:
            return False
        self._waiting += read or _END
        return True


def _name(key: bytes) -> str | None:
    if key in (b"\n", b"\r", b" "):
        return "enter"
    if key == _END:
        return "q"
    if key[:1] == _ESCAPE:
        return "escape" if len(key) == 1 else None
    return key.decode("utf-8", errors="replace").lower()
