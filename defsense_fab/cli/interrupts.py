"""Signals that interrupt a command: Ctrl-C, and the request to end of `kill` and of a shutdown."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

INTERRUPTING_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def handle_interrupts(handler: Callable[[int, Any], Any] | signal.Handlers) -> Iterator[None]:
    """Handle interrupting signals in a block; outside of the main thread, which gets none, do not.

    Args:
        handler: Function of a signal's number and the frame, or `signal.SIG_IGN`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in INTERRUPTING_SIGNALS}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier or signal.SIG_DFL)
