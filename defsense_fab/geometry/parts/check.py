"""A measurement of finished parts, as inspections make it and manifests keep it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """`value` as measured, and the `limit` that it keeps, rounding of facets allowed for: it is
    `at_least` so large, or else at most. Beyond it an inspection raises, or leaves a `note`: what a
    maker should be told; `at` is where."""

    name: str
    value: float
    limit: float
    unit: str
    at: str
    note: str = ""
    at_least: bool = False

    @property
    def holds(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit
