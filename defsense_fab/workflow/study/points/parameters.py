"""The parameters of a study: keys of `device.toml`, each with a list, a range or a distribution."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from ....core.schema.declare import Positive, Problem, Table, key
from ....core.schema.key_lines import KeyPath
from ....core.schema.reader import Reader
from ....core.schema.types import is_number

_KINDS = ("range", "uniform", "log_uniform")
_MAX_STEPS = 10_000
_SIGNIFICANT_DIGITS = 6  # of drawn numbers: as many as a person would still write

_Interval = tuple[float, float]


class Distribution(Table, frozen=True):
    """Values of a parameter that are not listed: exactly one of range, uniform and log_uniform."""

    range: Annotated[
        _Interval | None,
        key("First and last of evenly spaced values; needs `step` or `steps`.", default="none"),
    ] = None
    step: Annotated[
        Positive | None, key("Distance of the values of a `range`.", default="this or `steps`")
    ] = None
    steps: Annotated[
        Annotated[int, Meta(ge=2)] | None,
        key("Number of the values of a `range`, ends included.", default="this or `step`"),
    ] = None
    uniform: Annotated[
        _Interval | None,
        key("Smallest and largest number, for a Latin hypercube.", default="none"),
    ] = None
    log_uniform: Annotated[
        _Interval | None,
        key("The same, with evenly distributed logarithms.", default="none"),
    ] = None

    @property
    def kind(self) -> str:
        """The first kind that is given."""
        return next(kind for kind in _KINDS if getattr(self, kind) is not None)

    def check(self) -> Iterator[Problem]:
        """Yield problems of kinds that exclude each other, and of limits and steps."""
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) > 1:
            text = f"{given[0]} is given too"
            yield Problem((given[1],), text, "keys-exclusive", f"Give one of {', '.join(_KINDS)}")
            return
        kind = given[0]
        low, high = getattr(self, kind)
        if low >= high:
            text = "the first number must be less than the second"
            yield Problem((kind,), text, "not-increasing", "Exchange them")
        elif kind == "log_uniform" and low <= 0:
            text = "both numbers must be above 0"
            yield Problem((kind,), text, "out-of-range", "Increase the first")
        elif kind == "range":
            yield from self._check_steps(low, high)
        for name in ("step", "steps"):
            if kind != "range" and getattr(self, name) is not None:
                yield Problem((name,), "is for a range", "key-not-applicable", "Remove it")

    def _check_steps(self, low: float, high: float) -> Iterator[Problem]:
        if (self.step is None) == (self.steps is None):
            text = "needs either step or steps"
            action = "Give either step = 0.5, or steps = 5 for the number of values"
            yield Problem(("range",), text, "keys-exclusive", action)
            return
        steps = (self.steps or 0) if self.step is None else (high - low) / self.step + 1 + 1e-9
        if steps > _MAX_STEPS:
            text = f"makes more than {_MAX_STEPS} values"
            yield Problem(("range",), text, "too-many-values", "Use larger steps")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a study.

    Attributes:
        key: Dotted key of `device.toml`.
        values: The values that it takes; empty if numbers are drawn.
        bounds: Smallest and largest number that is drawn, or None.
        logarithmic: Whether the logarithms of the drawn numbers are evenly distributed.
        path: Where it is in `study.toml`.
    """

    key: str
    values: tuple[Any, ...] = ()
    bounds: tuple[float, float] | None = None
    logarithmic: bool = False
    path: KeyPath = ()

    def at(self, share: float) -> Any:
        """Return the value below which a `share`, from 0 to below 1, of the distribution is.

        Values of lists and ranges occur equally often.
        """
        if self.bounds is None:
            return self.values[int(share * len(self.values))]
        low, high = self.bounds
        if self.logarithmic:
            value = float(np.exp(np.log(low) + share * np.log(high / low)))
        else:
            value = low + share * (high - low)
        return float(f"{value:.{_SIGNIFICANT_DIGITS}g}")


def read_parameters(table: Mapping[str, Any]) -> tuple[tuple[Parameter, ...], list[Problem]]:
    """Read the table `[parameters]`.

    Returns:
        The parameters, in the order of the file, and all problems.
    """
    problems: list[Problem] = []
    parameters: dict[str, Parameter] = {}
    for path, value in _leaves(table, ("parameters",)):
        dotted = ".".join(map(str, path[1:]))
        if isinstance(value, list):
            problems += [problem.below(*path) for problem in _check_list(value)]
            parameter = Parameter(dotted, tuple(value), path=path)
        elif isinstance(value, Mapping) and value:
            reader = Reader()
            distribution = reader.read_table(Distribution, value, path)
            problems += reader.problems
            if distribution is None or reader.problems:
                continue
            parameter = _drawn(dotted, distribution, value, path)
        else:
            text = (
                "must be a list of values, or one of { range = [1, 4], step = 1 },"
                f" {{ uniform = [1, 4] }} and {{ log_uniform = [0.1, 10] }}, not {value!r}"
            )
            problems.append(Problem(path, text, "value-type"))
            continue
        if dotted in parameters:
            text = "is given twice, with and without quotes"
            problems.append(Problem(path, text, "key-repeated", "Leave one of them out"))
        parameters[dotted] = parameter
    return tuple(parameters.values()), problems


def _leaves(table: Mapping[str, Any], at: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    """Yield paths and values of parameters; TOML makes tables in tables of plain dotted keys."""
    for name, value in table.items():
        path = (*at, name)
        if isinstance(value, Mapping) and value and set(_KINDS).isdisjoint(value):
            yield from _leaves(value, path)
        else:
            yield path, value


def _check_list(values: list[Any]) -> Iterator[Problem]:
    if not values:
        yield Problem((), "the list is empty", "too-few-items", "Give at least one value")
    elif not all(map(_is_plain, values)):
        yield Problem((), "must hold numbers, texts, true and false", "value-type")


def _is_plain(value: Any) -> bool:
    """Return whether JSON, in which batches of runs are described, has a value of this kind."""
    if isinstance(value, list | dict):
        return all(map(_is_plain, value.values() if isinstance(value, dict) else value))
    return isinstance(value, bool | str) or is_number(value)


def _drawn(
    dotted: str, distribution: Distribution, written: Mapping[str, Any], path: KeyPath
) -> Parameter:
    """Return the parameter of a distribution; a range of whole numbers has whole values."""
    low, high = getattr(distribution, distribution.kind)
    if distribution.range is None:
        is_logarithmic = distribution.kind == "log_uniform"
        return Parameter(dotted, (), (low, high), is_logarithmic, path)
    if distribution.step is None:
        is_whole, values = False, np.linspace(low, high, distribution.steps or 0)
    else:
        numbers = (*written["range"], written["step"])
        is_whole = all(isinstance(number, int) for number in numbers)
        count = int((high - low) / distribution.step + 1e-9) + 1
        values = low + distribution.step * np.arange(count)
    found = tuple(int(v) if is_whole else float(f"{v:.12g}") for v in values)
    return Parameter(dotted, found, path=path)


def varied(points: list[Mapping[str, Any]], key: str) -> list[Any]:
    """Return the different values of a parameter in these points, in their order."""
    out: list[Any] = []
    for value in (p[key] for p in points):
        if value not in out:
            out.append(value)
    return out


def is_numeric(values: list[Any]) -> bool:
    """Return whether all values are numbers."""
    return all(is_number(v) for v in values)
