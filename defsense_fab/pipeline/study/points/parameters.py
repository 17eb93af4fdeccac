"""The parameters of a study: keys of `device.toml`, each with a list, a range or a distribution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....core.storage.toml_table import Table, is_number

_KINDS = ("range", "uniform", "log_uniform")
_MOST_STEPS = 10_000
_DIGITS = 6  # significant ones of drawn numbers: what a person would still write down


@dataclass(frozen=True)
class Parameter:
    """A dotted `key` of `device.toml` and its `values`, or the `bounds` between which numbers are
    drawn, evenly or (`logarithmic`) with evenly spread logarithms."""

    key: str
    values: tuple[Any, ...] = ()
    bounds: tuple[float, float] | None = None
    logarithmic: bool = False

    def at(self, share: float) -> Any:
        """The value below which a `share` in [0, 1) of the distribution lies; lists and ranges have
        their values equally often."""
        if self.bounds is None:
            return self.values[int(share * len(self.values))]
        low, high = self.bounds
        if self.logarithmic:
            value = float(np.exp(np.log(low) + share * np.log(high / low)))
        else:
            value = low + share * (high - low)
        return float(f"{value:.{_DIGITS}g}")


def read_parameters(t: Table) -> tuple[Parameter, ...]:
    """Of the table `[parameters]`, in its order. Raises DeviceError with file and line."""
    found = _read(t, "")
    keys = [p.key for p in found]
    twice = next((k for k in keys if keys.count(k) > 1), None)
    if twice is not None:
        t.fail(twice, "is given twice, with and without quotes; leave one of them out")
    return tuple(found)


def _read(t: Table, prefix: str) -> list[Parameter]:
    """Plain dotted keys of TOML are tables in tables."""
    found = []
    for name, value in t.data.items():
        t.has(name)
        key = f"{prefix}{name}"
        if isinstance(value, list):
            if not value:
                t.fail(name, "give at least one value in the list")
            if not all(map(_is_plain, value)):
                t.fail(name, "must hold numbers, texts, true and false")
            found.append(Parameter(key, tuple(value)))
        elif isinstance(value, dict) and value and not set(_KINDS).isdisjoint(value):
            found.append(_distribution(t.table(name), key))
        elif isinstance(value, dict) and value:
            found += _read(t.table(name), f"{key}.")
        else:
            t.fail(
                name,
                f"must be a list of values, or one of {{ range = [1, 4], step = 1 }},"
                f" {{ uniform = [1, 4] }} and {{ log_uniform = [0.1, 10] }}, not {value!r}",
            )
    return found


def _is_plain(value: Any) -> bool:
    """Whether JSON has it, as a batch of runs is told it."""
    if isinstance(value, list | dict):
        return all(map(_is_plain, value.values() if isinstance(value, dict) else value))
    return isinstance(value, bool | str) or is_number(value)


def _distribution(t: Table, key: str) -> Parameter:
    given = [k for k in _KINDS if t.has(k)]
    if len(given) > 1:
        t.fail(given[1], f"give one of {', '.join(_KINDS)}")
    kind = given[0]
    low, high = t.vector(kind, 2).tolist()
    if low >= high:
        t.fail(kind, "the first number must be less than the second")
    if kind == "range":
        values = _steps(t, t.raw(kind))
        t.done()
        return Parameter(key, values)
    if kind == "log_uniform" and low <= 0:
        t.fail(kind, "both numbers must be greater than 0")
    t.done()
    return Parameter(key, bounds=(low, high), logarithmic=kind == "log_uniform")


def _steps(t: Table, ends: Any) -> tuple[Any, ...]:
    """Of a range with `step`, or with so many `steps`, ends included; whole numbers stay so."""
    low, high = ends
    if t.has("step") == t.has("steps"):
        t.fail("range", "give either step = 0.5, or steps = 5 for the number of values")
    if t.has("steps"):
        count = int(t.number("steps", low=1))
        if count != t.data["steps"]:
            t.fail("steps", "must be a whole number of at least 2")
        whole = False
        values = np.linspace(low, high, min(count, _MOST_STEPS + 1))
    else:
        step = t.number("step", low=0)
        whole = all(isinstance(v, int) for v in (low, high, t.data["step"]))
        count = int(min((high - low) / step + 1e-9, _MOST_STEPS)) + 1
        values = low + step * np.arange(min(count, _MOST_STEPS + 1))
    if count > _MOST_STEPS:
        t.fail("range", f"makes more than {_MOST_STEPS} values")
    return tuple(int(v) if whole else float(f"{v:.12g}") for v in values)


def varied(points: list[Mapping[str, Any]], key: str) -> list[Any]:
    """The different values of a parameter in these points, in their order."""
    out: list[Any] = []
    for value in (p[key] for p in points):
        if value not in out:
            out.append(value)
    return out


def is_numeric(values: list[Any]) -> bool:
    """Whether all are numbers."""
    return all(is_number(v) for v in values)
