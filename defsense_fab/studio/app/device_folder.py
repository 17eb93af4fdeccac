"""The folder that the studio is opened with."""

from __future__ import annotations

from pathlib import Path

from ...core.errors import StorageError


def check_folder(folder: Path) -> None:
    """Check that a path can be the folder of a device, which need not exist.

    Args:
        folder: The path.

    Raises:
        StorageError: The path is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise StorageError(
            "is not a folder",
            code="not-a-folder",
            where=folder,
            action="Give the folder of the device",
        )
