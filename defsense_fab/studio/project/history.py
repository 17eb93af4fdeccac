"""The undo history of a device's file, which outlives the program."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.errors import StorageError
from ...core.storage.files import read_regular, storage_errors, write_text

FOLDER, FILE = ".studio", "history.jsonl"
MAX_STEPS = 400
#: Largest number of characters of the texts of all steps; the last two steps are always kept.
MAX_CHARACTERS = 32_000_000
_SCHEMA, _MIN_STEPS = 1, 2


@dataclass(frozen=True)
class Step:
    """One step of the history.

    Attributes:
        name: Name of the edit.
        text: Text of the file after the edit.
    """

    name: str
    text: str


class History:
    """Steps of one device's file; the steps up to the index `at` are applied.

    Each change is written to `.studio/history.jsonl` in the device's folder before the next one,
    so that a program that is killed loses no step. Truncated lines are skipped.

    Args:
        folder: The device's folder.
        text: Current text of the file. If it differs from the last step, it becomes a step.

    Attributes:
        steps: All steps, with those that were undone.
        at: Index of the last applied step.

    Raises:
        StorageError: The history cannot be written, or its path is a symbolic link.
    """

    def __init__(self, folder: Path, text: str) -> None:
        self._path = folder / FOLDER / FILE
        for path in (self._path.parent, self._path):
            if path.is_symlink():  # a folder from elsewhere could link to any file
                raise StorageError(
                    "is a symbolic link, which is not written to",
                    code="path-is-link",
                    where=path,
                    action="Remove it",
                )
        self.steps, self.at, is_intact = _read(self._path)
        if not self.steps:
            self.steps, self.at = [Step("open", text)], 0
            self._rewrite()
        elif not is_intact:  # the next line would be appended to a truncated one
            self._rewrite()
        if self.text != text:
            self.add("edit outside of the studio", text)

    @property
    def text(self) -> str:
        """Text of the file after the last applied step."""
        return self.steps[self.at].text

    @property
    def undo_name(self) -> str | None:
        """Name of the step that `move(-1)` undoes, or None."""
        return self.steps[self.at].name if self.at else None

    @property
    def redo_name(self) -> str | None:
        """Name of the step that `move(1)` redoes, or None."""
        return self.steps[self.at + 1].name if self.at + 1 < len(self.steps) else None

    def add(self, name: str, text: str) -> None:
        """Add a step, and drop the steps that were undone.

        Raises:
            StorageError: The history cannot be written.
        """
        has_dropped = len(self.steps) > self.at + 1
        before = len(self.steps[: self.at + 1])
        self.steps = _newest([*self.steps[: self.at + 1], Step(name, text)])
        is_full = len(self.steps) == MAX_STEPS or len(self.steps) <= before
        self.at = len(self.steps) - 1
        if has_dropped or is_full:
            self._rewrite()
        else:
            self._append({"name": name, "text": text})

    def move(self, by: int) -> str:
        """Undo a step (`by=-1`) or redo one (`by=1`), and return the text.

        Raises:
            StorageError: The history cannot be written.
            IndexError: There is no such step.
        """
        at = self.at + by
        if not 0 <= at < len(self.steps):
            raise IndexError(by)
        self.at = at
        self._append({"at": at})
        return self.text

    def _append(self, row: dict[str, Any]) -> None:
        with storage_errors(self._path):
            self._path.parent.mkdir(exist_ok=True)
            with self._path.open("a", encoding="utf-8", newline="\n") as file:
                file.write(json.dumps(row) + "\n")

    def _rewrite(self) -> None:
        rows: list[dict[str, Any]] = [{"schema": _SCHEMA}]
        rows += [{"name": step.name, "text": step.text} for step in self.steps]
        rows += [{"at": self.at}]
        with storage_errors(self._path):
            self._path.parent.mkdir(exist_ok=True)
        write_text(self._path, "".join(json.dumps(row) + "\n" for row in rows))


def _newest(steps: list[Step]) -> list[Step]:
    """Return the newest steps that are kept."""
    count, characters = 0, 0
    for step in reversed(steps[-MAX_STEPS:]):
        characters += len(step.text)
        if characters > MAX_CHARACTERS and count >= _MIN_STEPS:
            break
        count += 1
    return steps[-count:]


def last_valid_text(folder: Path) -> str | None:
    """Return the text after the last applied step of a device's history; None without one."""
    path = folder / FOLDER / FILE
    if path.is_symlink() or path.parent.is_symlink():
        return None
    steps, at, _ = _read(path)
    return steps[at].text if steps else None


def _read(path: Path) -> tuple[list[Step], int, bool]:
    """Read a history.

    Returns:
        The steps, the index of the last applied one, and whether all lines are intact; no steps
        if the file is missing or holds none.
    """
    try:
        lines = read_regular(path).decode("utf-8").split("\n")
    except (OSError, UnicodeDecodeError):
        return [], 0, False
    steps, at, is_intact = list[Step](), 0, lines[-1] == ""
    for line in lines[: len(lines) - is_intact]:
        try:
            row = json.loads(line)
        except ValueError:  # the program was killed while it wrote
            is_intact = False
            continue
        match row:
            case {"name": str(name), "text": str(text)}:
                steps = [*steps[: at + 1], Step(name, text)]
                at = len(steps) - 1
            case {"at": int(index)} if 0 <= index < len(steps):
                at = index
    return steps, at, is_intact
