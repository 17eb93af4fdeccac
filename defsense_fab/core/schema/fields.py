"""The keys of a declared file as flat records, for pages, comments, forms and suggestions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec
from msgspec import inspect

from ..storage.package_data import read_rows
from .types import (
    NumberType,
    choices_of,
    in_words,
    item_types,
    members,
    number_shape,
    number_type,
    split_metadata,
    struct_type,
)


@dataclass(frozen=True)
class Field:
    """One key of a declared table.

    Attributes:
        name: The key.
        kind: Its declared type.
        description: One sentence, in Markdown.
        unit: Unit of its numbers, or empty.
        is_required: Whether a file must have it.
        default: Value without the key; None if it depends on other values, or if there is none.
        default_words: The default in words, where it is not `default`.
        choices: Texts that are accepted; empty if any is.
    """

    name: str
    kind: inspect.Type
    description: str
    unit: str
    is_required: bool
    default: Any
    default_words: str
    choices: tuple[str, ...]

    @property
    def label(self) -> str:
        """Noun phrase for a form, with the unit, such as `Edge length, mm`."""
        words = self.name.replace("_", " ")
        unit = f", {self.unit}" if self.unit else ""
        return f"{words[0].upper()}{words[1:]}{unit}"

    @property
    def numbers(self) -> NumberType | None:
        """Type of its numbers, which has their bounds; None if there are none, or of two kinds."""
        numeric = [t for t in members(self.kind) if number_shape(t) is not None]
        return number_type(numeric[0]) if len(numeric) == 1 else None

    @property
    def bounds(self) -> tuple[float | None, float | None]:
        """Smallest and largest number, None where there is no limit."""
        n = self.numbers
        if n is None:
            return None, None
        return (n.ge if n.gt is None else n.gt), (n.le if n.lt is None else n.lt)

    @property
    def catalogue_default(self) -> tuple[float, float] | None:
        """Smallest and largest default, where rows of a table in `data/` hold it."""
        _, words = split_metadata(self.kind)
        if "rows" not in words:
            return None
        cells = (row[self.name] for row in read_rows(words["rows"]).values())
        numbers = [float(cell) for cell in cells if cell]
        return min(numbers), max(numbers)

    @property
    def tables(self) -> tuple[tuple[str, ...], ...]:
        """Paths, from the key, of the tables that its value is or holds."""
        inner = [_inner_table(option) for option in members(self.kind)]
        return tuple(dict.fromkeys(names for names, table in inner if table is not None))

    @property
    def is_open(self) -> bool:
        """Whether its value is a list of tables, or a table of names that the user chooses."""
        return any(
            isinstance(option, inspect.DictType) or (item_types(option) and self.tables)
            for option in members(self.kind)
        )

    @property
    def type_words(self) -> str:
        """What its value is, such as `number` or `list of texts`."""
        return in_words(self.kind).removeprefix("a ")


@dataclass(frozen=True)
class Section:
    """One table of a file.

    Attributes:
        path: Names of its keys from the top; NAME stands for a name that the user chooses.
        is_list: Whether the file may have several, as in `[[poses]]`.
        fields: Its keys, in the declared order.
    """

    path: tuple[str, ...]
    is_list: bool
    fields: tuple[Field, ...]

    @property
    def header(self) -> str:
        """The table's header in TOML; empty for the top of the file."""
        dotted = ".".join(self.path)
        if not dotted:
            return ""
        return f"[[{dotted}]]" if self.is_list else f"[{dotted}]"


@cache
def table_fields(kind: type) -> tuple[Field, ...]:
    """Return the keys of one declared table, in the declared order."""
    return tuple(map(_field, struct_type(kind).fields))


def sections(kind: type, path: tuple[str, ...] = (), is_list: bool = False) -> Iterator[Section]:
    """Yield the table `kind` and all tables in it, in the declared order."""
    yield Section(path, is_list, table_fields(kind))
    for declared in struct_type(kind).fields:
        visited = []
        for option in members(declared.type):
            names, inner = _inner_table(option)
            if inner is not None and inner.cls not in visited:
                visited.append(inner.cls)
                in_list = item_types(option) is not None
                yield from sections(inner.cls, (*path, declared.encode_name, *names), in_list)


def declared_tables(kind: type) -> tuple[type, ...]:
    """Return the table `kind` and all tables in it, each once."""
    found = [kind]
    for declared in struct_type(kind).fields:
        for option in members(declared.type):
            _, inner = _inner_table(option)
            if inner is not None:
                found += declared_tables(inner.cls)
    return tuple(dict.fromkeys(found))


def field(kind: type, dotted: str) -> Field:
    """Return a key of a declared file by its dotted name, such as `mesh.edge_length`.

    Raises:
        KeyError: if there is no such key.
    """
    *path, name = dotted.split(".")
    for section in sections(kind):
        if list(section.path) == path:
            for found in section.fields:
                if found.name == name:
                    return found
    raise KeyError(dotted)


def _inner_table(kind: inspect.Type) -> tuple[tuple[str, ...], inspect.StructType | None]:
    """Return the table that a value of a type is or holds, and NAME if the user names it."""
    if isinstance(kind, inspect.DictType):
        inner = members(kind.value_type)[0]
        return ("NAME",), inner if isinstance(inner, inspect.StructType) else None
    items = item_types(kind)
    inner = members(items[0][0])[0] if items else kind
    return (), inner if isinstance(inner, inspect.StructType) else None


def _field(declared: inspect.Field) -> Field:
    _, words = split_metadata(declared.type)
    default = None
    if declared.default is not msgspec.NODEFAULT:
        default = declared.default
    elif declared.default_factory is not msgspec.NODEFAULT:
        default = declared.default_factory()
    return Field(
        declared.encode_name,
        declared.type,
        words.get("description", ""),
        words.get("unit", ""),
        declared.required,
        default,
        words.get("default", ""),
        choices_of(declared.type),
    )
