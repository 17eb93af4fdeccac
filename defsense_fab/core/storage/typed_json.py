"""JSON files as typed records: reading checks every key, and the number of the schema.

A record is a frozen dataclass with a class attribute `SCHEMA`; arrays are nested lists in the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar, get_origin

import msgspec
import numpy as np

from ..errors import DefsenseError, StorageError
from .files import load_json, write_json


class Record(Protocol):
    """Dataclass that has a file of its own."""

    SCHEMA: ClassVar[int]
    __dataclass_fields__: ClassVar[dict[str, Any]]


R = TypeVar("R", bound=Record)


def to_json(record: object) -> Any:
    """Return the plain values of a record, without the number of its schema."""
    return msgspec.to_builtins(record, enc_hook=_encode)


def from_json(data: object, kind: type[R]) -> R:
    """Create a record from plain values.

    Args:
        data: Plain values.
        kind: Class of the record.

    Returns:
        The record.

    Raises:
        msgspec.ValidationError: A value is invalid; the error names its place.
    """
    return msgspec.convert(data, type=kind, dec_hook=_decode)


def save(path: Path, record: Record) -> None:
    """Write a record as JSON, whole or not at all.

    Args:
        path: File to write.
        record: The record.

    Raises:
        StorageError: The file cannot be written.
    """
    write_json(path, {"schema": record.SCHEMA, **to_json(record)})


def load(path: Path, kind: type[R], action: str, error: type[DefsenseError] = StorageError) -> R:
    """Read a record that `save` wrote.

    Args:
        path: File to read.
        kind: Class of the record.
        action: What the user can do about a file that is missing or damaged.
        error: Class of the errors to raise.

    Returns:
        The record.

    Raises:
        DefsenseError: Of the class `error`: the file is missing, damaged, or has another schema.
    """
    data = load_json(path, error, action)
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != kind.SCHEMA:
        raise error(
            f"has the schema {schema!r}; this version reads {kind.SCHEMA}",
            code="wrong-schema",
            where=path,
            action=action,
            path=path,
        )
    try:
        return from_json(data, kind)
    except msgspec.ValidationError as problem:
        raise error(
            f"is damaged ({problem})", code="record-invalid", where=path, action=action, path=path
        ) from None


def _encode(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def _decode(kind: Any, value: Any) -> Any:
    """Convert nested lists to the array of a field's annotation."""
    if get_origin(kind) is not np.ndarray:
        raise TypeError(f"{kind} cannot be read from JSON")
    dtype = np.dtype(kind.__args__[1].__args__[0])
    array = np.array(value)
    if array.size and not np.can_cast(array.dtype, dtype, "same_kind"):
        raise ValueError(f"expected numbers, got {array.dtype}")
    return array.astype(dtype)
