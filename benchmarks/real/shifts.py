"""Warnings on the clocks of recordings, as they are and with a shift put in."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from defsense_fab.training.data.dataset import Dataset
from defsense_fab.training.data.dataset_checks import CLOCK_CODES, check_dataset
from defsense_fab.training.data.time_alignment import TimeShift, find_time_shifts

SHIFTS_S = (0.1, 0.3, 1.0, -0.1, -0.3, -1.0)
TOLERANCE_S = 0.05


@dataclass(frozen=True)
class ShiftResult:
    """What is reported on the clocks of one run.

    Attributes:
        run: Name of the run.
        put_in_s: Time that was added to the times of its samples, s.
        found_s: The correction that is found, s, to be added; None if it cannot be compared.
        low_s: Smallest correction that explains the data as well, s.
        high_s: Largest one, s.
        change_s: The correction that is found minus that for the recording as it is, s. A recording
            may have a small shift of its own, such as that of a filter or of fabric that slips.
        verdict: "found": certain, and within 0.05 s. "unknown": reported as not known, or not exact
            enough to be applied. "in step": reported as in step. "wrong": certain, but not within
            0.05 s.
        cpu_s: CPU seconds for the recording.
    """

    run: str
    put_in_s: float
    found_s: float | None
    low_s: float | None
    high_s: float | None
    change_s: float | None
    verdict: str
    cpu_s: float

    @property
    def is_error(self) -> bool:
        """Whether the report is false."""
        return self.verdict == "wrong" or (self.verdict == "in step" and self.put_in_s != 0)


def judge(shift: TimeShift | None, put_in: float) -> str:
    """Return the verdict on what is found for a shift that was put in."""
    if shift is None or not shift.is_informative or not shift.is_known:
        return "unknown"
    if not shift.is_significant:
        return "in step"
    if put_in and abs(shift.seconds + put_in) <= TOLERANCE_S:
        return "found"
    return "wrong" if shift.is_applicable or not put_in else "unknown"


def measure_shifts(dataset: Dataset) -> tuple[list[str], list[ShiftResult]]:
    """Return the warnings on the clocks of a recording, and what is found with shifts put in."""
    warnings = [str(p) for p in check_dataset(dataset) if p.code in CLOCK_CODES]
    results, own = list[ShiftResult](), dict[str, float]()
    for put_in in (0.0, *SHIFTS_S):
        runs = tuple(replace(r, sample_time=r.sample_time + put_in) for r in dataset.recordings)
        start = time.process_time()
        found = find_time_shifts(replace(dataset, recordings=runs))
        cpu_s = time.process_time() - start
        for r in runs:
            s = found.get(r.name)
            if s is None:
                results.append(
                    ShiftResult(r.name, put_in, None, None, None, None, judge(s, put_in), cpu_s)
                )
                continue
            change = s.seconds - own.setdefault(r.name, s.seconds)
            verdict = judge(s, put_in)
            results.append(
                ShiftResult(r.name, put_in, s.seconds, s.low, s.high, change, verdict, cpu_s)
            )
    return warnings, results
