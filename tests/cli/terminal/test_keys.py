"""Keys of a terminal: some are several bytes, and none may be confused with another."""

import os
import pty
import sys
import time

import pytest

from defsense_fab.cli.terminal.keys import Keys


@pytest.fixture
def typed(monkeypatch):
    """Replace standard input by a terminal, and return a function that types on it."""
    user, terminal = pty.openpty()
    with open(terminal, encoding="utf-8", closefd=True) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield lambda data: os.write(user, data)
    os.close(user)


def pressed(keys, timeout=0.3):
    return keys.get(timeout)


def test_arrow_is_one_key_without_meaning(typed):
    """The last byte of "down" is B, which alone goes back and discards a reading."""
    with Keys() as keys:
        for arrow in (b"\x1b[A", b"\x1b[B", b"\x1bOB", b"\x1b[1;5B", b"\x1b[15~"):
            typed(arrow)
            assert pressed(keys) is None
            assert pressed(keys, 0.1) is None
        typed(b"b")
        assert pressed(keys) == "b"


def test_keys_in_one_read_are_returned_one_by_one(typed):
    with Keys() as keys:
        typed("R\x1b[Bté\n".encode())
        assert [pressed(keys) for _ in range(5)] == ["r", None, "t", "é", "enter"]
        assert pressed(keys, 0.05) is None


def test_buffered_keys_are_returned_immediately(typed):
    """select does not see buffered bytes, but the second key must be returned immediately."""
    with Keys() as keys:
        typed(b"st")
        assert pressed(keys) == "s"
        started_at = time.monotonic()
        assert pressed(keys, 60.0) == "t"
        assert time.monotonic() - started_at < 30.0


def test_escape_alone(typed):
    with Keys() as keys:
        typed(b"\x1b")
        assert pressed(keys) == "escape"
        typed(b"q")
        assert pressed(keys) == "q"
