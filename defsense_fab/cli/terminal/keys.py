"""Read single keys from a terminal, without waiting for the end of a line.

It works on POSIX systems and Windows.
"""

from __future__ import annotations

import os
import re
import select
import sys
import time

from ...core.errors import DeviceError

_ESCAPE, _END = b"\x1b", b"\x04"
_MAX_KEY_GAP_S = 0.05  # time between the bytes of one key
_POLL_INTERVAL_S = 0.01  # of a Windows console, which cannot be waited for
#: One complete key: a control sequence or single shift (ECMA-48, 5.4 and 8.3.141), Alt with a
#: character, or a character in UTF-8.
_ESCAPED = re.compile(
    rb"\x1b\[[0-?]*[ -/]*[@-~]|\x1bO.|\x1b[^\[O]"
    rb"|[\x00-\x1a\x1c-\x7f]|[\xc0-\xdf].|[\xe0-\xef]..|[\xf0-\xff]...|[\x80-\xbf]",
    re.DOTALL,
)
_INCOMPLETE = re.compile(rb"\x1b\[?[0-?]*[ -/]*|.+", re.DOTALL)


if sys.platform == "win32":
    import msvcrt

    class _Terminal:
        """Windows console, which always reads single keys."""

        def read(self, timeout: float) -> bytes | None:
            """Return one key in UTF-8 that arrives within `timeout` s.

            Returns a meaningless control sequence for arrow and function keys, b"" at the end of
            the input, and None for no key.
            """
            end = time.monotonic() + timeout
            while not msvcrt.kbhit():
                if time.monotonic() >= end:
                    return None
                time.sleep(_POLL_INTERVAL_S)
            key = msvcrt.getwch()
            if key == "\x03":  # Ctrl-C, which getwch returns like other keys
                raise KeyboardInterrupt
            if key in ("\0", "\xe0"):
                msvcrt.getwch()  # discard the code of the key
                return b"\x1b[~"
            return b"" if key == "\x1a" else key.encode("utf-8", errors="replace")

        def close(self) -> None:
            """Do nothing: the console was not changed."""

else:
    import termios
    import tty

    class _Terminal:
        """Standard input, which passes each key on immediately until it is closed."""

        def __init__(self) -> None:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)

        def read(self, timeout: float) -> bytes | None:
            """Return the bytes that arrive within `timeout` s.

            Returns b"" at the end of the input, and None for no bytes. Reads the descriptor
            directly, since select does not see bytes in the buffer of a file object.
            """
            descriptor = sys.stdin.fileno()
            if not select.select([descriptor], [], [], timeout)[0]:
                return None
            return os.read(descriptor, 1024)

        def close(self) -> None:
            """Restore the terminal."""
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)


class Keys:
    """Reader of keys; use it as a context manager, which restores the terminal.

    Args:
        alternative: What the user can do without keys, for the error.
    """

    def __init__(self, alternative: str = "give --auto") -> None:
        self._pending, self._alternative = b"", alternative

    def __enter__(self) -> Keys:
        """Start to read keys.

        Raises:
            DeviceError: Standard input is not a terminal (`terminal-missing`).
        """
        if not sys.stdin.isatty():
            raise DeviceError(
                "standard input is not a terminal, and this command reads keys",
                code="terminal-missing",
                action=f"Run it in a terminal, or {self._alternative}",
            )
        self._terminal = _Terminal()
        return self

    def __exit__(self, *error: object) -> None:
        self._terminal.close()

    def get(self, timeout: float) -> str | None:
        """Return the next key.

        Args:
            timeout: Time to wait in s.

        Returns:
            `"enter"`, `"escape"`, or a character in lower case; `"q"` at the end of the input;
            None for no key, an arrow or a function key.
        """
        if not self._pending and not self._read(timeout):
            return None
        key = _ESCAPED.match(self._pending)
        while key is None:  # the key is not complete yet
            if self._pending.endswith(_END) or not self._read(_MAX_KEY_GAP_S):
                key = _INCOMPLETE.match(self._pending)
                break
            key = _ESCAPED.match(self._pending)
        assert key is not None  # it matches everything
        self._pending = self._pending[key.end() :]
        return _name(key[0])

    def _read(self, timeout: float) -> bool:
        """Add the bytes that arrive within `timeout` s; return False if there are none."""
        read = self._terminal.read(timeout)
        if read is None:
            return False
        self._pending += read or _END
        return True


def _name(key: bytes) -> str | None:
    if key in (b"\n", b"\r", b" "):
        return "enter"
    if key == _END:
        return "q"
    if key[:1] == _ESCAPE:
        return "escape" if len(key) == 1 else None
    return key.decode("utf-8", errors="replace").lower()
