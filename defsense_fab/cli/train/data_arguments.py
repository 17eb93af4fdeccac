"""Arguments of all commands that read data: sessions, datasets, and other files."""

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


def add_data_arguments(sub: argparse.ArgumentParser) -> None:
    """Add SESSION..., --signals with --tracks, --device, --markers, --offset and --shift."""
    sub.add_argument(
        "sources",
        nargs="*",
        type=Path,
        metavar="SESSION",
        help="Processed sessions, datasets, or XDF files",
    )
    sub.add_argument(
        "--device",
        type=device_folder,
        metavar="DIR",
        help="Set the device folder, which contains device.toml",
    )
    sub.add_argument(
        "--signals",
        type=Path,
        metavar="CSV",
        help="Read signals or resistances over time from this file instead of sessions",
    )
    sub.add_argument(
        "--tracks",
        type=Path,
        metavar="FILE",
        help="Read the markers from this file (.csv, .npz, .parquet, .c3d, .trc), with --signals",
    )
    sub.add_argument(
        "--markers",
        type=Path,
        metavar="JSON",
        help="Set the file of the markers' positions at rest (default: markers.json of the device)",
    )
    sub.add_argument(
        "--offset",
        default="0",
        metavar="S",
        help="Set the time in s by which the tracks' clock is ahead, or auto (default: 0)",
    )
    sub.add_argument(
        "--shift",
        default="0",
        metavar="S",
        help="Set the time in s to add to the times of the signals, or auto (default: 0)",
    )


def read_data_arguments(options: argparse.Namespace) -> DataFiles | None:
    """Return the data that the options name.

    Returns:
        The data, or None if the options name none.

    Raises:
        TrainingError: Only one of --signals and --tracks is given (`options-incomplete`), or a time
            is not a number (`not-a-number`).
    """
    from ...training.recordings.datasets import DataFiles

    if (options.signals is None) != (options.tracks is None):
        raise TrainingError(
            "--signals and --tracks belong together",
            code="options-incomplete",
            action="Give both, or sessions",
        )
    offset = _parse_seconds("--offset", options.offset)
    shift = _parse_seconds("--shift", options.shift)
    if not options.sources and options.signals is None:
        return None
    return DataFiles(
        tuple(options.sources), options.signals, options.tracks, options.markers, offset, shift
    )


def format_data_arguments(options: argparse.Namespace) -> str:
    """Return the same data as arguments for another command line."""
    words = [str(source) for source in options.sources]
    for name in ("device", "signals", "tracks", "markers", "offset", "shift"):
        value = getattr(options, name)
        if value is not None and value != "0":
            words += [f"--{name}", str(value)]
    return " ".join(map(quote, words))


def _parse_seconds(option: str, text: str) -> float | Literal["auto"]:
    if text == "auto":
        return "auto"
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise TrainingError(
            f"{text} is not a time",
            code="not-a-number",
            where=option,
            action="Give seconds, or auto",
            value=text,
        )
    return seconds
