"""A build while the page is used: in a process of its own, so that it can be cancelled, and that
what goes wrong in it takes nothing else along."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ...core.errors import DefsenseError
from ...core.progress import Progress

#: Done in the other process: a folder, until which stage, and where to tell of progress.
Work = Callable[[Path, str, Progress], None]
_EARLY = ("body", "mesh")  # stages that need neither poses nor cords
_LEAVES = 5.0  # s that a cancelled build has to leave


class BuildWork:
    """One build at a time. `told` hears of progress (share done, sentence) and `ended` what came of
    it: None, or what went wrong in a sentence; both on a thread of this."""

    def __init__(
        self,
        told: Callable[[float, str], None],
        ended: Callable[[str | None], None],
        work: Work | None = None,
    ) -> None:
        """`work` is done in the other process, and is a build up to a stage where none is given."""
        self._told, self._ended, self._work = told, ended, work or _build
        self._process: Any = None
        self._lock, self._cancelled = threading.Lock(), False

    @property
    def running(self) -> bool:
        """Whether there is one."""
        return self._process is not None

    def start(self, folder: Path, until: str = "report") -> bool:
        """Build the device in a folder up to a stage; whether it began, which it does not while
        another one runs."""
        with self._lock:
            if self._process is not None:
                return False
            spawn = multiprocessing.get_context("spawn")
            ours, theirs = spawn.Pipe(duplex=False)
            self._cancelled = False
            self._process = spawn.Process(
                target=_run, args=(self._work, folder, until, theirs), daemon=True
            )
            self._process.start()
            theirs.close()
        threading.Thread(target=self._follow, args=(ours,), daemon=True).start()
        return True

    def cancel(self) -> None:
        """The last finished build stays, and what is done already is taken up by the next."""
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
        outcome: str | None
        while True:
            try:
                share, said = ours.recv()
            except EOFError:  # the process is gone
                outcome = "the build ended without a word: is the memory full?"
                break
            if share is None:
                outcome = said
                break
            self._told(share, said)
        self._process.join()
        if self._cancelled:
            outcome = "cancelled"
        with self._lock:
            self._process = None
        self._ended(outcome)


def _run(work: Work, folder: Path, until: str, theirs: Connection) -> None:
    """In the other process."""

    def progress(stage: str, share: float, message: str) -> None:
        theirs.send((share, f"{stage}: {message}"))

    try:
        work(folder, until, progress)
        theirs.send((None, None))
    except DefsenseError as error:
        theirs.send((None, str(error)))
    except Exception as error:
        theirs.send((None, f"the build failed ({type(error).__name__}: {error})"))


def _build(folder: Path, until: str, progress: Progress) -> None:
    from ...core.device_file import load_device
    from ...pipeline.build.build import build

    build(load_device(folder, complete=until not in _EARLY), until, progress)
