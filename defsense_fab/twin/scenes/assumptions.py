"""Records of assumed numbers: each field carries its unit, its meaning and its source.

Fields are declared with `assume`. Every field belongs to a *trait* of the twin, such as
`hysteresis`, and `disable_traits` sets all fields of a trait to the values that remove its effect.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

#: The source of a number that nobody has measured.
ASSUMED = "assumed"
T = TypeVar("T")


@dataclass(frozen=True)
class Assumption:
    """One assumed number.

    Attributes:
        trait: The trait of the twin that the number belongs to.
        name: The name of the field.
        value: The number.
        unit: Its unit; `"1"` for a ratio.
        meaning: What the number is.
        source: Where it comes from, or `ASSUMED`.
    """

    trait: str
    name: str
    value: Any
    unit: str
    meaning: str
    source: str


def assume(
    default: Any, trait: str, unit: str, meaning: str, source: str = ASSUMED, *, off: Any = 0.0
) -> Any:
    """Declare a dataclass field that holds an assumed number.

    Args:
        default: The assumed value.
        trait: The trait of the twin that the number belongs to.
        unit: Its unit; `"1"` for a ratio.
        meaning: What the number is.
        source: Where it comes from.
        off: The value of the field when its trait is disabled.

    Returns:
        The field of the dataclass.
    """
    metadata = {"trait": trait, "unit": unit, "meaning": meaning, "source": source, "off": off}
    return field(default=default, metadata=metadata)


def list_assumptions(record: Any, skip: str = "") -> list[Assumption]:
    """Return the assumptions of a record and of the records in it, in the order of their fields.

    Args:
        record: A dataclass.
        skip: Name of a field to leave out.
    """
    assumptions: list[Assumption] = []
    for f in fields(record):
        value = getattr(record, f.name)
        if is_dataclass(value) and f.name != skip:
            assumptions += list_assumptions(value)
        elif f.metadata:
            m = f.metadata
            assumptions.append(
                Assumption(m["trait"], f.name, value, m["unit"], m["meaning"], m["source"])
            )
    return assumptions


def disable_traits(record: T, traits: Collection[str]) -> T:
    """Return the record with traits disabled, also in the records in it.

    Args:
        record: A dataclass whose fields were declared with `assume`.
        traits: Names of traits; names that the record does not have are ignored.

    Returns:
        A copy in which the fields of these traits have their `off` values.
    """
    changes = {}
    for f in fields(record):  # type: ignore[arg-type]
        value = getattr(record, f.name)
        if is_dataclass(value):
            changes[f.name] = disable_traits(value, traits)
        elif f.metadata.get("trait") in traits:
            changes[f.name] = f.metadata["off"]
    return replace(record, **changes)  # type: ignore[type-var]
