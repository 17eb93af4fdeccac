"""Which of the user's files a body was made from: what its script opens and imports."""

from __future__ import annotations

import os
import site
import sys
import sysconfig
import threading
from dataclasses import dataclass
from importlib.util import source_from_cache
from pathlib import Path
from typing import Any

from ...core.storage.files import digest

_CREATES = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
#: Not /run itself: drives of users are mounted in /run/media.
_SYSTEM = ("/dev", "/etc", "/proc", "/run/user", "/sys", "/usr", "/Library", "/System")
_USERS_OWN = (".cache", ".config", ".local", "Library")  # in the home folder: settings and caches


@dataclass(frozen=True)
class SourceFile:
    """A file and the hash of its content; None where there was none to read."""

    path: Path
    content: str | None

    @classmethod
    def now(cls, path: Path) -> SourceFile:
        """The file as it is."""
        try:
            return cls(path, digest(path))
        except OSError:
            return cls(path, None)


class OpenedFiles:
    """An audit hook (`sys.addaudithook`) that keeps which files were opened for reading, and their
    hashes at that time. Files of Python, of installed packages, of the system and of the user's
    caches do not count, nor do those that were written first. Files that were not there count in
    `folder`. What native code opens by itself is not seen."""

    def __init__(self, folder: Path) -> None:
        self.found: dict[str, SourceFile] = {}
        self.active = True
        self._folder = os.path.realpath(folder)
        self._libraries = _libraries()
        self._written: set[str] = set()
        self._own = threading.local()

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        if not self.active or getattr(self._own, "busy", False):
            return
        if event == "open":
            name, _, flags = args
            if flags & _CREATES:
                self._wrote(name)
            else:
                self._read(name)
        elif event == "import":
            self._read(args[1])  # None but for extension modules
        elif event == "os.rename":
            self._wrote(args[1])

    def _wrote(self, name: Any) -> None:
        path = _absolute(name)
        if path and (path not in self.found or self.found[path].content is None):
            self.found.pop(path, None)
            self._written.add(path)

    def _read(self, name: Any) -> None:
        path = _absolute(name)
        if not path or path in self.found or path in self._written:
            return
        self._own.busy = True  # reading it here is an event too
        try:
            real = os.path.realpath(path)
            if self._counts(real) and not os.path.isdir(real):
                file = SourceFile.now(Path(path))
                if file.content is not None or _within(real, self._folder):
                    self.found[path] = file
        finally:
            self._own.busy = False

    def _counts(self, path: str) -> bool:
        """A library's folder may hold the script's, as /usr may; it does not count as one then."""
        inside = _within(path, self._folder)
        return not any(
            _within(path, root) and not (inside and _within(self._folder, root))
            for root in self._libraries
        )


def _absolute(name: Any) -> str | None:
    """The path of a file that an event names; of bytecode, that of its source."""
    if not isinstance(name, str | bytes | os.PathLike):
        return None  # a descriptor
    path = os.path.abspath(os.fsdecode(name))
    if "\0" in path:
        return None
    if path.endswith(".pyc"):
        try:
            return source_from_cache(path)
        except ValueError:
            return None
    return path


def _libraries() -> tuple[str, ...]:
    """Folders whose files belong to what is installed, not to the user's work."""
    folders = [sys.prefix, sys.base_prefix, sys.exec_prefix, *_SYSTEM]
    folders += [p for k, p in sysconfig.get_paths().items() if k in ("stdlib", "platstdlib")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    folders += [os.path.join(os.path.expanduser("~"), name) for name in _USERS_OWN]
    folders.append(str(Path(__file__).resolve().parents[2]))  # this package, run from its sources
    return tuple(dict.fromkeys(os.path.realpath(f) for f in folders))


def _within(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)
