"""The paper's numbers beside ours: mean and range over units, their ratio, and whether what is
expected is met."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..experiments.experiment import PREDICTED, TOLD_APART, Experiment, PaperNumber

#: Of a layout: what its design says, and what its units' tests told.
Results = Mapping[str, Any]


@dataclass(frozen=True)
class Compared:
    """A `number` of the paper or an expectation, and ours: the `values` of the units (of a design
    one), their `mean` (of a ratio: the ratio of means) and standard deviation `sd`, 0 of one; None
    where there is nothing to tell. `ratio` is ours to the paper's; whether it is `met`, None where
    nothing is expected."""

    number: PaperNumber
    values: tuple[float, ...]
    mean: float | None
    sd: float
    ratio: float | None
    met: bool | None

    @property
    def range(self) -> tuple[float, float] | None:
        """Least and greatest of the units."""
        return (min(self.values), max(self.values)) if self.values else None


def compare_numbers(experiment: Experiment, layouts: Mapping[str, Results]) -> tuple[Compared, ...]:
    """All numbers of an experiment, from its `layouts` by name."""
    return tuple(compare_number(n, layouts) for n in experiment.numbers)


def compare_number(number: PaperNumber, layouts: Mapping[str, Results]) -> Compared:
    """One number from the layouts by name."""
    own = _values(number, layouts.get(number.layout))
    mean = _mean(own)
    if number.over is not None:
        other = _values(number, layouts.get(number.over))
        below = _mean(other)
        paired = len(own) == len(other) and all(other)
        mean = mean / below if mean is not None and below else None
        own = [a / b for a, b in zip(own, other, strict=True)] if paired else []
    met = None
    if mean is not None and number.at_most is not None:
        met = mean <= number.at_most
    if mean is not None and number.at_least is not None:
        met = mean >= number.at_least
    ratio = mean / number.paper if mean is not None and number.paper else None
    sd = float(np.std(own, ddof=1)) if len(own) > 1 else 0.0
    return Compared(number, tuple(own), mean, sd, ratio, met)


def _values(number: PaperNumber, found: Results | None) -> list[float]:
    """Of each unit, or of the design."""
    if found is None:
        return []
    if number.quantity in found:  # of a cord
        return [float(v) for v in found[number.quantity]]
    design = found.get("design")
    if number.quantity == PREDICTED and design is not None:
        by = design["predicted_by_decoder"]
        return [by["affine"] if number.decoder == "affine" else design["predicted"]]
    units: Sequence[Results] = found.get("units", ())
    if number.quantity == TOLD_APART:
        return [u["told_apart"]["share"] for u in units if u["told_apart"] is not None]
    return [u[number.decoder][number.quantity] for u in units]


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def as_row(c: Compared) -> dict[str, Any]:
    """In plain values."""
    n = c.number
    return {
        "of": n.layout, "over": n.over, "quantity": n.quantity, "decoder": n.decoder,
        "paper": n.paper, "where": n.where, "at_most": n.at_most, "at_least": n.at_least,
        "why": n.why, "ours": c.mean, "sd": c.sd, "values": list(c.values), "ratio": c.ratio,
        "met": c.met,
    }  # fmt: skip
