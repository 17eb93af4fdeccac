"""JSON files as typed records: every key is checked when a file is read, and its schema number.

A record is a frozen dataclass with a class attribute `SCHEMA`; arrays stand as nested lists.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar, get_origin

import msgspec
import numpy as np

from ..errors import DefsenseError, StorageError
from .files import write_json


class Record(Protocol):
    """What can stand in a file of its own."""

    SCHEMA: ClassVar[int]
    __dataclass_fields__: ClassVar[dict[str, Any]]


R = TypeVar("R", bound=Record)


def to_json(record: object) -> Any:
    """Plain values of a record, without its schema number."""
    return msgspec.to_builtins(record, enc_hook=_plain)


def from_json(data: object, kind: type[R]) -> R:
    """The record of plain values. Raises msgspec.ValidationError with the place of what is not."""
    return msgspec.convert(data, type=kind, dec_hook=_array)


def save(path: Path, record: Record) -> None:
    """The record as JSON, whole or not at all. Raises StorageError."""
    write_json(path, {"schema": record.SCHEMA, **to_json(record)})


def load(path: Path, kind: type[R], remedy: str, error: type[DefsenseError] = StorageError) -> R:
    """What `save` wrote, or the same as TOML. Raises `error` with the `remedy` ("build the device
    again") for a file that is missing, damaged, or of another schema."""
    try:
        text = path.read_text(encoding="utf-8")
        data = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    except OSError as problem:
        raise error(f"{path}: cannot be read: {problem.strerror}; {remedy}") from None
    except ValueError as problem:
        raise error(
            f"{path}: is not valid {path.suffix[1:].upper()} ({problem}); {remedy}"
        ) from None
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != kind.SCHEMA:
        raise error(f"{path}: has schema {schema}, and this version reads {kind.SCHEMA}; {remedy}")
    try:
        return from_json(data, kind)
    except msgspec.ValidationError as problem:
        raise error(f"{path}: is damaged ({problem}); {remedy}") from None


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def _array(kind: Any, value: Any) -> Any:
    """Nested lists as the array that a field is annotated with."""
    if get_origin(kind) is not np.ndarray:
        raise TypeError(f"{kind} cannot be read from JSON")
    dtype = np.dtype(kind.__args__[1].__args__[0])
    array = np.array(value)
    if array.size and not np.can_cast(array.dtype, dtype, "same_kind"):
        raise ValueError(f"expected numbers, got {array.dtype}")
    return array.astype(dtype)
