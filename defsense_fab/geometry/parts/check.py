"""A measurement of finished parts, as inspections make it and manifests keep it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """`value` as measured, the `limit` that it keeps (below it for "at most"), where, and what a
    maker should be told of it, if anything."""

    name: str
    value: float
    limit: float
    unit: str
    at: str
    note: str = ""
