"""Reading VTU files of a build."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from meshio import vtu

from ..core.device.build_folder import BUILD_AGAIN
from ..core.errors import StorageError


def read_vtu(path: Path) -> Any:
    """The meshio.Mesh in a file. Raises StorageError where it is missing or damaged; meshio's own
    `read` ends the program."""
    try:
        return vtu.read(str(path))
    except OSError as error:
        raise StorageError(
            f"{path}: cannot be read: {error.strerror or error}; {BUILD_AGAIN}"
        ) from None
    except Exception as error:  # its parsers raise whatever they do
        told = " ".join(str(error).split())
        raise StorageError(f"{path}: is damaged ({told or 'cut off'}); {BUILD_AGAIN}") from None
