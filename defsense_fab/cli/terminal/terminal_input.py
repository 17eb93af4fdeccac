"""Read the bytes of keys from a terminal, on POSIX systems and Windows."""

from __future__ import annotations

import os
import select
import sys
import time

_POLL_INTERVAL_S = 0.01  # of a Windows console, which cannot be waited for

if sys.platform == "win32":
    import msvcrt

    class Terminal:
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

    class Terminal:
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
