"""What was given for an argument: taken as it is meant, or refused by a sentence that names it.

Each takes the value, the argument's name, and the class of the error for what cannot be.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..core.arrays import Float
from ..core.errors import DefsenseError, DeviceError

# Values as device.toml holds them, of whatever numbers and arrays they were given in.

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
        return plain_table(value, f"{name}.", depth)
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray):
        return [plain(each, name, depth + 1) for each in value]
    if isinstance(value, np.ndarray | np.bool_) or hasattr(value, "__array__"):
        return plain(np.asarray(value).tolist(), name, depth + 1)
    raise DeviceError(f"{name}: give numbers, texts, or lists of them, not {shown(value)}")


def plain_table(values: object, within: str = "", depth: int = 0) -> dict[str, Any]:
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


T = TypeVar("T")
Error = type[DefsenseError]

#: Where objects of a kind come from.
_SOURCES = {
    "Device": "give that of Device.load or Device.create",
    "Simulation": "give that of simulate(device)",
    "Layout": "give that of optimize(simulate(device))",
    "Dataset": "make it by load_sessions, dataset or record_twin",
    "Model": "give that of train or Model.load",
    "str": "give its name in quotes",
}
_LONG = 60  # letters of a value in a message


def of_kind(value: object, name: str, kind: type[T], error: Error = DeviceError) -> T:
    """An object of that `kind`."""
    if isinstance(value, kind):
        return value
    what = {"str": "text"}.get(kind.__name__, f"a {kind.__name__}")
    remedy = _SOURCES.get(kind.__name__, f"make it by {kind.__name__}(...)")
    raise error(f"{name}: must be {what}, not {shown(value)}; {remedy}")


def each_of(values: object, name: str, kind: type[T], error: Error = DeviceError) -> tuple[T, ...]:
    """Objects of that `kind`, in a list, a tuple or an array."""
    found = listed(values, name, error)
    return tuple(of_kind(value, f"{name}[{k}]", kind, error) for k, value in enumerate(found))


def listed(values: object, name: str, error: Error = DeviceError) -> Sequence[Any]:
    """Whatever is in a list, a tuple or an array."""
    if isinstance(values, np.ndarray):
        return list(np.atleast_1d(values))
    if isinstance(values, Sequence) and not isinstance(values, str | bytes):
        return values
    raise error(f"{name}: must be a list, not {shown(values)}; write [...] around a single one")


def truth(value: object, name: str, error: Error = DeviceError) -> bool:
    """True or False, of Python or NumPy."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise error(f"{name}: must be True or False, not {shown(value)}")


def number(
    value: object, name: str, error: Error = DeviceError, above: float = -math.inf,
    most: float = math.inf,
) -> float:  # fmt: skip
    """A finite number between limits, of Python or NumPy."""
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            found = float(value)
        except OverflowError:
            found = math.inf
        if math.isfinite(found) and above < found <= most:
            return found
    limits = "" if above == -math.inf else f" above {above:g}"
    limits += "" if most == math.inf else f" and of at most {most:g}"
    raise error(f"{name}: must be a number{limits}, not {shown(value)}")


def whole(
    value: object, name: str, error: Error = DeviceError, least: int = 1, most: int | None = None
) -> int:
    """A whole number between limits, of Python or NumPy."""
    if isinstance(value, Integral) and not isinstance(value, bool):
        found = int(value)
        if found >= least and (most is None or found <= most):
            return found
    limits = f"of at least {least}" if most is None else f"from {least} to {most}"
    raise error(f"{name}: must be a whole number {limits}, not {shown(value)}")


def array(values: object, name: str, error: Error = DeviceError) -> Float:
    """Numbers of any shape; None within them is NaN."""
    try:
        found = np.asarray(values)
        if values is not None and found.dtype.kind in "iufO":
            return np.asarray(found, float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise error(f"{name}: must be an array of numbers, not {shown(values)}")


def path(value: object, name: str, error: Error = DeviceError) -> Path:
    """A path that is not empty."""
    if isinstance(value, str | os.PathLike):
        text = os.fspath(value)
        if isinstance(text, str) and text and "\0" not in text and _can_be_a_name(text):
            return Path(text)
    raise error(f"{name}: must be a path, not {shown(value)}; give it as text or pathlib.Path")


def _can_be_a_name(text: str) -> bool:
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        return False
    return True


def called(progress: object, error: Error = DeviceError) -> None:
    """Refuses a `progress` that cannot be called."""
    if not callable(progress):
        raise error(
            f"progress: must be a function of (stage, fraction, message), not {shown(progress)};"
            " leave it out to be told nothing"
        )


def shown(value: Any) -> str:
    """A value in a message: itself where it is short and plain, or what it is."""
    if value is None or isinstance(value, str | bool | Real):
        text = repr(value.item() if isinstance(value, np.generic) else value)
        return text if len(text) <= _LONG else f"{text[:_LONG]}..."
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"
