"""Comparison of the paper's numbers with ours: means over units, ratios, and expectations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..experiments.experiment import PREDICTED, TOLD_APART, Experiment, PaperNumber

#: Results of a layout: its design and the tests of its units.
Results = Mapping[str, Any]


@dataclass(frozen=True)
class Compared:
    """A number of the paper, or an expectation, and ours.

    Attributes:
        number: The number of the paper.
        values: Ours, of each unit; one of a design.
        mean: Mean of the values, for ratios the ratio of the means; None without values.
        sd: Standard deviation of the values; 0 of one value.
        ratio: Ratio of ours to the paper's; None if there is none.
        met: Whether the expectation is met; None without an expectation.
    """

    number: PaperNumber
    values: tuple[float, ...]
    mean: float | None
    sd: float
    ratio: float | None
    met: bool | None

    @property
    def range(self) -> tuple[float, float] | None:
        """Smallest and largest value of the units."""
        return (min(self.values), max(self.values)) if self.values else None


def compare_numbers(experiment: Experiment, layouts: Mapping[str, Results]) -> tuple[Compared, ...]:
    """Compare all numbers of an experiment with its results by layout or cord."""
    return tuple(compare_number(n, layouts) for n in experiment.numbers)


def compare_number(number: PaperNumber, layouts: Mapping[str, Results]) -> Compared:
    """Compare one number with the results by layout or cord."""
    values = _values(number, layouts.get(number.layout))
    mean = _mean(values)
    if number.over is not None:
        other = _values(number, layouts.get(number.over))
        other_mean = _mean(other)
        is_paired = len(values) == len(other) and all(other)
        mean = mean / other_mean if mean is not None and other_mean else None
        values = [a / b for a, b in zip(values, other, strict=True)] if is_paired else []
    met = None
    if mean is not None and number.at_most is not None:
        met = mean <= number.at_most
    if mean is not None and number.at_least is not None:
        met = mean >= number.at_least
    ratio = mean / number.paper if mean is not None and number.paper else None
    sd = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return Compared(number, tuple(values), mean, sd, ratio, met)


def _values(number: PaperNumber, results: Results | None) -> list[float]:
    """Return the values of all units, or that of the design."""
    if results is None:
        return []
    if number.quantity in results:  # of a cord
        return [float(v) for v in results[number.quantity]]
    design = results.get("design")
    if number.quantity == PREDICTED and design is not None:
        by_decoder = design["predicted_by_decoder"]
        return [by_decoder["affine"] if number.decoder == "affine" else design["predicted"]]
    units: Sequence[Results] = results.get("units", ())
    if number.quantity == TOLD_APART:
        return [u["told_apart"]["share"] for u in units if u["told_apart"] is not None]
    return [u[number.decoder][number.quantity] for u in units]


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def as_row(c: Compared) -> dict[str, Any]:
    """Return a comparison in plain values."""
    n = c.number
    return {
        "of": n.layout, "over": n.over, "quantity": n.quantity, "decoder": n.decoder,
        "paper": n.paper, "where": n.where, "at_most": n.at_most, "at_least": n.at_least,
        "why": n.why, "ours": c.mean, "sd": c.sd, "values": list(c.values), "ratio": c.ratio,
        "met": c.met,
    }  # fmt: skip
