"""Options records: frozen dataclasses that are the single place of an option's default.

The fields of a record are arguments of the Python interface, flags of a command, and controls of
the studio at once:

    @dataclass(frozen=True)
    class RecordOptions:
        \"\"\"Options of a recording.

Attributes:
            rounds: Set the number of rounds through all poses.
        \"\"\"

        rounds: Annotated[int, Meta(ge=1, le=100)] = 2

        def __post_init__(self) -> None:
            check_options(self, CaptureError)
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from ..errors import DefsenseError, DeviceError


@dataclasses.dataclass(frozen=True)
class Option:
    """One field of an options record.

    Attributes:
        name: Name of the field.
        description: Its sentence in the docstring of the record.
        default: Default value; `dataclasses.MISSING` if the option is required.
        low: Smallest value; None without a limit.
        high: Largest value; None without a limit.
        choices: Texts that are accepted; empty if any is.
    """

    name: str
    description: str
    default: Any
    low: float | None
    high: float | None
    choices: tuple[str, ...]


@cache
def options_of(kind: type) -> dict[str, Option]:
    """Return the options of a record by name, in the declared order."""
    hints = get_type_hints(kind, include_extras=True)
    descriptions = dict(_descriptions(kind.__doc__ or ""))
    options = {}
    for field in dataclasses.fields(kind):
        limits, choices = _limits_and_choices(hints[field.name])
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        description = descriptions.get(field.name, "")
        options[field.name] = Option(field.name, description, default, *limits, choices)
    return options


def changed_options(record: Any) -> list[str]:
    """Return the names of the options that differ from their defaults."""
    options = options_of(record.__class__).values()
    return [o.name for o in options if getattr(record, o.name) != o.default]


def check_options(record: Any, error: type[DefsenseError] = DeviceError) -> None:
    """Check that each number of a record is within its bounds, and each text one of its choices.

    Numbers in tuples are checked one by one. Fields that are None are not checked.

    Args:
        record: Instance of an options record.
        error: Class of the error to raise.

    Raises:
        DefsenseError: A number is out of its bounds or NaN (`out-of-range`), or a text is not one
            of the choices (`unknown-choice`). Its `where` is the name of the field.
    """
    for option in options_of(record.__class__).values():
        value = getattr(record, option.name)
        for item in value if isinstance(value, tuple) else (value,):
            if isinstance(item, str):
                if option.choices and item not in option.choices:
                    raise error(
                        f"unknown value {item!r}",
                        code="unknown-choice",
                        where=option.name,
                        action=f"Use one of: {', '.join(option.choices)}",
                        value=item,
                    )
            elif isinstance(item, int | float) and not isinstance(item, bool):
                _check_bounds(option, item, error)


def _check_bounds(option: Option, value: float, error: type[DefsenseError]) -> None:
    low = -math.inf if option.low is None else option.low
    high = math.inf if option.high is None else option.high
    if low <= value <= high:  # False for NaN
        return
    limits = {
        (True, True): f"from {low:g} to {high:g}",
        (True, False): f"of at least {low:g}",
        (False, True): f"of at most {high:g}",
        (False, False): "other than NaN",
    }[option.low is not None, option.high is not None]
    raise error(
        f"{value:g} is out of range",
        code="out-of-range",
        where=option.name,
        action=f"Give a number {limits}",
        value=value,
    )


def _limits_and_choices(
    hint: Any,
) -> tuple[tuple[float | None, float | None], tuple[str, ...]]:
    """Return the bounds and the choices that a type declares, also within unions and tuples."""
    low = high = None
    choices: tuple[str, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *metadata = get_args(hint)
        for item in metadata:
            if isinstance(item, msgspec.Meta):
                low = item.ge if low is None else low
                high = item.le if high is None else high
    if get_origin(hint) is Literal:
        return (low, high), get_args(hint)
    if get_origin(hint) in (Union, UnionType, tuple):
        members = [t for t in get_args(hint) if t not in (NoneType, ...)]
        parts = [_limits_and_choices(member) for member in members]
        for (part_low, part_high), part_choices in parts:
            low = part_low if low is None else low
            high = part_high if high is None else high
            choices += part_choices
        if any(t is str for t in members):
            choices = ()
    return (low, high), choices


def _descriptions(docstring: str) -> Iterator[tuple[str, str]]:
    """Yield the fields of the section `Attributes:` with their sentences."""
    section = docstring.partition("Attributes:\n")[2].split("\n\n")[0]
    for name, text in re.findall(r"^ {8}(\w+): (.*(?:\n {9,}.*)*)", section, re.MULTILINE):
        yield name, " ".join(text.split())
