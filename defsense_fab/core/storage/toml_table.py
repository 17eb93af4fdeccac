"""Strict reading of TOML tables: every key is checked, and errors name file, line and key."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, overload

import numpy as np

from ..arrays import Float
from ..errors import DeviceError


def load_toml(path: Path) -> Table:
    """Parse `path`. Raises DeviceError where it is missing or not TOML."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise DeviceError(f"{path}: no such file; give a folder that holds a device.toml") from None
    except NotADirectoryError:
        raise DeviceError(
            f"{path.parent}: is a file; give the folder that holds a device.toml"
        ) from None
    except UnicodeDecodeError as error:
        raise DeviceError(f"{path}: not valid TOML: {error}") from None
    except OSError as error:
        raise DeviceError(f"{path}: cannot be read: {error.strerror}") from None
    return parse_toml(text, path)


def parse_toml(text: str, path: Path) -> Table:
    """The same of the text that `path` has, or would have. Raises DeviceError for what is no
    TOML."""
    try:
        return Table(tomllib.loads(text), path, text)
    except tomllib.TOMLDecodeError as error:
        raise DeviceError(f"{path}: not valid TOML: {error}") from None


@dataclass(frozen=True)
class Reading:
    """How a key was read: the kinds of its value, whether it must be there, its default, what it
    must be greater than, the least and the greatest that it may be, and the texts that are allowed.
    The reference of the files' keys is made of these."""

    kinds: tuple[str, ...] = ()
    required: bool = False
    default: Any = None
    above: float = -np.inf
    within: tuple[float, float] = (-np.inf, np.inf)
    options: tuple[str, ...] = ()


Asked = dict[tuple[Any, ...], dict[str, Reading]]


class Table:
    """One TOML table: reads keys by type, and refuses those that nobody asked for."""

    def __init__(
        self,
        data: dict[str, Any],
        file: Path,
        text: str,
        path: tuple[Any, ...] = (),
        asked: Asked | None = None,
    ) -> None:
        self.data, self._file, self._text, self._path = data, file, text, path
        self._asked: Asked = {} if asked is None else asked
        self._known = self._asked.setdefault(path, {})

    @property
    def asked(self) -> Asked:
        """Which keys were asked for so far, and how, of this table and all that were read from the
        same file, by the tables' paths: names of keys, and numbers from 0 in lists."""
        return self._asked

    def fail(self, key: str | None, problem: str) -> NoReturn:
        """Raise DeviceError for `key` of this table."""
        parts = (*self._path, *([key] if key else []))
        dotted = ".".join(str(p + 1) if isinstance(p, int) else p for p in parts)
        line = _line_of(self._text, parts)
        where = f"{self._file.name}:{line}" if line else self._file.name
        raise DeviceError(f"{where}: {dotted or 'file'}: {problem}")

    def _note(self, key: str, **how: Any) -> Reading:
        reading = self._known[key] = replace(self._known.get(key, Reading()), **how)
        return reading

    def _get(self, key: str, default: Any, kind: str) -> Any:
        known = key in self._known  # asked for before: it may be left out
        reading = self._note(key)
        if kind not in reading.kinds:
            self._note(key, kinds=(*reading.kinds, kind))
        if default is _REQUIRED:
            self._note(key, required=reading.required or not known)
        elif default is not None:
            self._note(key, default=default)
        if key in self.data:
            return self.data[key]
        if default is _REQUIRED:
            near = difflib.get_close_matches(key, [k for k in self.data if k not in self._known], 1)
            if near:
                self.fail(near[0], f"unknown key; did you mean {key!r}?")
            self.fail(key, "is missing; add it")
        return default

    def has(self, key: str) -> bool:
        self._note(key)
        return key in self.data

    def string(self, key: str, default: Any = None) -> str:
        value = self._get(key, _REQUIRED if default is None else default, "text")
        if not isinstance(value, str) or not value:
            self.fail(key, f"must be a text in quotes, not {value!r}")
        return value

    def number(self, key: str, default: Any = None, low: float = -np.inf) -> float:
        """A finite number above `low`."""
        value = self._get(key, _REQUIRED if default is None else default, "number")
        self._note(key, above=low)
        if not is_number(value):
            self.fail(key, f"must be a number, not {_short(value)}")
        if value <= low:
            self.fail(key, f"must be greater than {low:g}, not {value:g}")
        return float(value)

    def size(self, key: str, default: Any = None) -> float:
        """A finite number that is not negative."""
        value = self.number(key, default)
        self._note(key, within=(0.0, np.inf))
        if value < 0:
            self.fail(key, f"must not be negative, and is {value:g}")
        return value

    @overload
    def count(self, key: str) -> int | None: ...

    @overload
    def count(self, key: str, default: int) -> int: ...

    def count(self, key: str, default: int | None = None) -> int | None:
        """A whole number of at least 1, or the default where there is none."""
        value = self._get(key, default, "whole number")
        self._note(key, within=(1.0, np.inf))
        if key not in self.data:
            return default
        if not is_number(value):
            self.fail(key, f"must be a number, not {_short(value)}")
        if value < 1 or value != int(value):
            self.fail(key, f"must be a whole number of at least 1, not {value:g}")
        return int(value)

    def within(self, key: str, values: float | Float, low: float, high: float, else_: str) -> None:
        """Fail with `else_` unless all values, read from `key`, are from `low` to `high`."""
        self._note(key, within=(low, high))
        if not ((low <= np.asarray(values)) & (np.asarray(values) <= high)).all():
            self.fail(key, else_)

    def boolean(self, key: str, default: bool | None = None) -> bool:
        value = self._get(key, _REQUIRED if default is None else default, "true or false")
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, not {_short(value)}")
        return value

    def vector(self, key: str, size: int = 3, default: Sequence[float] | None = None) -> Float:
        return self.array(key, (size,), default)

    def array(
        self, key: str, shape: tuple[int | None, ...], default: Sequence[float] | None = None
    ) -> Float:
        """Numbers of the given shape; None is any length."""
        want = " x ".join("any" if n is None else str(n) for n in shape)
        value = self._get(key, _REQUIRED if default is None else list(default), f"{want} numbers")
        try:
            if not _numeric(value):
                raise ValueError
            out = np.asarray(value, dtype=float)
        except ValueError:  # also raised for rows of different lengths
            self.fail(key, f"must be {want} finite numbers, not {_short(value)}")
        if out.ndim != len(shape) or any(
            n is not None and n != m for n, m in zip(shape, out.shape, strict=True)
        ):
            self.fail(key, f"must be {want} numbers, not of shape {list(out.shape)}")
        return out

    def strings(self, key: str, default: Sequence[str] | None = None) -> list[str]:
        value = self._get(key, _REQUIRED if default is None else list(default), "texts")
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            self.fail(key, f"must be a list of texts, not {value!r}")
        return value

    def raw(self, key: str, default: Any = None) -> Any:
        return self._get(key, default, "any")

    def table(self, key: str, required: bool = True) -> Table:
        value = self._get(key, _REQUIRED if required else {}, "table")
        if not isinstance(value, dict):
            self.fail(key, f"must be a table, not {value!r}")
        return Table(value, self._file, self._text, (*self._path, key), self._asked)

    def tables(self, key: str) -> list[Table]:
        value = self._get(key, [], "tables")
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            self.fail(key, "must be a list of tables")
        return [
            Table(v, self._file, self._text, (*self._path, key, i), self._asked)
            for i, v in enumerate(value)
        ]

    def choice(self, key: str, name: str, options: Sequence[str], what: str) -> None:
        """Fail unless `name` is one of `options`, with the nearest ones."""
        self._note(key, options=tuple(options))
        if name not in options:
            near = difflib.get_close_matches(name, options, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            listed = ", ".join(options) or "none"
            self.fail(key, f"unknown {what} {name!r}; {hint}there is: {listed}")

    def done(self) -> None:
        """Fail on the first key that was never asked for."""
        for key in self.data:
            if key not in self._known:
                near = difflib.get_close_matches(key, sorted(self._known), n=1)
                hint = f"did you mean {near[0]!r}?" if near else "remove it"
                self.fail(key, f"unknown key; {hint} (known: {', '.join(sorted(self._known))})")


_REQUIRED = object()


def is_number(value: Any) -> bool:
    """A finite number that a float can hold; neither true nor a text."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300  # false for NaN too


def _numeric(value: Any) -> bool:
    return all(_numeric(v) for v in value) if isinstance(value, list) else is_number(value)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 100 else f"{text[:97]}..."


def _line_of(text: str, path: tuple[Any, ...]) -> int | None:
    """Line of the last part of `path` that stands in the text: tomllib keeps no positions."""
    names = [p for p in path if isinstance(p, str)]
    indices = [p for p in path if isinstance(p, int)]
    lines = text.splitlines()
    start, end, found = 0, len(lines), None
    header = re.compile(r"^\s*\[+\s*([\w.\-\"]+)\s*\]+")
    for depth in range(len(names), 0, -1):
        dotted = ".".join(names[:depth])
        hits = [
            i
            for i, line in enumerate(lines)
            if (m := header.match(line)) and m[1].replace('"', "") == dotted
        ]
        if hits:
            start = hits[min(indices[0] if indices and depth == 1 else 0, len(hits) - 1)]
            if depth > 1 and indices:  # a list inside a list: count from its parent's header
                parents = [
                    i
                    for i, line in enumerate(lines)
                    if (m := header.match(line)) and m[1] == names[0]
                ]
                if parents:
                    floor = parents[min(indices[0], len(parents) - 1)]
                    inside = [h for h in hits if h > floor] or hits
                    start = inside[min(indices[1] if len(indices) > 1 else 0, len(inside) - 1)]
            found = start + 1
            later = [i for i, line in enumerate(lines) if i > start and header.match(line)]
            end = later[0] if later else len(lines)
            names = names[depth:]
            break
    for name in names:
        pattern = re.compile(rf"(^|[\s{{,.])\"?{re.escape(name)}\"?\s*[=.]")
        for i in range(start, end):
            if pattern.search(lines[i]):
                found = i + 1
                break
    return found
