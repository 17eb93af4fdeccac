"""What was done to a device's file, to be undone and done again; it outlives the program."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.errors import StorageError
from ...core.storage.files import storage_errors, write_text

FOLDER, FILE = ".studio", "history.jsonl"
_MOST = 400  # steps that are kept
_SCHEMA = 1


@dataclass(frozen=True)
class Step:
    """What an edit was called, and the file's text after it."""

    name: str
    text: str


class History:
    """Steps of one device's file: those up to `at` are done. Each change is written to
    `.studio/history.jsonl` of the device's folder before the next, so that a program that is killed
    loses none; a line that was cut off is left out."""

    def __init__(self, folder: Path, text: str) -> None:
        """Goes on where the last program ended, unless `text`, what the file has now, is another:
        that is a step of its own. Raises StorageError."""
        self._path = folder / FOLDER / FILE
        for path in (self._path.parent, self._path):
            if path.is_symlink():  # of a folder that came from elsewhere: it may lead anywhere
                raise StorageError(f"{path}: is a symbolic link, into which nothing is written;"
                                   " remove it")  # fmt: skip
        self.steps, self.at, whole = _read(self._path)
        if not self.steps:
            self.steps, self.at = [Step("open", text)], 0
            self._rewrite()
        elif not whole:  # what comes next would be written behind a line that was cut off
            self._rewrite()
        if self.text != text:
            self.add("edit outside of the studio", text)

    @property
    def text(self) -> str:
        return self.steps[self.at].text

    @property
    def undoes(self) -> str | None:
        """What would be undone, None at the beginning."""
        return self.steps[self.at].name if self.at else None

    @property
    def redoes(self) -> str | None:
        """What would be done again, None at the end."""
        return self.steps[self.at + 1].name if self.at + 1 < len(self.steps) else None

    def add(self, name: str, text: str) -> None:
        """A step; those that were undone are gone. Raises StorageError."""
        gone = len(self.steps) > self.at + 1
        self.steps = [*self.steps[: self.at + 1], Step(name, text)][-_MOST:]
        trimmed = len(self.steps) == _MOST
        self.at = len(self.steps) - 1
        if gone or trimmed:
            self._rewrite()
        else:
            self._append({"name": name, "text": text})

    def move(self, by: int) -> str:
        """Undo (-1) or do again (1): the text from then on. Raises StorageError, and IndexError at
        either end."""
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


def _read(path: Path) -> tuple[list[Step], int, bool]:
    """Steps, which was the last, and whether all lines are whole; no step where there is no
    history, or one that says nothing."""
    try:
        lines = path.read_text(encoding="utf-8").split("\n")
    except (OSError, UnicodeDecodeError):
        return [], 0, False
    steps, at, whole = list[Step](), 0, lines[-1] == ""
    for line in lines[: len(lines) - whole]:
        try:
            row = json.loads(line)
        except ValueError:  # of a program that was killed while it wrote
            whole = False
            continue
        match row:
            case {"name": str(name), "text": str(text)}:
                steps = [*steps[: at + 1], Step(name, text)]
                at = len(steps) - 1
            case {"at": int(place)} if 0 <= place < len(steps):
                at = place
    return steps, at, whole
