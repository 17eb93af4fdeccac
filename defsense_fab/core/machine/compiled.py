"""Functions compiled to machine code, which is cached until any of its sources changes.

Numba copies compiled functions and constants of other modules into a function's machine code, but
keeps that code as long as the function's own file is unchanged: an edit of a callee in another file
has no effect. Here the cache folder of a module is named by the content of the module and of all
modules that it imports, directly or not.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any

from ..storage.kept_files import delete_oldest

#: Relative imports at a module's top: the code of this package that its functions can reach.
_IMPORT = re.compile(rb"^from (\.+)([\w.]*) import (?:\(([^)]*)\)|([^\n#]*))", re.MULTILINE)
_HASH_DIGITS = 16  # in a folder's name
_ANY_HASH = "[0-9a-f]" * _HASH_DIGITS
#: Size of the machine code in a folder of several states of a module; the oldest are deleted.
MAX_KEPT_BYTES = 50_000_000
_CHOSEN_SUBFOLDER = "defsense-fab"  # of NUMBA_CACHE_DIR
_lock = Lock()


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile the decorated function, without the interpreter's lock and with a cache.

    Args:
        **options: Options of `numba.njit`.

    Returns:
        A decorator. The machine code is cached in a folder for this state of the sources.
    """
    import numba

    def decorate(function: Callable[..., Any]) -> Any:
        # Numba looks up its cache folder while it decorates.
        with _lock:
            before = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = str(_cache_folder(Path(function.__code__.co_filename), before))
            try:
                return numba.njit(cache=True, nogil=True, **options)(function)
            finally:
                numba.config.CACHE_DIR = before

    return decorate


def is_compiled(module: ModuleType) -> bool:
    """Return whether all compiled functions of a module are cached.

    Others are compiled at their first call, which takes seconds.

    Args:
        module: An imported module.
    """
    functions = [
        f for f in vars(module).values() if getattr(f, "__module__", "") == module.__name__
    ]
    return all(
        f.signatures or any(Path(f.stats.cache_path).glob(f"*.{f.__name__}-*.nbi"))
        for f in functions
        if hasattr(f, "py_func")
    )


def source_files(module: Path) -> frozenset[Path]:
    """Return the files of a module and of all modules of its package that it imports.

    Args:
        module: The module's file.
    """
    reached, queue = set[Path](), [module]
    while queue:
        path = queue.pop()
        if path not in reached:
            reached.add(path)
            queue += _read(path)[1]
    return frozenset(reached)


def kept_code() -> list[Path]:
    """Return the folders in which machine code of this package's functions is kept."""
    package = Path(__file__).parents[2]
    folders = [*package.rglob("__pycache__"), _user_folder()]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        folders.append(Path(chosen) / _CHOSEN_SUBFOLDER)
    return [path for folder in folders for path in folder.glob(f"*-{_ANY_HASH}") if path.is_dir()]


def _user_folder() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("defsense-fab") / "compiled"


@cache
def _cache_folder(module: Path, chosen: str) -> Path:
    """Return the folder of a module's machine code.

    It is in the folder `chosen` by NUMBA_CACHE_DIR, or else next to the module, where the folders
    of its earlier states are removed. Where that cannot be written, it is in the user's cache.
    """
    key = sha256(b"".join(sorted(_read(path)[0] for path in source_files(module)))).hexdigest()
    name = f"{module.stem}-{key[:_HASH_DIGITS]}"
    is_shared = bool(chosen) or not os.access(module.parent, os.W_OK)
    if chosen:
        folder = Path(chosen) / _CHOSEN_SUBFOLDER  # other folders there are not this package's
    else:
        folder = _user_folder() if is_shared else module.parent / "__pycache__"
    if not (folder / name).exists():
        states = folder.glob(f"{'*' if is_shared else module.stem}-{_ANY_HASH}")
        delete_oldest(states, MAX_KEPT_BYTES if is_shared else 0)
    return folder / name


@cache
def _read(module: Path) -> tuple[bytes, list[Path]]:
    """Return the hash of a file's content, and the files of the modules that it imports."""
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
