"""Writing without half-written files, and hashing what a result was derived from."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import DefsenseError, StorageError

# One holder of a file at a time, among processes and among threads.

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


#: Error codes of the operating system's refusals.
_CODES: dict[type[OSError], str] = {
    FileNotFoundError: "file-not-found",
    NotADirectoryError: "not-a-folder",
    IsADirectoryError: "not-a-file",
    FileExistsError: "path-exists",
    PermissionError: "permission-denied",
}
_LETS_GO = 2.0  # s within which a virus scanner is done with a new file


@contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals into one clear line."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise StorageError(
                f"{path}: the disk is full; free some space and run again",
                code="disk-full",
                path=path,
            ) from None
        raise StorageError(
            f"{error.filename or path}: {error.strerror or error}; check the path and permissions",
            code=_CODES.get(type(error), "file-unusable"),
            path=Path(error.filename or path),
        ) from None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside `path`, of the same suffix and of this process only, to write to: moved into
    place at the end, gone after an error. Raises StorageError where the system refuses."""
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        with storage_errors(path):
            try:
                yield temporary
                _move(temporary, path)
            except OSError as error:
                if error.filename == str(temporary):
                    error.filename = str(path)
                raise
    finally:
        with suppress(OSError):  # there is none where its folder could not be written
            temporary.unlink()


@contextmanager
def replacing_folder(path: Path, *, over: bool = False) -> Iterator[Path]:
    """An empty folder beside `path`, of this process only, to write to: moved into place at the
    end, gone after an error. What is at `path` stays until then; an empty folder is replaced, any
    other only `over` it. Raises StorageError where something is there, and where the system
    refuses."""
    path = path.resolve()  # "." has no name
    new = path.with_name(f".{path.name}.{os.getpid()}.part")
    old = path.with_name(f".{path.name}.{os.getpid()}.old")
    try:
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            new.mkdir()
            yield new
            if path.exists():
                if path.is_file() or (not over and any(path.iterdir())):
                    raise StorageError(
                        f"{path}: is there already; choose another folder",
                        code="path-exists",
                        path=path,
                    )
                _move(path, old)
            _move(new, path)
    finally:
        if old.exists() and not path.exists():
            old.rename(path)
        for left in (new, old):
            shutil.rmtree(left, ignore_errors=True)


def _move(source: Path, target: Path) -> None:
    """On Windows a file that another program has open, if only a virus scanner, stays where it is:
    most let go of it soon."""
    end = time.monotonic() + (_LETS_GO if sys.platform == "win32" else 0.0)
    while True:
        try:
            source.replace(target)
            return
        except PermissionError:
            if time.monotonic() >= end:
                raise
        time.sleep(0.05)


def check_folder(path: Path) -> None:
    """Before long work whose results go to a folder `path`, made if need be: raises StorageError
    where it cannot be made, or takes no files."""
    with storage_errors(path):
        whole = path.absolute()
        there = next((p for p in (whole, *whole.parents) if os.path.lexists(p)), None)
        if there is None:  # a drive that is not there
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        if not there.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(there))
        if not os.access(there, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(there))


def free_path(path: Path) -> Path:
    """A name by which nothing is there: x.mid, x-2.mid, x-3.mid, ..."""
    number, free = 1, path
    while os.path.lexists(free):
        number += 1
        free = path.parent / f"{path.stem}-{number}{path.suffix}"
    return free


def write_json(path: Path, data: Any) -> None:
    """`data` as JSON, whole or not at all. Raises StorageError."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """`text` in UTF-8 with its line ends as they are, whole or not at all. Raises StorageError."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


def load_json(path: Path, error: type[DefsenseError], hint: str) -> Any:
    """What is in `path`. Raises `error`, with a `hint`, where it cannot be read or is not JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise error(
            f"{path}: cannot be read: {problem.strerror}; {hint}",
            code=unreadable_code(problem),
            path=path,
        ) from None
    except ValueError as problem:
        raise error(
            f"{path}: not valid JSON ({problem}), cut off or edited; {hint}",
            code="not-json",
            path=path,
        ) from None


def unreadable_code(error: OSError) -> str:
    """Return the error code of a file that cannot be read."""
    return "file-not-found" if isinstance(error, FileNotFoundError) else "file-unreadable"


def digest(*parts: Any) -> str:
    """Hash of plain values and files' contents (Path), stable between runs."""
    h = hashlib.sha256()
    for part in parts:
        data = part.read_bytes() if isinstance(part, Path) else repr(part).encode()
        h.update(len(data).to_bytes(8, "little") + data)
    return h.hexdigest()[:16]
