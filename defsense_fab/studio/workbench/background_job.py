"""Work in a process of its own, which can be followed, paused and cancelled, and whose failure
takes nothing else along."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

from ...core.errors import DefsenseError, StorageError

if sys.platform == "win32":
    from multiprocessing.connection import PipeConnection as Connection
else:
    from multiprocessing.connection import Connection

CANCELLED = "cancelled"
_log = logging.getLogger(__name__)
_LEAVES = 5.0  # s that cancelled work has to leave
_GO_ON, _WAIT = "go on", "wait"


class Teller:
    """What the work in the other process says to this one. It waits here while it is paused, and
    ends with EOFError when the program that began it is gone: an OSError would be taken for one of
    files."""

    def __init__(self, ours: Connection) -> None:
        self._ours = ours

    def progress(self, share: float, told: str) -> None:
        """The share that is done, and a sentence."""
        self._send("progress", (share, told))

    def found(self, thing: Any) -> None:
        """Something on the way to the result."""
        self._send("found", thing)

    def _send(self, kind: str, thing: Any) -> None:
        try:
            while self._ours.poll():
                if self._ours.recv() == _WAIT:
                    self._ours.send(("paused", None))
                    while self._ours.recv() != _GO_ON:
                        pass
                    self._ours.send(("went on", None))
            self._ours.send((kind, thing))
        except OSError:
            raise EOFError from None


Work = Callable[..., None]  # (teller, *arguments), a function of a module


class BesideWork:
    """One work at a time. All that is heard comes on a thread of this: `told` of progress (share
    done, sentence), `ended` of what came of it (None, or what went wrong in a sentence), `found` of
    what the work finds on its way, `paused` of whether it stands still."""

    def __init__(
        self,
        what: str,
        told: Callable[[float, str], None],
        ended: Callable[[str | None], None],
        found: Callable[[Any], None] = lambda _: None,
        paused: Callable[[bool], None] = lambda _: None,
    ) -> None:
        self._what = what
        self._told, self._ended, self._found, self._paused = told, ended, found, paused
        self._process: Any = None
        self._pipe: Connection | None = None
        self._lock, self._cancelled = threading.Lock(), False

    @property
    def running(self) -> bool:
        """Whether there is one."""
        return self._process is not None

    def begin(self, work: Work, *arguments: Any) -> bool:
        """Whether it began, which it does not while another one runs."""
        with self._lock:
            if self._process is not None:
                return False
            spawn = multiprocessing.get_context("spawn")
            ours, theirs = spawn.Pipe()
            self._cancelled = False
            process = spawn.Process(
                target=_work, args=(work, self._what, theirs, arguments), daemon=True
            )
            try:
                process.start()
            except OSError as error:
                raise StorageError(
                    f"the {self._what} cannot begin: {error.strerror}; close other programs"
                ) from None
            self._process, self._pipe = process, ours
            theirs.close()
        threading.Thread(target=self._follow, args=(ours,), daemon=True).start()
        return True

    def pause(self) -> None:
        """From the next thing that it says, it waits."""
        self._order(_WAIT)

    def go_on(self) -> None:
        """After a pause."""
        self._order(_GO_ON)

    def cancel(self) -> None:
        """End it where it is."""
        with self._lock:
            if self._process is not None:
                self._cancelled = True
                self._process.terminate()

    def close(self) -> None:
        """Cancel, and wait for it."""
        self.cancel()
        process = self._process
        if process is not None:
            process.join(_LEAVES)

    def _order(self, order: str) -> None:
        with self._lock:
            if self._process is not None and self._pipe is not None:
                try:
                    self._pipe.send(order)
                except OSError:  # it has ended, and that is about to be told
                    return

    def _follow(self, ours: Connection) -> None:
        outcome: str | None
        while True:
            try:
                kind, thing = ours.recv()
            except (EOFError, OSError):  # the process is gone
                outcome = f"the {self._what} ended without a word: is the memory full?"
                break
            if kind == "over":
                outcome = thing
                break
            try:
                if kind == "progress":
                    self._told(*thing)
                elif kind == "found":
                    self._found(thing)
                else:
                    self._paused(kind == "paused")
            except Exception:  # of those who listen: the work goes on, and ends as it would
                _log.exception("what the %s tells was not taken", self._what)
        self._process.join()
        if self._cancelled:
            outcome = CANCELLED
        with self._lock:
            self._process = self._pipe = None
        ours.close()
        self._ended(outcome)


def _work(work: Work, what: str, theirs: Connection, arguments: tuple[Any, ...]) -> None:
    """In the other process, which the studio ends: Ctrl-C is for the studio alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout.flush()
    os.dup2(2, 1)  # native libraries print there
    try:
        work(Teller(theirs), *arguments)
        theirs.send(("over", None))
    except DefsenseError as error:
        theirs.send(("over", str(error)))
    except EOFError:  # nobody is there any more to hear of it
        return
    except Exception as error:
        theirs.send(("over", f"the {what} failed ({type(error).__name__}: {error})"))
