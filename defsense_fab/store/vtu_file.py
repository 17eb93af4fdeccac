"""Reading VTU files of a build."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from meshio import vtu

from ..core.device.build_folder import BUILD_AGAIN
from ..core.errors import StorageError


def read_vtu(path: Path) -> Any:
    """Return the meshio.Mesh in a file.

    `meshio.read` is not used, as it ends the process on damaged files.

    Raises:
        StorageError: The file is missing or damaged.
    """
    try:
        return vtu.read(str(path))
    except OSError as error:
        raise StorageError(
            f"cannot be read: {error.strerror or error}",
            code="file-unreadable",
            where=path,
            action=BUILD_AGAIN,
        ) from None
    except Exception as error:  # meshio's parsers raise errors of many classes
        reason = " ".join(str(error).split()) or "truncated"
        raise StorageError(
            f"is damaged ({reason})", code="file-damaged", where=path, action=BUILD_AGAIN
        ) from None
