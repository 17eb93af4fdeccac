"""Single keys from a terminal, without waiting for the end of a line."""

from __future__ import annotations

import select
import sys
from types import TracebackType

from ..core.errors import DeviceError


class Keys:
    """Reads keys while it is entered; the terminal is as before when it is left."""

    def __enter__(self) -> Keys:
        """Raises DeviceError where standard input is no terminal, or cannot be read by keys."""
        if not sys.stdin.isatty():
            raise DeviceError(
                "this command asks for keys, but standard input is no terminal; run it in one, or"
                " give --auto"
            )
        try:
            import termios
            import tty
        except ImportError:
            raise DeviceError(
                "keys cannot be read one by one on this system; give --auto"
            ) from None
        self._before = termios.tcgetattr(sys.stdin)
        tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        import termios

        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def get(self, timeout: float) -> str | None:
        """The next key within `timeout` s, "enter" for the end of a line, or None."""
        ready, _, _ = select.select([sys.stdin], [], [], timeout)
        if not ready:
            return None
        key = sys.stdin.read(1)
        return "enter" if key in ("\n", "\r", " ") else key.lower() or "q"
