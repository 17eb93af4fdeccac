"""Long work while the page is used: in a process of its own, so that it can be cancelled, and that
what goes wrong in it takes nothing else along."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from ...core.errors import DefsenseError
from ...core.progress import Progress

CANCELLED = "cancelled"
_LEAVES = 5.0  # s that what was cancelled has to leave


class ProcessWork:
    """One piece of work of a kind (`what`, for sentences) at a time. `told` hears of progress
    (share done, sentence) and `ended` what went wrong, in a sentence (None: nothing), and what
    came of it; both on a thread of this."""

    def __init__(
        self, what: str, told: Callable[[float, str], None],
        ended: Callable[[str | None, Any], None],
    ) -> None:  # fmt: skip
        self._what, self._told, self._ended = what, told, ended
        self._process: Any = None
        self._lock, self._cancelled = threading.Lock(), False

    @property
    def running(self) -> bool:
        """Whether there is one."""
        return self._process is not None

    def start(self, job: Callable[[Progress], Any]) -> bool:
        """Do `job`, which can be pickled and whose result can be, too; whether it began, which it
        does not while another one runs."""
        with self._lock:
            if self._process is not None:
                return False
            spawn = multiprocessing.get_context("spawn")
            ours, theirs = spawn.Pipe(duplex=False)
            self._cancelled = False
            self._process = spawn.Process(target=_work, args=(job, self._what, theirs), daemon=True)
            self._process.start()
            theirs.close()
        threading.Thread(target=self._follow, args=(ours,), daemon=True).start()
        return True

    def cancel(self) -> None:
        """End it; what was finished before stays."""
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

    def _follow(self, ours: Connection) -> None:
        problem: str | None
        result: Any = None
        while True:
            try:
                share, said = ours.recv()
            except (EOFError, OSError):  # the process is gone
                problem = f"{self._what} ended without a word: is the memory full?"
                break
            if share is None:
                problem, result = said
                break
            self._told(share, said)
        self._process.join()
        if self._cancelled:
            problem, result = CANCELLED, None
        with self._lock:
            self._process = None
        self._ended(problem, result)


def _work(job: Callable[[Progress], Any], what: str, theirs: Connection) -> None:
    """In the other process, which the studio ends: Ctrl-C is for the studio alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout.flush()
    os.dup2(2, 1)  # native libraries print there

    def progress(stage: str, share: float, message: str) -> None:
        theirs.send((share, f"{stage}: {message}"))

    try:
        theirs.send((None, (None, job(progress))))
    except DefsenseError as error:
        theirs.send((None, (str(error), None)))
    except Exception as error:
        theirs.send((None, (f"{what} failed ({type(error).__name__}: {error})", None)))
