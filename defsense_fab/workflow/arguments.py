"""Checks of the arguments of the Python interface.

Each function takes a value, the argument's name and the class of the error to raise, and returns
the value in the form that the package uses.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast, get_type_hints

import msgspec
import numpy as np

from ..core.arrays import Float
from ..core.errors import DefsenseError, DeviceError, StorageError
from ..core.schema.options import options_of

T = TypeVar("T")
Error = type[DefsenseError]

# Functions that return objects of a class, for messages.
_SOURCES = {
    "Device": "Use Device.load or Device.create",
    "Simulation": "Use simulate(device)",
    "Layout": "Use optimize(simulate(device))",
    "Dataset": "Use load_sessions, dataset or record_twin",
    "Model": "Use train or Model.load",
    "str": "Give a name in quotes",
}
_MAX_SHOWN_LENGTH = 60  # characters of a value in a message
_MAX_DEPTH = 16  # nested lists and tables; no device.toml has more


def of_kind(value: object, name: str, kind: type[T], error: Error = DeviceError) -> T:
    """Return `value` if it is an object of the class `kind`."""
    if isinstance(value, kind):
        return value
    expected = "text" if kind is str else f"a {kind.__name__}"
    action = _SOURCES.get(kind.__name__, f"Use {kind.__name__}(...)")
    _refuse(name, f"must be {expected}, not {shown(value)}", "wrong-kind", action, error)


def each_of(values: object, name: str, kind: type[T], error: Error = DeviceError) -> tuple[T, ...]:
    """Return the items of a list, a tuple or an array, all of the class `kind`."""
    items = listed(values, name, error)
    return tuple(of_kind(value, f"{name}[{k}]", kind, error) for k, value in enumerate(items))


def listed(values: object, name: str, error: Error = DeviceError) -> Sequence[Any]:
    """Return the items of a list, a tuple or an array."""
    if isinstance(values, np.ndarray):
        return list(np.atleast_1d(values))
    if isinstance(values, Sequence) and not isinstance(values, str | bytes):
        return values
    action = "Write [...] around a single item"
    _refuse(name, f"must be a list, not {shown(values)}", "not-a-list", action, error)


def one_of(
    value: object,
    name: str,
    choices: Collection[str],
    noun: str,
    error: Error = DeviceError,
) -> str:
    """Return a text that is one of the choices; errors call it by its noun, such as "state"."""
    text = of_kind(value, name, str, error)
    if text not in choices:
        action = f"Use one of {', '.join(choices)}"
        _refuse(name, f"unknown {noun} {text!r}", f"unknown-{noun}", action, error)
    return text


def truth(value: object, name: str, error: Error = DeviceError) -> bool:
    """Return True or False, given as a bool of Python or NumPy."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    _refuse(name, f"must be True or False, not {shown(value)}", "not-a-bool", "", error)


def number(value: object, name: str, error: Error = DeviceError, above: float = -math.inf) -> float:
    """Return a finite number greater than `above`, of Python or NumPy."""
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            converted = float(value)
        except OverflowError:
            converted = math.inf
        if math.isfinite(converted) and above < converted:
            return converted
    limits = "" if above == -math.inf else f" above {above:g}"
    _refuse(name, f"must be a number{limits}, not {shown(value)}", "not-a-number", "", error)


def whole(value: object, name: str, error: Error = DeviceError, most: int | None = None) -> int:
    """Return a whole number from 1 to `most`, of Python or NumPy."""
    if isinstance(value, Integral) and not isinstance(value, bool):
        converted = int(value)
        if converted >= 1 and (most is None or converted <= most):
            return converted
    limits = "of at least 1" if most is None else f"from 1 to {most}"
    problem = f"must be a whole number {limits}, not {shown(value)}"
    _refuse(name, problem, "not-a-whole-number", "", error)


def array(values: object, name: str, error: Error = DeviceError) -> Float:
    """Return numbers of any shape; None within them becomes NaN."""
    try:
        converted = np.asarray(values)
        if values is not None and converted.dtype.kind in "iufO":
            return np.asarray(converted, float)
    except (TypeError, ValueError, OverflowError):
        pass
    _refuse(name, f"must be an array of numbers, not {shown(values)}", "not-an-array", "", error)


def path(value: object, name: str, error: Error = DeviceError) -> Path:
    """Return a path that is not empty."""
    if isinstance(value, str | os.PathLike):
        text = os.fspath(value)
        if isinstance(text, str) and text and "\0" not in text and _can_name_a_file(text):
            return Path(text)
    action = "Give it as text or pathlib.Path"
    _refuse(name, f"must be a path, not {shown(value)}", "not-a-path", action, error)


def file_path(value: object, suffix: str, error: Error = DeviceError) -> Path:
    """Return the argument `path` with the name of a file that ends in `suffix`, such as ".json"."""
    file = path(value, "path", StorageError)
    if file.suffix.lower() != suffix:
        raise error(
            f"the name must end in {suffix}", code="wrong-suffix", where=file, suffix=file.suffix
        )
    return file


def _can_name_a_file(text: str) -> bool:
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        return False
    return True


def called(progress: object, error: Error = DeviceError) -> None:
    """Refuse a `progress` that cannot be called."""
    if not callable(progress):
        problem = f"must be a function of (stage, fraction, message), not {shown(progress)}"
        _refuse("progress", problem, "not-callable", "Omit it to disable progress reports", error)


def options(values: Mapping[str, object], kind: type[T], error: Error = DeviceError) -> T:
    """Return an options record, given the values of its fields.

    Args:
        values: Values by the names of the fields. Numbers may be NumPy's, and lists of any kind.
        kind: Class of the record.
        error: Class of the error to raise.

    Raises:
        DefsenseError: There is no such field (`argument-unknown`), or a value is of another kind
            than the field (`wrong-kind`) or not allowed there.
    """
    hints = get_type_hints(kind)
    declared = options_of(cast("type", kind))
    converted = {}
    for name, value in values.items():
        if name not in hints:
            names = ", ".join(hints)
            _refuse(name, "is not an argument", "argument-unknown", f"Use one of {names}", error)
        try:
            if value is not None:
                value = plain(_as_text(value), name)
            if not (isinstance(value, str) and declared[name].choices):
                value = msgspec.convert(value, hints[name], dec_hook=lambda _, text: Path(text))
        except (DeviceError, msgspec.ValidationError) as problem:
            reason = f"is of another kind: {shown(values[name])} ({problem})"
            _refuse(name, reason, "wrong-kind", "", error)
        converted[name] = value
    return kind(**converted)


def _as_text(value: object) -> object:
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def shown(value: Any) -> str:
    """Return a value for a message: itself if it is short and plain, or its kind."""
    if value is None or isinstance(value, str | bool | Real):
        text = repr(value.item() if isinstance(value, np.generic) else value)
        return text if len(text) <= _MAX_SHOWN_LENGTH else f"{text[:_MAX_SHOWN_LENGTH]}..."
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"


def plain(value: object, name: str, depth: int = 0) -> Any:
    """Return a value as `device.toml` holds it: texts, numbers, lists and tables.

    Args:
        value: The value, of Python or NumPy types.
        name: Name of the argument.
        depth: Number of lists and tables around it.

    Raises:
        DeviceError: The value has no such form.
    """
    if depth > _MAX_DEPTH:
        _refuse(name, "has too many nested lists, or contains itself", "nested-too-deeply", "")
    if isinstance(value, str):
        return _encodable(value, name)
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
    problem = f"must be numbers, texts, or lists of them, not {shown(value)}"
    _refuse(name, problem, "not-plain", "")


def plain_table(values: object, within: str = "", depth: int = 0) -> dict[str, Any]:
    """Return a mapping of texts to what `plain` takes. Raises DeviceError for other values."""
    where = within.rstrip(".") or "values"
    if not isinstance(values, Mapping):
        problem = f"must be a dict of keys and values, not {shown(values)}"
        _refuse(where, problem, "not-a-dict", 'Write them as in {"cord.noise": 0.002}')
    for key in values:
        if not isinstance(key, str) or not key:
            problem = f"keys must be texts, not {shown(key)}"
            _refuse(where, problem, "not-a-key", 'Write them as in "cord.noise"')
    return {
        _encodable(key, "key"): plain(value, f"{within}{key}", depth + 1)
        for key, value in values.items()
    }


def _encodable(value: str, name: str) -> str:
    try:
        value.encode()
    except UnicodeEncodeError:
        problem = f"{value!a} contains characters that cannot be encoded as UTF-8"
        _refuse(name, problem, "not-encodable", "")
    return str(value)


def _refuse(
    name: str, problem: str, code: str, action: str, error: Error = DeviceError
) -> NoReturn:
    raise error(problem, code=code, where=name, action=action, argument=name) from None
