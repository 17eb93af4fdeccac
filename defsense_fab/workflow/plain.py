"""Values as device.toml holds them, of whatever numbers and arrays they were given in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np

from ..core.errors import DeviceError
from .given import shown

_DEEP = 16  # lists and tables within each other, which no device.toml has


def plain(value: object, name: str, depth: int = 0) -> Any:
    """Texts, true and false, integers and floats, and lists and tables of them, of which `depth`
    are around it. Raises DeviceError for what is something else, with its `name`."""
    if depth > _DEEP:
        raise DeviceError(f"{name}: has too many lists within each other, or contains itself")
    if isinstance(value, str):
        return _text(value, name)
    if isinstance(value, bool):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    if isinstance(value, Mapping):
        return table(value, f"{name}.", depth)
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray):
        return [plain(each, name, depth + 1) for each in value]
    if isinstance(value, np.ndarray | np.bool_) or hasattr(value, "__array__"):
        return plain(np.asarray(value).tolist(), name, depth + 1)
    raise DeviceError(f"{name}: give numbers, texts, or lists of them, not {shown(value)}")


def table(values: object, within: str = "", depth: int = 0) -> dict[str, Any]:
    """A mapping from keys to what `plain` takes. Raises DeviceError for what is none."""
    if not isinstance(values, Mapping):
        raise DeviceError(
            f"{within or 'values'}: must be a dict of keys and values, not {shown(values)}; write"
            ' them as in {"cord.noise": 0.002}'
        )
    for key in values:
        if not isinstance(key, str) or not key:
            raise DeviceError(
                f'{within or "values"}: keys are texts as in "cord.noise", not {shown(key)}'
            )
    return {
        _text(key, "key"): plain(value, f"{within}{key}", depth + 1)
        for key, value in values.items()
    }


def _text(value: str, name: str) -> str:
    try:
        value.encode()
    except UnicodeEncodeError:
        raise DeviceError(f"{name}: {value!a} has letters that no file can hold") from None
    return str(value)
