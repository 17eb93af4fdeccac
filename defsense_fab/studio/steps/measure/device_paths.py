"""Paths in a device's folder that tasks write to; the folder may come from anybody."""

from __future__ import annotations

from pathlib import Path

from ....core.errors import CaptureError, DefsenseError
from ....core.storage.file_names import name_problem
from ....core.storage.session_manifest import manifest_path


def inside(folder: Path, name: str, error: type[DefsenseError]) -> Path:
    """Return the path of a name in a device's folder, with links resolved.

    Raises:
        DefsenseError: Of the class `error`: the path is outside of the folder.
    """
    folder = folder.resolve()
    try:
        path = (folder / name).resolve()
    except (OSError, ValueError):  # such as a null character, or a loop of links
        path = folder.parent
    if not path.is_relative_to(folder):
        raise error(
            "is outside of the device's folder",
            code="outside-device-folder",
            where=name,
            action="Copy it to the device's folder",
        )
    return path


def recording_folder(folder: Path, name: str) -> Path:
    """Return the folder of a new session, or of one that is resumed.

    Raises:
        CaptureError: The name is not that of a folder, or the folder has other content.
    """
    is_folder_name = not name.startswith(".") and name != "" and Path(name).name == name
    problem = name_problem(name) if is_folder_name else "it is not the name of a folder"
    if problem:
        raise CaptureError(
            problem,
            code="invalid-session-name",
            where="session",
            action="Enter the name of a folder in the device's folder",
        )
    path = inside(folder, name, CaptureError)
    is_free = not path.exists() or (path.is_dir() and not any(path.iterdir()))
    if not is_free and manifest_path(path) is None:
        raise CaptureError(
            "exists already, and is not a session",
            code="file-exists",
            where=name,
            action="Enter another name",
        )
    return path
