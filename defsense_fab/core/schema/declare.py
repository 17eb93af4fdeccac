"""The vocabulary in which the keys of a file are declared: tables, units, bounds and sentences.

A file is declared as nested `Table` structs. Each field is a key of the file:

    class BallTable(Table, frozen=True):
        radius: Annotated[Positive, key("Radius of the ball.", unit="mm")] = 10.0

From such declarations `document.read` checks files, and `reference` makes the pages, JSON Schemas,
comments and form fields.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Annotated

import msgspec

from .key_lines import KeyPath


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base class of the tables of a file.

    A table may define `check(self)`, which yields a `Problem` for each invariant that does not
    hold. It runs after all keys of the table were read without a problem.
    """


Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Count = Annotated[int, msgspec.Meta(ge=1)]
Vector = tuple[float, float, float]


def key(
    description: str,
    *,
    unit: str = "",
    default: str = "",
    form: str = "",
    rows: str = "",
    choices: Iterable[str] | str = (),
) -> msgspec.Meta:
    """Return what `Annotated[type, ...]` says about a key.

    Args:
        description: One sentence, in Markdown, on what the key means.
        unit: Unit of its numbers.
        default: The default in words, where it is not the field's default value.
        form: The values that are accepted, in words, where the type does not say it well.
        rows: Table in `data/` whose column of the same name holds the default.
        choices: The texts that are accepted, or the table in `data/` whose rows they name.
    """
    words = {"unit": unit, "default": default, "form": form, "rows": rows, "choices": choices}
    return msgspec.Meta(description=description, extra={k: v for k, v in words.items() if v})


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong in a file.

    Attributes:
        path: The key, from the table whose check found the problem.
        text: What is wrong, with the value.
        code: Stable identifier of the kind of problem.
        action: What the user can do about it.
        data: Facts for programs.
    """

    path: KeyPath
    text: str
    code: str
    action: str = ""
    data: Mapping[str, object] = field(default_factory=dict)

    def below(self, *parents: str | int) -> Problem:
        """Return the same problem as seen from an outer table."""
        return Problem((*parents, *self.path), self.text, self.code, self.action, self.data)


def missing(name: str) -> Problem:
    """Return the problem of a required key that is absent."""
    return Problem((name,), "is missing", "key-missing", "Add it")


def unknown_choice(
    path: KeyPath,
    value: str,
    choices: Iterable[str],
    noun: str = "value",
    code: str = "value-choice",
) -> Problem:
    """Return the problem of a text that is not one of `choices`, with the closest choice."""
    names = tuple(choices)
    close = get_close_matches(value, names, n=1)
    hint = f"Did you mean {close[0]!r}? " if close else ""
    return Problem(
        path,
        f"unknown {noun} {value!r}",
        code,
        f"{hint}Use one of: {', '.join(names)}" if names else f"There is no {noun} to choose from",
        {"value": value, "choices": names, "suggestion": close[0] if close else None},
    )
