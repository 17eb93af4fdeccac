"""Import a CAD kernel while a child process works."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from importlib import import_module
from types import ModuleType


@contextlib.contextmanager
def load_kernel_meanwhile(module: str) -> Iterator[Callable[[], ModuleType]]:
    """Import a CAD kernel in a thread while another process works, since it takes seconds.

    Nothing else may import the kernel before the thread ends: two threads that import it at once
    find it half initialized. The context waits for the thread at its end, since a program that ends
    before would show a traceback. If the import fails it is repeated, and fails, when the kernel is
    requested.

    Args:
        module: Name of the module of `geometry.kernels` to import: `occ` or `brep`.

    Yields:
        A function that waits for the import and returns the module `kernels.brep`.
    """

    def load() -> None:
        with contextlib.suppress(ImportError):
            import_module(f"{__package__}.{module}")

    thread = threading.Thread(target=load)

    def wait_for_brep() -> ModuleType:
        thread.join()
        return import_module(f"{__package__}.brep")

    thread.start()
    try:
        yield wait_for_brep
    finally:
        thread.join()
