"""One holder of a file at a time, among processes and among threads."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import StorageError
from .files import storage_errors

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

#: What file systems say that have no locks (some of networks).
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)
#: The byte that is locked on Windows, where nobody reads or writes: other programs cannot reach
#: what is locked there.
_FAR = 2**30


def claim(file: int) -> bool:
    """Lock an open file, by its descriptor, until it is closed; False where another holds it. True
    also where the file system has no locks. Raises OSError for other refusals."""
    try:
        if sys.platform == "win32":
            before = os.lseek(file, 0, os.SEEK_CUR)
            os.lseek(file, _FAR, os.SEEK_SET)
            try:
                msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
            except PermissionError:  # what another holds
                return False
            finally:
                os.lseek(file, before, os.SEEK_SET)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    return True


@contextmanager
def locked(path: Path, message: str, code: str = "file-in-use") -> Iterator[None]:
    """Hold the lock of the file `path`, which is made where there is none and keeps its content.

    The file stays: were it removed, a second holder could lock the removed one, and a third a new
    one. The system ends the lock with the process. Raises StorageError, with `message` and `code`
    where another holds it.
    """
    with storage_errors(path):
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        with storage_errors(path):
            if not claim(file):
                raise StorageError(message, code=code, path=path)
        yield
    finally:
        os.close(file)
