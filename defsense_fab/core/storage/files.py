"""Files that are written whole or not at all, locked against other programs, and hashed."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from platformdirs import user_config_path

from ..errors import DefsenseError, StorageError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

#: Error codes of the operating system's refusals.
_ERROR_CODES: dict[type[OSError], str] = {
    FileNotFoundError: "file-not-found",
    NotADirectoryError: "not-a-folder",
    IsADirectoryError: "not-a-file",
    FileExistsError: "file-exists",
    PermissionError: "permission-denied",
}
_MAX_READ_BYTES = 256 * 1024 * 1024
_RELEASE_TIMEOUT_S = 2.0  # within which a virus scanner on Windows closes a new file
#: Errors of file systems without locks, such as some network file systems.
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)
#: Byte that is locked on Windows. Other programs cannot access a locked byte, so it is one that
#: nobody reads or writes.
_LOCKED_BYTE = 2**30


@contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Convert the operating system's errors to StorageError.

    Args:
        path: File that is written, for errors that name none.

    Raises:
        StorageError: The system refused; the code tells the reason, such as `disk-full`.
    """
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise StorageError(
                "the disk is full",
                code="disk-full",
                where=path,
                action="Free some space and run again",
                path=path,
            ) from None
        refused = Path(error.filename or path)
        raise StorageError(
            str(error.strerror or error),
            code=_ERROR_CODES.get(type(error), "file-unusable"),
            where=refused,
            action="Check the path and its permissions",
            path=refused,
        ) from None


def read_regular(path: Path) -> bytes:
    """Return the content of a file of a folder that may come from anybody.

    Raises:
        OSError: The system refused, or the path is a folder, a pipe or a device, whose reader could
            wait forever, or the file is larger than 256 MB.
    """
    file = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(file, "rb") as opened:
        status = os.fstat(file)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "is not a file", str(path))
        if status.st_size > _MAX_READ_BYTES:
            raise OSError(errno.EFBIG, "is too large", str(path))
        return opened.read()


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """Write a file that replaces `path` at the end, or leaves it untouched after an error.

    Args:
        path: File to replace.

    Yields:
        A temporary path next to `path`, with the same suffix, that only this process uses.

    Raises:
        StorageError: The system refused.
    """
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
        with suppress(OSError):  # it does not exist where its folder could not be written
            temporary.unlink()


@contextmanager
def replace_folder(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Write a folder that takes the place of `path` at the end, or nothing after an error.

    Args:
        path: Folder to write. An empty folder there is replaced, and so is a link to one.
        overwrite: Whether a folder with content is replaced, too.

    Yields:
        An empty folder next to `path` that only this process uses.

    Raises:
        StorageError: `path` is a file, or a folder with content; or the system refused.
    """
    # "." has no name. A link is replaced itself, since its target may be anybody's folder.
    path = path.parent.resolve() / path.name if path.name not in ("", "..") else path.resolve()
    new = path.with_name(f".{path.name}.{os.getpid()}.part")
    old = path.with_name(f".{path.name}.{os.getpid()}.old")
    try:
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            new.mkdir()
            yield new
            if path.exists():
                if path.is_file() or (not overwrite and any(path.iterdir())):
                    raise StorageError(
                        "already exists",
                        code="file-exists",
                        where=path,
                        action="Choose another folder",
                        path=path,
                    )
                _move(path, old)
            _move(new, path)
    finally:
        if old.exists() and not path.exists():
            old.rename(path)
        for leftover in (new, old):
            if leftover.is_symlink():
                leftover.unlink()
            shutil.rmtree(leftover, ignore_errors=True)


def _move(source: Path, target: Path) -> None:
    """Move a file or folder; on Windows, wait until other programs have closed it."""
    end = time.monotonic() + (_RELEASE_TIMEOUT_S if sys.platform == "win32" else 0.0)
    while True:
        try:
            source.replace(target)
            return
        except PermissionError:
            if time.monotonic() >= end:
                raise
        time.sleep(0.05)


def check_folder(path: Path) -> None:
    """Check, before long work, that its results can be written to a folder.

    Args:
        path: Folder for the results, which need not exist.

    Raises:
        StorageError: The folder cannot be created, or does not accept files.
    """
    with storage_errors(path):
        absolute = path.absolute()
        existing = next((p for p in (absolute, *absolute.parents) if os.path.lexists(p)), None)
        if existing is None:  # a drive that does not exist
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        if not existing.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(existing))
        if not os.access(existing, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(existing))


def unused_path(path: Path) -> Path:
    """Return `path`, or the first of x-2.mid, x-3.mid, ... that does not exist."""
    number, candidate = 1, path
    while os.path.lexists(candidate):
        number += 1
        candidate = path.parent / f"{path.stem}-{number}{path.suffix}"
    return candidate


def write_json(path: Path, data: Any) -> None:
    """Write data as JSON, whole or not at all.

    Args:
        path: File to write.
        data: Plain values; NaN and infinity are not allowed.

    Raises:
        StorageError: The file cannot be written.
    """
    write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str, *, is_private: bool = False) -> None:
    """Write text in UTF-8 with unchanged line ends, whole or not at all.

    Args:
        path: File to write.
        text: Content.
        is_private: Whether only the user may read the file (mode 0600), never others.

    Raises:
        StorageError: The file cannot be written.
    """
    with replace_file(path) as temporary:
        if is_private:
            temporary.unlink(missing_ok=True)
            temporary.touch(mode=0o600)
        temporary.write_text(text, encoding="utf-8", newline="")


def load_json(path: Path, error: type[DefsenseError], action: str) -> Any:
    """Read a JSON file.

    Args:
        path: File to read.
        error: Class of the errors to raise.
        action: What the user can do about a file that is missing or damaged.

    Returns:
        The content.

    Raises:
        DefsenseError: Of the class `error`, where the file cannot be read or is not JSON.
    """
    try:
        return json.loads(read_regular(path).decode("utf-8"))
    except OSError as problem:
        raise error(
            f"cannot be read: {problem.strerror}",
            code=unreadable_code(problem),
            where=path,
            action=action,
            path=path,
        ) from None
    except ValueError as problem:
        raise error(
            f"is not valid JSON, or was cut off or edited ({problem})",
            code="not-json",
            where=path,
            action=action,
            path=path,
        ) from None


def unreadable_code(error: OSError) -> str:
    """Return the error code of a file that cannot be read."""
    return "file-not-found" if isinstance(error, FileNotFoundError) else "file-unreadable"


def config_folder() -> Path:
    """Return `DEFSENSE_CONFIG`, or the user's folder for settings, which need not exist."""
    chosen = os.environ.get("DEFSENSE_CONFIG")
    return Path(chosen) if chosen else user_config_path("defsense-fab")


#: Of the names of files that `digest` gives.
DIGEST_PATTERN = "[0-9a-f]" * 16


def digest(*parts: Any) -> str:
    """Return a hash of plain values and of files' contents, stable between runs.

    Args:
        *parts: Values with a stable `repr`; a Path stands for the content of its file.

    Returns:
        16 hexadecimal digits.
    """
    h = hashlib.sha256()
    for part in parts:
        data = part.read_bytes() if isinstance(part, Path) else repr(part).encode()
        h.update(len(data).to_bytes(8, "little") + data)
    return h.hexdigest()[:16]


def try_lock(file: int) -> bool:
    """Try to lock an open file until it is closed.

    Args:
        file: Descriptor of the file.

    Returns:
        False where another process or thread holds the lock. True where the file is locked, and
        where the file system has no locks.

    Raises:
        OSError: The system refused for another reason.
    """
    try:
        if sys.platform == "win32":
            before = os.lseek(file, 0, os.SEEK_CUR)
            os.lseek(file, _LOCKED_BYTE, os.SEEK_SET)
            try:
                msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
            except PermissionError:  # another holder
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
def file_lock(
    path: Path, problem: str, code: str = "file-in-use", where: object = "", action: str = ""
) -> Iterator[None]:
    """Hold the lock of a file, among processes and among threads.

    The file is created where there is none, and keeps its content. It is not removed at the end:
    otherwise a second holder could lock the removed file, and a third a new one. The system ends
    the lock with the process.

    Args:
        path: File to lock.
        problem: What is wrong where another holds the lock.
        code: Error code for that.
        where: The place that is named in the error.
        action: What the user can do about it.

    Raises:
        StorageError: Another process or thread holds the lock, or the system refused.
    """
    with storage_errors(path):
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        with storage_errors(path):
            if not try_lock(file):
                raise StorageError(problem, code=code, where=where, action=action, path=path)
        yield
    finally:
        os.close(file)
