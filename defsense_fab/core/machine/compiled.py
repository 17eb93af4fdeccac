"""Functions compiled to machine code, which is kept until anything that it was made from changes.

Numba takes compiled functions and constants of other modules into a function's machine code, but
keeps that code as long as the function's own file stays the same: an edit of a callee in another
file has no effect. Here the folder of a module's machine code is named by the content of the module
and of all modules that it imports, directly or not.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any

#: Relative imports at a module's top: what its compiled functions can reach of this package.
_IMPORT = re.compile(rb"^from (\.+)([\w.]*) import (?:\(([^)]*)\)|([^\n#]*))", re.MULTILINE)
_DIGITS = 16  # of the content's hash in a folder's name
_lock = Lock()


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: `numba.njit` with these options, without the interpreter's lock, and with its
    machine code kept in a folder of its own for this state of the sources."""
    import numba

    def decorate(function: Callable[..., Any]) -> Any:
        # Numba looks up its folder while it decorates.
        with _lock:
            before = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = str(_folder(Path(function.__code__.co_filename), before))
            try:
                return numba.njit(cache=True, nogil=True, **options)(function)
            finally:
                numba.config.CACHE_DIR = before

    return decorate


def is_compiled(module: ModuleType) -> bool:
    """Whether the machine code of all compiled functions of a module is kept from an earlier use:
    what is not is compiled where it is called first, which takes seconds."""
    own = [f for f in vars(module).values() if getattr(f, "__module__", "") == module.__name__]
    return all(
        f.signatures or any(Path(f.stats.cache_path).glob(f"*.{f.__name__}-*.nbi"))
        for f in own
        if hasattr(f, "py_func")
    )


def sources(module: Path) -> frozenset[Path]:
    """The files of a module and of all modules of its package that it imports, directly or not."""
    found, todo = set[Path](), [module]
    while todo:
        path = todo.pop()
        if path not in found:
            found.add(path)
            todo += _read(path)[1]
    return frozenset(found)


@cache
def _folder(module: Path, chosen: str) -> Path:
    """Where a module's machine code lies: in the folder `chosen` by NUMBA_CACHE_DIR, or else beside
    the module, where that of its earlier states is removed; the user's cache where neither is."""
    key = sha256(b"".join(sorted(_read(path)[0] for path in sources(module)))).hexdigest()
    name = f"{module.stem}-{key[:_DIGITS]}"
    if chosen:
        return Path(chosen) / name
    if not os.access(module.parent, os.W_OK):
        from platformdirs import user_cache_path

        return user_cache_path("defsense-fab") / "compiled" / name
    beside = module.parent / "__pycache__"
    if not (beside / name).exists():
        for old in beside.glob(f"{module.stem}-{'[0-9a-f]' * _DIGITS}"):
            shutil.rmtree(old, ignore_errors=True)
    return beside / name


@cache
def _read(module: Path) -> tuple[bytes, list[Path]]:
    """The hash of a file's content, and the files of the modules that it imports."""
    content = module.read_bytes()
    imported = []
    for dots, dotted, several, one in _IMPORT.findall(content):
        # As strings: pathlib would take most of the time.
        base = os.path.join(
            module.parents[len(dots) - 1], *filter(None, dotted.decode().split("."))
        )
        if os.path.isfile(base + ".py"):
            imported.append(base + ".py")
            continue
        names = [
            "__init__",
            *(n.split()[0] for n in (several or one).decode().split(",") if n.strip()),
        ]
        imported += [p for n in names if os.path.isfile(p := os.path.join(base, n + ".py"))]
    return sha256(content).digest(), [Path(p) for p in imported]
