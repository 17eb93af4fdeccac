"""Keys as terminals send them: some are several bytes, and none may be taken for others."""

import os
import pty
import sys
import time

import pytest

from defsense_fab.cli.terminal.keys import Keys


@pytest.fixture
def typed(monkeypatch):
    """A terminal as standard input, and what types on it."""
    user, terminal = pty.openpty()
    with open(terminal, encoding="utf-8", closefd=True) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield lambda data: os.write(user, data)
    os.close(user)


def pressed(keys, timeout=0.3):
    return keys.get(timeout)


def test_an_arrow_is_one_key_that_means_nothing(typed):
    """Its last byte is a letter: "down" ends with B, which goes back and drops a reading."""
    with Keys() as keys:
        for arrow in (b"\x1b[A", b"\x1b[B", b"\x1bOB", b"\x1b[1;5B", b"\x1b[15~"):
            typed(arrow)
            assert pressed(keys) is None
            assert pressed(keys, 0.1) is None
        typed(b"b")
        assert pressed(keys) == "b"


def test_keys_that_come_together_come_one_by_one(typed):
    with Keys() as keys:
        typed("R\x1b[Bté\n".encode())
        assert [pressed(keys) for _ in range(5)] == ["r", None, "t", "é", "enter"]
        assert pressed(keys, 0.05) is None


def test_the_waiting_keys_need_no_new_press(typed):
    """select does not see what a buffer holds: the second key must come at once all the same."""
    with Keys() as keys:
        typed(b"st")
        assert pressed(keys) == "s"
        begun = time.monotonic()
        assert pressed(keys, 5.0) == "t"
        assert time.monotonic() - begun < 1.0


def test_escape_alone(typed):
    with Keys() as keys:
        typed(b"\x1b")
        assert pressed(keys) == "escape"
        typed(b"q")
        assert pressed(keys) == "q"
