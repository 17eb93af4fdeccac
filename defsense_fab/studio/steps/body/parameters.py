"""The parameters of a body's script as fields, and checks of their values."""

from __future__ import annotations

import math
from typing import Any

from ....core.device.device import BodySpec
from ....core.errors import BodyError, DeviceError
from ....core.schema.types import exact, is_number
from ....workflow.starts.body_scripts import Parameter, read_parameters
from ....workflow.view import Problem
from ...messages import body as messages

_MIN_SLIDER_STEPS = 1000
_TABLE = "body.parameters"


def body_parameters(spec: BodySpec) -> messages.BodyParameters:
    """Return where a body comes from, and the fields of its parameters."""
    problem, parameters = None, tuple[Parameter, ...]()
    try:
        parameters = _read(spec)
    except BodyError as error:
        problem = Problem.of(error)
    names = {p.name for p in parameters}
    is_read = problem is None
    return messages.BodyParameters(
        file=spec.path.name,
        source=spec.kind,
        parameters=[_field(p, spec) for p in parameters if p.kind != "other"],
        other=[p.name for p in parameters if p.kind == "other"],
        unknown=[name for name in spec.parameters if is_read and name not in names],
        problem=problem,
    )


def checked_value(spec: BodySpec, name: str, value: float | bool | str) -> float | bool | str:
    """Return a value for a parameter, after checking that the script accepts it.

    Raises:
        BodyError: The script cannot be read.
        DeviceError: It has no such parameter (`unknown-parameter`), or it does not accept the value
            (`value-type`, `out-of-range`).
    """
    found = next((p for p in _read(spec) if p.name == name and p.kind != "other"), None)
    if found is None:
        raise DeviceError(
            f"{spec.path.name} has no parameter {name!r}",
            code="unknown-parameter",
            where=_TABLE,
            parameter=name,
        )
    if found.kind == "switch":
        _check_type(name, value, isinstance(value, bool), "on or off")
        return value
    if found.kind in ("text", "choice"):
        is_valid = isinstance(value, str) and (not found.choices or value in found.choices)
        words = f"one of {', '.join(found.choices)}" if found.choices else "a text"
        _check_type(name, value, is_valid, words)
        return value
    _check_type(name, value, is_number(value), "a finite number")
    assert not isinstance(value, str)
    if found.kind == "whole":
        _check_type(name, value, value == int(value), "a whole number")
        value = int(value)
    low, high = found.low, found.high
    if (low is not None and value < low) or (high is not None and value > high):
        raise _refusal(name, f"must be {_range(low, high, found.unit)}", value, "out-of-range")
    return value


def _read(spec: BodySpec) -> tuple[Parameter, ...]:
    return read_parameters(spec.path, spec.parameters) if spec.kind == "script" else ()


def _field(p: Parameter, spec: BodySpec) -> messages.Parameter:
    value = spec.parameters.get(p.name, p.default)
    low, high, step = _slider(p, value)
    return messages.Parameter(
        name=p.name,
        kind=p.kind if p.kind != "other" else "text",
        unit=p.unit,
        value=_plain(value),
        default=_plain(p.default),
        low=low,
        high=high,
        step=step,
        min=p.low,
        max=p.high,
        choices=list(p.choices),
        is_set=p.name in spec.parameters,
    )


def _slider(p: Parameter, value: Any) -> tuple[float | None, float | None, float]:
    """Return the ends and the step of a number's slider; no ends for other parameters."""
    if p.kind not in ("number", "whole") or not is_number(value):
        return None, None, 1.0
    low, high = p.bounds(value)
    if high <= low:
        high = low + 1
    if p.kind == "whole":
        return low, high, 1.0
    return low, high, 10.0 ** math.floor(math.log10((high - low) / _MIN_SLIDER_STEPS))


def _plain(value: Any) -> messages.FieldValue:
    return value if isinstance(value, bool | int | float | str) else None


def _check_type(name: str, value: object, is_valid: bool, words: str) -> None:
    if not is_valid:
        raise _refusal(name, f"must be {words}", value, "value-type")


def _range(low: float | None, high: float | None, unit: str) -> str:
    unit = f" {unit}" if unit else ""
    if low is not None and high is not None:
        return f"from {exact(low)} to {exact(high)}{unit}"
    if low is not None:
        return f"at least {exact(low)}{unit}"
    assert high is not None
    return f"at most {exact(high)}{unit}"


def _refusal(name: str, problem: str, value: Any, code: str) -> DeviceError:
    key = f"{_TABLE}.{name}"
    is_numeric = isinstance(value, int | float) and not isinstance(value, bool)
    shown = exact(value) if is_numeric else repr(value)
    return DeviceError(
        f"{problem}, not {shown}",
        code=code,
        where=f"device.toml: {key}",
        key=key,
        parameter=name,
        value=value,
    )
