"""What a twin takes for granted: each number beside its unit, its meaning and where it is from.

A record's fields are made by `assume`. Each belongs to a *trait*, by whose name all its numbers
are set to what they are disable_traits it (`disable_traits`).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

#: The source of a number that nobody has measured.
ASSUMED = "assumed"
T = TypeVar("T")


@dataclass(frozen=True)
class Assumption:
    """A number `value` of a `trait`, in words and units, and its source."""

    trait: str
    name: str
    value: Any
    unit: str
    meaning: str
    source: str


def assume(
    default: Any, trait: str, unit: str, meaning: str, source: str = ASSUMED, *, off: Any = 0.0
) -> Any:
    """A dataclass's field; `off` is its value where the trait is switched off."""
    told = {"trait": trait, "unit": unit, "meaning": meaning, "source": source, "off": off}
    return field(default=default, metadata=told)


def list_assumptions(record: Any) -> list[Assumption]:
    """Those of a record, in the order of its fields."""
    return [
        Assumption(
            f.metadata["trait"], f.name, getattr(record, f.name), f.metadata["unit"],
            f.metadata["meaning"], f.metadata["source"],
        )
        for f in fields(record)
        if f.metadata
    ]  # fmt: skip


def disable_traits(record: T, traits: Collection[str]) -> T:
    """The record with these traits switched off; names of none of its own are left aside."""
    off = {
        f.name: f.metadata["off"]
        for f in fields(record)  # type: ignore[arg-type]
        if f.metadata.get("trait") in traits
    }
    return replace(record, **off)  # type: ignore[type-var]
