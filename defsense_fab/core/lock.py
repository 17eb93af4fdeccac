"""One holder of a file at a time, among processes and among threads."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import StorageError
from .files import storage_errors

try:
    import fcntl
except ImportError:  # Windows, which is not supported: nothing is locked there
    fcntl = None  # type: ignore[assignment]

#: What file systems say that have no locks (some of networks).
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)


def claim(file: int) -> bool:
    """Lock an open file, by its descriptor, until it is closed; False where another holds it. True
    also where the system or the file system has no locks. Raises OSError for other refusals."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    return True


@contextmanager
def locked(path: Path, message: str) -> Iterator[None]:
    """Hold the lock of the file `path`, which is made where there is none and keeps its content.

    The file stays: were it removed, a second holder could lock the removed one, and a third a new
    one. The system ends the lock with the process. Raises StorageError, with `message` where
    another holds it.
    """
    with storage_errors(path):
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        with storage_errors(path):
            if not claim(file):
                raise StorageError(message)
        yield
    finally:
        os.close(file)
