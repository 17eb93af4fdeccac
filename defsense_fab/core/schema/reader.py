"""Read plain values into declared tables, collecting every problem with its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, TypeVar

import msgspec
import numpy as np
from msgspec import inspect

from ..errors import DefsenseError
from .declare import Problem, missing, unknown_choice
from .fields import Field
from .key_lines import KeyPath
from .types import (
    MAX_NUMBER,
    bounds_in_words,
    choices_of,
    exact,
    in_words,
    is_number,
    is_within,
    item_types,
    members,
    number_shape,
    number_type,
    shape_in_words,
    struct_type,
)

T = TypeVar("T")
_MAX_VALUE_LENGTH = 100  # characters of a value in a message


class Reader:
    """Reads the values of one file.

    Attributes:
        problems: All that was wrong so far. What a method returns is only valid if it added none.
    """

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def read_table(self, kind: type[T], values: object, at: KeyPath = ()) -> T | None:
        """Read the table `kind` that stands at the path `at`; None if there are problems."""
        declared: Any = kind
        described = struct_type(declared)
        table: T | None = self._struct(described, values, at, described)
        return table

    def _struct(
        self, kind: inspect.StructType, values: object, at: KeyPath, whole: inspect.Type
    ) -> Any:
        if isinstance(values, kind.cls):
            return values
        if not isinstance(values, Mapping):
            return self._refuse_type(at, whole, values)
        count = len(self.problems)
        fields = {field.encode_name: field for field in kind.fields}
        self._check_names(fields, values, at)
        arguments = {
            fields[name].name: self.read_value(fields[name].type, value, (*at, name))
            for name, value in values.items()
            if name in fields
        }
        if len(self.problems) > count:
            return None
        try:
            table = kind.cls(**arguments)
        except DefsenseError as error:
            facts = dict(error.data)
            name = facts.pop("key", None)
            path = (*at, str(name)) if name else at
            self.problems.append(Problem(path, error.problem, error.code, error.action, facts))
            return None
        found: Iterable[Problem] = table.check() if hasattr(table, "check") else ()
        self.problems += [problem.below(*at) for problem in found]
        return table

    def _check_names(
        self, fields: Mapping[str, inspect.Field], values: Mapping[str, Any], at: KeyPath
    ) -> None:
        """Report unknown keys, and required keys that are absent and not merely misspelt."""
        unknown = [name for name in values if name not in fields]
        suggestions: dict[str, str] = {}
        for name, field in fields.items():
            if field.required and name not in values:
                close = get_close_matches(name, [u for u in unknown if u not in suggestions], n=1)
                if close:
                    suggestions[close[0]] = name
                else:
                    self.problems.append(missing(name).below(*at))
        absent = sorted(name for name in fields if name not in values)
        for name in unknown:
            close = get_close_matches(name, absent, n=1)
            suggestion = suggestions.get(name, close[0] if close else None)
            action = (
                f"Did you mean {suggestion!r}?"
                if suggestion
                else f"Remove it; the keys here are {', '.join(sorted(fields))}"
            )
            data = {"suggestion": suggestion}
            self.problems.append(Problem((*at, name), "unknown key", "key-unknown", action, data))

    def read_value(self, kind: inspect.Type, value: Any, at: KeyPath) -> Any:
        """Read a value of any declared type."""
        count = len(self.problems)
        found = self._typed(kind, value, at)
        choices = choices_of(kind)
        if choices and len(self.problems) == count:
            texts = [found] if isinstance(found, str) else found
            wrong = next((text for text in texts if text not in choices), None)
            if wrong is not None:
                self.problems.append(unknown_choice(at, wrong, choices))
        return found

    def _typed(self, kind: inspect.Type, value: Any, at: KeyPath) -> Any:
        options = members(kind)
        if len(options) > 1:
            options = tuple(option for option in options if _fits(option, value))
        if not options:
            return self._refuse_type(at, kind, value)
        option = options[0]
        if isinstance(option, inspect.StructType):
            return self._struct(option, value, at, kind)
        if isinstance(option, inspect.DictType):
            if not isinstance(value, Mapping):
                return self._refuse_type(at, kind, value)
            return {k: self.read_value(option.value_type, v, (*at, k)) for k, v in value.items()}
        if isinstance(option, inspect.LiteralType):
            return self._literal(option, value, at, kind)
        shape = number_shape(option)
        if shape == ():
            return self._number(option, value, at, kind)
        if shape is not None:
            return self._numbers(option, value, at, kind)
        if item_types(option) is not None:
            return self._list(option, value, at, kind)
        if isinstance(option, inspect.BoolType) and not isinstance(value, bool):
            return self._refuse_type(at, kind, value)
        if isinstance(option, inspect.StrType) and not (isinstance(value, str) and value):
            return self._refuse_type(at, kind, value)
        return value

    def _literal(
        self, kind: inspect.LiteralType, value: Any, at: KeyPath, whole: inspect.Type
    ) -> Any:
        if any(type(value) is type(v) and value == v for v in kind.values):
            return value
        return self._refuse(
            at, f"must be {in_words(whole)}, not {_shown(value)}", "value-choice", value=value
        )

    def _list(self, kind: inspect.Type, value: Any, at: KeyPath, whole: inspect.Type) -> Any:
        """Read a list: tables by their own paths, other items by the path of the list."""
        types, length = item_types(kind) or ((), None)
        if not isinstance(value, list | tuple) or length not in (None, len(value)):
            return self._refuse_type(at, whole, value)
        has_tables = _is_table(members(types[0])[0])
        by_item = list(types) if length is not None else [types[0]] * len(value)
        if not all(
            any(_fits(option, item) for option in members(item_type))
            for item_type, item in zip(by_item, value, strict=True)
        ):
            return self._refuse_type(at, whole, value)
        if not self._is_long_enough(kind, value, at):
            return None
        items, count = [], len(self.problems)
        for position, (item_type, item) in enumerate(zip(by_item, value, strict=True)):
            if isinstance(item, str):  # which `_fits` has accepted
                items.append(item)
                continue
            items.append(self.read_value(item_type, item, (*at, position) if has_tables else at))
            if not has_tables and len(self.problems) > count:
                return None  # one problem is enough for a list of plain values
        return items if isinstance(kind, inspect.ListType) else tuple(items)

    def _numbers(self, kind: inspect.Type, value: Any, at: KeyPath, whole: inspect.Type) -> Any:
        """Read nested lists of numbers of the declared shape."""
        shape, of = number_shape(kind) or (), number_type(kind)
        if not isinstance(value, list | tuple) or not _every_number(value, _is_numeric):
            return self._refuse_type(at, whole, value)
        if not _every_number(value, is_number):
            return self._refuse(at, "each number must be finite", "not-finite")
        try:
            numbers = np.asarray(value, dtype=float)
        except ValueError:
            text = f"must be {shape_in_words(shape)}, not rows of different lengths"
            return self._refuse(at, text, "wrong-shape", expected=shape, shape=None)
        if not self._is_long_enough(kind, value, at):
            return None
        if len(numbers.shape) != len(shape) or any(
            n is not None and n != m for n, m in zip(shape, numbers.shape, strict=True)
        ):
            text = f"must be {shape_in_words(shape)}, not of shape {list(numbers.shape)}"
            return self._refuse(at, text, "wrong-shape", expected=shape, shape=numbers.shape)
        wrong = [float(x) for x in numbers.flat if not is_within(of, x)]
        if wrong:
            text = f"each number must be {bounds_in_words(of)}, not {exact(wrong[0])}"
            return self._refuse(at, text, "out-of-range", value=wrong[0])
        return _as_declared(kind, value)

    def _number(self, kind: inspect.Type, value: Any, at: KeyPath, whole: inspect.Type) -> Any:
        of = number_type(kind)
        is_whole = isinstance(of, inspect.IntType)
        if not _is_numeric(value):
            return self._refuse_type(at, whole, value)
        if not is_number(value):
            limits = f"between {-MAX_NUMBER:g} and {MAX_NUMBER:g}"
            limits = limits if abs(value) < math.inf else "finite"
            return self._refuse(at, f"must be {limits}, not {_shown(value)}", "not-finite")
        if is_whole and value != int(value):
            return self._refuse_type(at, whole, value)
        if not is_within(of, value):
            text = f"must be {bounds_in_words(of)}, not {exact(value)}"
            return self._refuse(at, text, "out-of-range", value=value)
        return int(value) if is_whole else float(value)

    def _is_long_enough(self, kind: inspect.Type, value: Sequence[Any], at: KeyPath) -> bool:
        least: int = getattr(kind, "min_length", None) or 0
        if len(value) < least:
            text = f"needs at least {least} item{'s' * (least > 1)}, not {len(value)}"
            self._refuse(at, text, "too-few-items", least=least, count=len(value))
        return len(value) >= least

    def _refuse_type(self, at: KeyPath, whole: inspect.Type, value: object) -> None:
        """Report a value that is not of the declared type, `whole` with its annotations."""
        text = f"must be {in_words(whole)}, not {_shown(value)}"
        self._refuse(at, text, "value-type", value=value)

    def _refuse(self, at: KeyPath, text: str, code: str, **data: object) -> None:
        self.problems.append(Problem(at, text, code, data=data))


def _is_table(kind: inspect.Type) -> bool:
    return isinstance(kind, inspect.StructType | inspect.DictType)


def _fits(kind: inspect.Type, value: object) -> bool:
    """Return whether a value has the Python type of a declared type, whatever its content."""
    if isinstance(kind, inspect.StructType):
        return isinstance(value, Mapping | kind.cls)
    if isinstance(kind, inspect.DictType):
        return isinstance(value, Mapping)
    if isinstance(kind, inspect.LiteralType):
        return any(type(value) is type(v) and value == v for v in kind.values)
    if isinstance(kind, inspect.BoolType):
        return isinstance(value, bool)
    if isinstance(kind, inspect.StrType):
        return isinstance(value, str)
    if number_shape(kind) == ():
        return _is_numeric(value)
    return isinstance(value, list | tuple) if item_types(kind) else True


def _is_numeric(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _every_number(value: object, condition: Callable[[object], bool]) -> bool:
    """Return whether all that nested lists hold fulfils a condition."""
    if isinstance(value, list | tuple):
        return all(_every_number(item, condition) for item in value)
    return condition(value)


def _as_declared(kind: inspect.Type, value: Any) -> Any:
    """Return nested lists of numbers as the declared lists and tuples of floats."""
    items = item_types(kind)
    if items is None:
        return float(value)
    converted = (_as_declared(items[0][0], v) for v in value)
    return list(converted) if isinstance(kind, inspect.ListType) else tuple(converted)


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) < _MAX_VALUE_LENGTH else f"{text[: _MAX_VALUE_LENGTH - 3]}..."


def check_value(
    declared: Field, value: object, error: type[DefsenseError], where: str, key: str
) -> None:
    """Check one value for a key, before it is rounded and written to a file.

    Args:
        declared: The key.
        value: The value.
        error: Class of the error.
        where: Place for the message, such as `device.toml: mesh.edge_length`.
        key: Dotted name of the key, for the error's data.

    Raises:
        DefsenseError: of the class `error`, if the key does not accept the value.
    """
    reader = Reader()
    reader.read_value(declared.kind, value, (declared.name,))
    for problem in reader.problems[:1]:
        raise error(
            problem.text,
            code=problem.code,
            where=where,
            action=problem.action,
            **{**problem.data, "key": key},
        )


def validate(table: msgspec.Struct, error: type[DefsenseError]) -> None:
    """Check a table that a program made: call it in `__post_init__`.

    Raises:
        DefsenseError: of the class `error`, for the first key whose value is not accepted; its
            data hold the `key`.
    """
    reader = Reader()
    for field in struct_type(type(table)).fields:
        value = getattr(table, field.name)
        if value != field.default:  # defaults may be outside, such as an empty text
            reader.read_value(field.type, value, (field.encode_name,))
    found: Iterable[Problem] = (
        () if reader.problems else table.check() if hasattr(table, "check") else ()
    )
    for problem in (*reader.problems, *found):
        name = str(problem.path[0]) if problem.path else ""
        raise error(
            problem.text,
            code=problem.code,
            where=name,
            action=problem.action,
            key=name,
            **problem.data,
        )
