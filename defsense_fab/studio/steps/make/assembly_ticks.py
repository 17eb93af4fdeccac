"""Which steps of the assembly are done, kept in the device's folder."""

from __future__ import annotations

import json
from pathlib import Path

from ....core.errors import StorageError
from ....core.storage.files import read_regular, storage_errors, write_text
from ...project.history import FOLDER

FILE = "assembly.json"
_SCHEMA = 1
_MAX_TICKS = 1000


class AssemblyTicks:
    """The steps that are done, in `.studio/assembly.json`.

    A step is known by its content, so that a step that another build changes is not done.

    Args:
        folder: The device's folder.

    Attributes:
        done: Identifiers of the steps that are done.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / FOLDER / FILE
        self.done = _read(self._path)

    def tick(self, stage: str, *, is_done: bool) -> None:
        """Mark a step as done or not, and write the file.

        Raises:
            StorageError: The file cannot be written, or its path is a symbolic link.
        """
        for path in (self._path.parent, self._path):
            if path.is_symlink():  # a folder from elsewhere could link to any file
                raise StorageError(
                    "is a symbolic link, which is not written to",
                    code="path-is-link",
                    where=path,
                    action="Remove it",
                )
        others = [other for other in self.done if other != stage]
        done = [*others, stage][-_MAX_TICKS:] if is_done else others
        with storage_errors(self._path):
            self._path.parent.mkdir(exist_ok=True)
        write_text(self._path, json.dumps({"schema": _SCHEMA, "done": done}) + "\n")
        self.done = done


def _read(path: Path) -> list[str]:
    """Return the identifiers of a file; none if it is missing or damaged."""
    try:
        content = json.loads(read_regular(path))
    except (OSError, ValueError):
        return []
    done = content.get("done") if isinstance(content, dict) else None
    return [x for x in done if isinstance(x, str)][-_MAX_TICKS:] if isinstance(done, list) else []
