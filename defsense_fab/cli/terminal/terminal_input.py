"""The bytes of a terminal as keys are pressed: POSIX systems, and Windows."""

from __future__ import annotations

import os
import select
import sys
import time

_BETWEEN = 0.01  # s between two looks at a Windows console, which cannot be waited for

if sys.platform == "win32":
    import msvcrt

    class Terminal:
        """The console, which reads keys one by one without being told to."""

        def read(self, timeout: float) -> bytes | None:
            """One key in UTF-8 within `timeout` s, an arrow or function key as a control sequence
            of no meaning; b"" at the end of the input, None for nothing."""
            end = time.monotonic() + timeout
            while not msvcrt.kbhit():
                if time.monotonic() >= end:
                    return None
                time.sleep(_BETWEEN)
            key = msvcrt.getwch()
            if key == "\x03":  # Ctrl-C, which is a key like others to getwch
                raise KeyboardInterrupt
            if key in ("\0", "\xe0"):
                msvcrt.getwch()  # which of these keys it is
                return b"\x1b[~"
            return b"" if key == "\x1a" else key.encode("utf-8", errors="replace")

        def close(self) -> None:
            """Nothing was changed."""

else:
    import termios
    import tty

    class Terminal:
        """Standard input, which passes on each key until it is closed."""

        def __init__(self) -> None:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)

        def read(self, timeout: float) -> bytes | None:
            """What comes within `timeout` s; b"" at the end of the input, None for nothing. Reads
            the descriptor itself: what a file object keeps in a buffer is not seen by select."""
            descriptor = sys.stdin.fileno()
            if not select.select([descriptor], [], [], timeout)[0]:
                return None
            return os.read(descriptor, 1024)

        def close(self) -> None:
            """The terminal is as before."""
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
