"""The CAD kernel, which takes seconds to load, loaded while another process works."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from types import ModuleType

from .. import kernels


@contextmanager
def loaded_meanwhile(module: str) -> Iterator[Callable[[], ModuleType]]:
    """Imports that module of `kernels` beside what is done meanwhile; what is given waits for it,
    and gives `kernels.brep`.

    Nothing else may import the kernel before: two threads that do so at once find it half made. A
    program that ended before the import is done would show its traceback: it waits at the end.
    An import that fails is tried again, and fails, where the kernel is asked for.
    """

    def load() -> None:
        with suppress(ImportError):
            import_module(f"{kernels.__name__}.{module}")

    thread = threading.Thread(target=load)

    def brep() -> ModuleType:
        thread.join()
        return import_module(f"{kernels.__name__}.brep")

    thread.start()
    try:
        yield brep
    finally:
        thread.join()
