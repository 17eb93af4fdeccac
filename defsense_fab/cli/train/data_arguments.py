"""The arguments of all commands that take data: sessions, datasets, and files of others."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Literal

from ...core.errors import TrainingError
from ..device import device_folder

if TYPE_CHECKING:
    from ...training.recordings.datasets import DataFiles


def data_arguments(sub: argparse.ArgumentParser) -> None:
    """SESSION..., or --signals with --tracks; --device, --markers, --offset, --shift."""
    sub.add_argument("sources", nargs="*", type=Path, metavar="SESSION",
                     help="processed sessions, datasets, or XDF files")  # fmt: skip
    sub.add_argument("--device", type=device_folder, metavar="DIR", help="folder with device.toml")
    sub.add_argument("--signals", type=Path, metavar="CSV",
                     help="in place of sessions: signals or resistances by time")  # fmt: skip
    sub.add_argument("--tracks", type=Path, metavar="FILE",
                     help="and the markers (.csv, .npz, .parquet, .c3d, .trc)")  # fmt: skip
    sub.add_argument("--markers", type=Path, metavar="JSON",
                     help="where these are at rest (markers.json, of the device)")  # fmt: skip
    sub.add_argument("--offset", default="0", metavar="S",
                     help="by which the tracks' clock is ahead, or auto (0)")  # fmt: skip
    sub.add_argument("--shift", default="0", metavar="S",
                     help="to add to the times of the signals, or auto (0)")  # fmt: skip


def data_given(options: argparse.Namespace) -> DataFiles | None:
    """None where there is no data among the options. Raises TrainingError for half of a pair, and
    for times that are none."""
    from ...training.recordings.datasets import DataFiles

    if (options.signals is None) != (options.tracks is None):
        raise TrainingError("--signals and --tracks go together: give both, or sessions")
    offset = _seconds("--offset", options.offset)
    shift = _seconds("--shift", options.shift)
    if not options.sources and options.signals is None:
        return None
    return DataFiles(
        tuple(options.sources), options.signals, options.tracks, options.markers, offset, shift
    )


def data_words(options: argparse.Namespace) -> str:
    """The same data as words of another command's line."""
    words = [str(source) for source in options.sources]
    for name in ("device", "signals", "tracks", "markers", "offset", "shift"):
        value = getattr(options, name)
        if value is not None and value != "0":
            words += [f"--{name}", str(value)]
    return " ".join(map(quote, words))


def _seconds(option: str, text: str) -> float | Literal["auto"]:
    if text == "auto":
        return "auto"
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise TrainingError(f"{option} {text}: give s, or auto")
    return seconds
