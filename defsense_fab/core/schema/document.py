"""TOML files as typed tables: every key is checked, and problems are reported with their lines."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from ..errors import DefsenseError, DeviceError
from ..storage.files import read_regular
from .declare import Problem
from .key_lines import KeyPath, key_lines
from .reader import Reader

T = TypeVar("T")


@dataclass(frozen=True)
class Document:
    """The values of a TOML file, or values to be read as if they were in one.

    Attributes:
        values: What the file holds.
        file: Its path, whose name starts error messages.
        text: Its text, in which the lines of keys are found; empty if there is none.
        error: Class of the errors that are raised for it.
    """

    values: Mapping[str, Any]
    file: Path
    text: str = ""
    error: type[DefsenseError] = DeviceError

    @cached_property
    def _lines(self) -> Mapping[KeyPath, int]:
        return key_lines(self.text)

    def read(self, kind: type[T]) -> T:
        """Return the file's values as the declared table `kind`.

        Raises:
            DefsenseError: of the class `self.error`, for everything that is wrong in the file.
        """
        table, problems = self.try_reading(kind, self.values)
        if table is None:
            self.refuse(problems)
        return table

    def try_reading(
        self, kind: type[T], values: object, at: KeyPath = ()
    ) -> tuple[T | None, list[Problem]]:
        """Read `values`, which stand at the path `at` of the file.

        Returns:
            The table, or None if there are problems, and the problems.
        """
        reader = Reader()
        table = reader.read_table(kind, values, at)
        return (None if reader.problems else table), reader.problems

    def line(self, path: KeyPath) -> int | None:
        """Return the line of a key, or of the innermost table that exists around it."""
        for end in range(len(path), 0, -1):
            if path[:end] in self._lines:
                return self._lines[path[:end]]
        return None

    def refuse(self, problems: Iterable[Problem]) -> NoReturn:
        """Raise one error for all `problems`, in the order of the file.

        Its code and data are those of the first problem; `data["errors"]` holds an error for each.
        """
        ordered = sorted(problems, key=lambda p: self.line(p.path) or 0)
        errors = tuple(map(self._error, ordered))
        first = errors[0]
        if len(errors) == 1:
            first.data["errors"] = (self._error(ordered[0]),)
            raise first
        together = self.error("\n".join(map(str, errors)), code=first.code)
        together.data = {**first.data, "errors": errors}
        raise together

    def _error(self, problem: Problem) -> DefsenseError:
        dotted = dotted_key(problem.path)
        line = self.line(problem.path)
        place = f"{self.file.name}:{line}" if line else self.file.name
        return self.error(
            problem.text,
            code=problem.code,
            where=f"{place}: {dotted}" if dotted else place,
            action=problem.action,
            **problem.data,
            key=dotted,
            line=line,
            file=str(self.file),
        )


def errors_in(error: DefsenseError) -> tuple[DefsenseError, ...]:
    """Return an error for each problem of a file, of an error that a document raised."""
    errors = error.data.get("errors")
    return errors if isinstance(errors, tuple) else (error,)


def dotted_key(path: KeyPath) -> str:
    """Return a path as people write it: names joined by dots, items of lists counted from 1."""
    return ".".join(str(part + 1) if isinstance(part, int) else part for part in path)


def load_document(path: Path, error: type[DefsenseError] = DeviceError) -> Document:
    """Read the TOML file at `path`.

    Raises:
        DefsenseError: of the class `error`, if the file is missing, unreadable or not TOML.
    """
    try:
        text = read_regular(path).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError:
        raise error(
            "no such file",
            code="file-not-found",
            where=path,
            action=f"Give a folder that holds a {path.name}",
        ) from None
    except NotADirectoryError:
        raise error(
            "is a file",
            code="not-a-folder",
            where=path.parent,
            action=f"Give the folder that holds a {path.name}",
        ) from None
    except UnicodeDecodeError as problem:
        raise error(f"not valid TOML: {problem}", code="toml-invalid", where=path) from None
    except OSError as problem:
        raise error(
            f"cannot be read: {problem.strerror}", code="file-unreadable", where=path
        ) from None
    return parse_document(text, path, error)


def parse_document(text: str, path: Path, error: type[DefsenseError] = DeviceError) -> Document:
    """Parse the text that the file at `path` has, or would have.

    Raises:
        DefsenseError: of the class `error`, if the text is not TOML.
    """
    try:
        return Document(tomllib.loads(text), path, text, error)
    except ValueError as problem:  # also raised for numbers of thousands of digits
        raise error(f"not valid TOML: {problem}", code="toml-invalid", where=path) from None
