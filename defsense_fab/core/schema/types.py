"""What declared types accept, in words and as shapes: shared by the reader and the reference."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from functools import cache
from typing import Any

from msgspec import inspect

from ..storage.package_data import read_rows

NumberType = inspect.FloatType | inspect.IntType

_MIN_PLAIN, _MAX_PLAIN = 1e-12, 1e15  # between which numbers are written without an exponent
#: Largest number that is accepted: sums and products of a few stay finite.
MAX_NUMBER = 1e300


@cache
def struct_type(kind: Any) -> inspect.StructType:
    """Return the description of a declared table."""
    described = inspect.type_info(kind)
    if not isinstance(described, inspect.StructType):
        raise TypeError(f"{kind} is not a msgspec struct")
    return described


def split_metadata(kind: inspect.Type) -> tuple[inspect.Type, Mapping[str, Any]]:
    """Return a type without its annotations, and these: the words of `declare.key`."""
    words: dict[str, Any] = {}
    while isinstance(kind, inspect.Metadata):
        words = {**(kind.extra_json_schema or {}), **(kind.extra or {}), **words}
        kind = kind.type
    return kind, words


def members(kind: inspect.Type) -> tuple[inspect.Type, ...]:
    """Return the types of which a value may be, without None, which TOML does not have."""
    kind, _ = split_metadata(kind)
    if not isinstance(kind, inspect.UnionType):
        return (kind,)
    return tuple(
        t for t, _ in map(split_metadata, kind.types) if not isinstance(t, inspect.NoneType)
    )


def item_types(kind: inspect.Type) -> tuple[tuple[inspect.Type, ...], int | None] | None:
    """Return the types of a list's items and their number, None for any; None for other types.

    A list of any length has one item type.
    """
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        return (kind.item_type,), None
    if isinstance(kind, inspect.TupleType):
        return kind.item_types, len(kind.item_types)
    return None


def number_shape(kind: inspect.Type) -> tuple[int | None, ...] | None:
    """Return the shape of nested lists of numbers, None for any length; None for other types."""
    kind, _ = split_metadata(kind)
    if isinstance(kind, NumberType):
        return ()
    items = item_types(kind)
    inner = number_shape(items[0][0]) if items else None
    if items is None or inner is None or any(number_shape(t) != inner for t in items[0]):
        return None
    return (items[1], *inner)


def number_type(kind: inspect.Type) -> NumberType:
    """Return the type of the numbers in nested lists of them, which has their bounds."""
    kind, _ = split_metadata(kind)
    if isinstance(kind, NumberType):
        return kind
    items = item_types(kind)
    if items is None:
        raise TypeError(f"{kind} is not made of numbers")
    return number_type(items[0][0])


def is_number(value: object) -> bool:
    """Return whether a value is a finite number that a float can hold; True and False are not."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < MAX_NUMBER  # false for NaN too


def is_within(kind: NumberType, value: float) -> bool:
    """Return whether a number is within the bounds of its type."""
    return (
        (kind.gt is None or value > kind.gt)
        and (kind.ge is None or value >= kind.ge)
        and (kind.lt is None or value < kind.lt)
        and (kind.le is None or value <= kind.le)
    )


def bounds_in_words(kind: NumberType) -> str:
    """Return the bounds of numbers, such as `above 0` or `from 1 to 100`; empty without any."""
    if kind.ge is not None and kind.le is not None:
        return f"from {kind.ge:g} to {kind.le:g}"
    words = (
        (kind.gt, "above {:g}"),
        (kind.ge, "at least {:g}"),
        (kind.lt, "below {:g}"),
        (kind.le, "at most {:g}"),
    )
    return " and ".join(text.format(bound) for bound, text in words if bound is not None)


def exact(value: float) -> str:
    """Return a number with all its digits, as a user writes it."""
    if _MIN_PLAIN < abs(value) < _MAX_PLAIN:
        return format(Decimal(repr(value)), "f").removesuffix(".0")
    return repr(value).removesuffix(".0")


def shape_in_words(shape: tuple[int | None, ...]) -> str:
    """Return a shape of lists of numbers, such as `3 numbers` or `a list of lists of 3 numbers`."""
    words = "numbers"
    for count in reversed(shape[1:]):
        words = f"lists of {words}" if count is None else f"lists of {count} {words}"
    return f"a list of {words}" if shape[0] is None else f"{shape[0]} {words}"


def in_words(kind: inspect.Type) -> str:
    """Return what a value of a type must be, such as `a number` or `"free" or a table`."""
    kind, extra = split_metadata(kind)
    if "form" in extra:
        return str(extra["form"])
    if isinstance(kind, inspect.UnionType):
        return " or ".join(map(in_words, members(kind)))
    if isinstance(kind, inspect.LiteralType):
        return " or ".join(f'"{v}"' if isinstance(v, str) else str(v) for v in kind.values)
    if shape := number_shape(kind):
        return shape_in_words(shape)
    if isinstance(kind, NumberType):
        return "a number" if isinstance(kind, inspect.FloatType) else "a whole number"
    if items := item_types(kind):
        inner = members(items[0][0])[0]
        plural = {inspect.StructType: "tables", inspect.DictType: "tables"}
        return f"a list of {plural.get(type(inner), 'texts')}"
    names: dict[type, str] = {
        inspect.BoolType: "true or false",
        inspect.StrType: "a text in quotes",
        inspect.StructType: "a table",
        inspect.DictType: "a table",
    }
    return names.get(type(kind), "a value")


def choices_of(kind: inspect.Type) -> tuple[str, ...]:
    """Return the texts that a key accepts, or () where it accepts any."""
    choices = split_metadata(kind)[1].get("choices", ())
    return tuple(read_rows(choices)) if isinstance(choices, str) else tuple(choices)
