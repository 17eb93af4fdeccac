"""Signals of a read-out board in files of others, on the way to a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from .tables import RUN, read_table

#: Ends of the names of resistances.
OHM = "_ohm"
#: Columns that are no channels, beside `run`.
_OTHERS = ("frame", "time", "alignment_residual", "counter", "device_us", "host_ns", "led", "late")
_SLOWEST = 1.0  # s between samples, beyond which times are hardly seconds
_MOST = 10.0  # no cord's resistance grows to more than eleven times R0


@dataclass(frozen=True)
class Series:
    """n samples of c `channels` of the file `source` at `time` (n,) s, of any clock: resistances
    `ohm` (n, c), or (R - R0)/R0 as `change` (n, c), or both; NaN where not known."""

    source: str
    channels: tuple[str, ...]
    time: Float
    ohm: Float | None
    change: Float | None

    def __post_init__(self) -> None:
        values = self.ohm if self.ohm is not None else self.change
        if not self.channels or values is None or not np.isfinite(values).any():
            raise TrainingError(f"{self.source}: there is no channel with a number in it")
        if len(self.time) < 2 or not np.median(np.diff(self.time)) < _SLOWEST:
            apart = np.median(np.diff(self.time)) if len(self.time) > 1 else np.inf
            raise TrainingError(
                f"{self.source}: {len(self.time)} samples that are {apart:g} apart; times must be"
                " in seconds"
            )
        usual = np.nanmedian(np.abs(values[np.isfinite(values).any(axis=1)]))
        if self.ohm is None and usual > _MOST:
            raise TrainingError(
                f"{self.source}: signals of {usual:.4g} cannot be (R - R0)/R0; name resistances"
                f" {self.channels[0]}{OHM}, or give their unit"
            )

    def rest(self, at_rest: Bool) -> tuple[Float, str]:
        """R0 (c,) ohm, of samples of which some are `at_rest` (n,), and where it is from; 1 where
        no resistance is known."""
        c = len(self.channels)
        if self.ohm is None:
            return np.ones(c), "not known: resistances are told in units of R0"
        with np.errstate(all="ignore"):
            if self.change is not None:
                each, why = self.ohm / (1 + self.change), "that of the file's own signals"
            else:
                each, why = np.where(at_rest[:, None], self.ohm, np.nan), "the median at rest"
        columns = [column[np.isfinite(column)] for column in each.T]
        none = [n for n, column in zip(self.channels, columns, strict=True) if not len(column)]
        if none:
            raise TrainingError(
                f"{self.source}: {none[0]} has no resistance while the device is at rest; record a"
                " rest at the beginning"
            )
        return np.array([float(np.median(column)) for column in columns]), why


def read_series(path: Path) -> Series:
    """From CSV with a column `time`, s, and one for each channel: (R - R0)/R0 by its name, or
    resistances in ohm as `<name>_ohm`, or both. Raises TrainingError."""
    table = read_table(path)
    if len(set(table.run)) > 1:
        raise TrainingError(
            f"{path}: has samples of {len(set(table.run))} runs; give the session's folder"
        )
    names = [n for n in table.names if n not in _OTHERS and n != RUN]
    return series_of(str(path), names, table["time"], table.columns(names))


def series_of(source: str, names: list[str], time: Float, values: Float) -> Series:
    """Of columns (n, k) with `names`, resistances by theirs. Raises TrainingError where some
    channels have resistances and others have not."""
    ohm = [n.removesuffix(OHM) for n in names if n.endswith(OHM) and n != OHM]
    change = [n for n in names if not n.endswith(OHM) or n == OHM]
    if ohm and change and set(ohm) != set(change):
        odd = sorted(set(ohm) ^ set(change))[0]
        raise TrainingError(
            f"{source}: {odd} has either signals or resistances, and other channels differ; give"
            " the same of all"
        )
    channels = tuple(change or ohm)

    def pick(end: str) -> Float:
        return values[:, [names.index(n + end) for n in channels]]

    # A row without any number is no sample, such as those of frames that were dropped.
    known = np.isfinite(time) & ~np.isnan(values).all(axis=1)
    return Series(
        source, channels, time[known], pick(OHM)[known] if ohm else None,
        pick("")[known] if change else None,
    )  # fmt: skip
