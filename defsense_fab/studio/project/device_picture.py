"""A small picture of a device in its folder, for lists of devices."""

from __future__ import annotations

import base64
import binascii
from pathlib import Path

from ...core.errors import StorageError
from ...core.storage.files import read_regular, replace_file, storage_errors
from .history import FOLDER

_FILE = "picture"
MAX_PICTURE_BYTES = 80_000
_WEBP_MARK_AT = 8  # after "RIFF" and the size of the file


def store_picture(folder: Path, data_url: str) -> None:
    """Store a picture.

    Args:
        folder: The device's folder.
        data_url: A PNG, JPEG or WebP image as a data URL.

    Raises:
        StorageError: It is not such an image (`picture-invalid`), or cannot be written.
    """
    path = folder / FOLDER / _FILE
    header, _, encoded = data_url.partition(",")
    try:
        content = base64.b64decode(encoded, validate=True)
    except (binascii.Error, ValueError):
        content = b""
    is_small = len(content) <= MAX_PICTURE_BYTES
    if not (header.startswith("data:image/") and _media_type(content) and is_small):
        raise StorageError(
            f"needs a PNG, JPEG or WebP image of at most {MAX_PICTURE_BYTES // 1000} kB",
            code="picture-invalid",
            where="the picture of the device",
        )
    if path.parent.is_symlink() or path.is_symlink():  # as in the history
        raise StorageError(
            "is a symbolic link, which is not written to", code="path-is-link", where=path
        )
    with storage_errors(path):
        path.parent.mkdir(exist_ok=True)
    with replace_file(path) as temporary:
        temporary.write_bytes(content)


def read_picture(folder: Path) -> str:
    """Return the picture of the device in a folder as a data URL; empty if there is none."""
    path = folder / FOLDER / _FILE
    try:
        if path.is_symlink() or path.parent.is_symlink():
            return ""
        content = read_regular(path)
    except OSError:
        return ""
    return picture_url(content) if len(content) <= MAX_PICTURE_BYTES else ""


def picture_url(content: bytes) -> str:
    """Return a data URL of an image; empty if it is neither PNG, JPEG nor WebP."""
    kind = _media_type(content)
    return f"data:{kind};base64,{base64.b64encode(content).decode()}" if kind else ""


def _media_type(content: bytes) -> str:
    if content.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    if content.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    is_webp = content.startswith(b"RIFF") and content[_WEBP_MARK_AT:].startswith(b"WEBP")
    return "image/webp" if is_webp else ""
