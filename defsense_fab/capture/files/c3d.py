"""C3D, the files of motion-capture systems, by ezc3d.

C3D has one rate. Frames are written on a regular grid of instants, and what lies between them in
the tracks (frames that were dropped) as frames without markers; places are never interpolated.
Times that stray from the grid by more than a tenth of its period are refused; others come back on
the grid. Frames count from 0 here and from 1 in the file, where frame 0 is at time 0; tracks that
do not fit that have the difference, and the exact period, as text in the group DEFSENSE.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...core.machine.optional_libraries import optional
from ...core.markers import Tracks
from ...core.storage.files import replacing
from .track_conversion import JITTER, FrameGrid, Labelled, frame_grid, labels_of, numbers_of

# What the first blocks of a C3D file promise, held against the length of the file.
#
# ezc3d reads as many frames as there are in a file that was cut, and says nothing; parameters whose
# sizes are wrong can crash it. Layout: the C3D user guide (c3d.org), "The header section" and "The
# parameter section".

_BLOCK = 512
_MAGIC = 0x50
_MOST_BLOCKS = 256
#: By the processor's number: order of bytes, and the byte of a float that has the sign.
_PROCESSORS = {84: ("<", 3), 85: ("<", 1), 86: (">", 0)}  # Intel, DEC, MIPS
#: Most frames that the header's 16 bits can count.
MOST_FRAMES = 65535


def check_whole(path: Path) -> None:
    """Raises CaptureError for a file that is no C3D file, or ends before its last frame."""
    try:
        with path.open("rb") as file:
            head = file.read(_BLOCK)
            if len(head) < _BLOCK or head[1] != _MAGIC or head[0] < 1:
                raise CaptureError(
                    f"{path}: is no C3D file (it does not begin like one)", code="not-a-c3d-file"
                )
            file.seek((head[0] - 1) * _BLOCK)
            parameters = file.read(_BLOCK * _MOST_BLOCKS)
            size = file.seek(0, 2)
    except OSError as error:
        raise CaptureError(
            f"{path}: cannot be read: {error.strerror}", code="file-unreadable"
        ) from None
    if len(parameters) < 4:
        raise CaptureError(
            f"{path}: is cut short before its parameters; copy it again", code="file-truncated"
        )
    if parameters[3] not in _PROCESSORS:
        raise CaptureError(
            f"{path}: is no C3D file (no processor has the number {parameters[3]})",
            code="not-a-c3d-file",
        )
    order, sign = _PROCESSORS[parameters[3]]
    if not _sound(parameters, order):
        raise CaptureError(
            f"{path}: its parameters are damaged; copy it again", code="file-damaged"
        )
    points, analog, first, last = struct.unpack(f"{order}4H", head[2:10])
    (start,) = struct.unpack(f"{order}H", head[16:18])
    width = 4 if head[12 + sign] & 0x80 else 2  # a negative scale stands for data stored as floats
    needed = max(last - first + 1, 0) * (4 * points + analog) * width
    there = max(size - (start - 1) * _BLOCK, 0)
    if there < needed:
        raise CaptureError(
            f"{path}: is cut short: frames {first} to {last} need {needed} bytes, and there are"
            f" {there}; copy it again",
            code="file-truncated",
            first=first,
            last=last,
            needed=needed,
        )


def _sound(data: bytes, order: str) -> bool:
    """Whether groups and parameters follow each other to the last, each with the bytes it says."""
    at, kinds = 4, (-1, 1, 2, 4)
    while at + 2 <= len(data):
        length, group = struct.unpack_from("2b", data, at)
        if length == 0 or group == 0:
            return True
        at += 2 + abs(length)
        if at + 4 > len(data):
            return False
        (step,) = struct.unpack_from(f"{order}H", data, at)
        if group > 0:
            (kind,) = struct.unpack_from("b", data, at + 2)
            shape = data[at + 4 : at + 4 + data[at + 3]]
            end = at + 4 + len(shape) + abs(kind) * math.prod(shape)
        else:
            kind, end = 1, at + 2
        # A text of description comes last, its length before it.
        if kind not in kinds or end >= len(data) or (step and end + 1 + data[end] > at + step):
            return False
        if step == 0:
            return True
        at += step
    return False


_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_GROUP = "DEFSENSE"
#: Parameters of POINT that list points which are no places (Vicon's manual of C3D).
_NO_PLACES = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "USERMOS")


def write_c3d(path: Path, tracks: Tracks) -> None:
    """Markers `tag_7` in mm, at the rate of the times. Raises CaptureError for tracks without
    markers, of irregular times, or of more frames than C3D counts."""
    ezc3d = _library(path)
    if not len(tracks.ids):
        raise CaptureError(f"{path}: there are no markers to write", code="markers-missing")
    grid = _grid(path, tracks.time)
    index, start, period = grid.index, grid.start, grid.period
    n, first = int(index[-1]) + 1, int(tracks.frame[0])
    if n > MOST_FRAMES:
        raise CaptureError(
            f"{path}: {n} frames from the first to the last are more than the {MOST_FRAMES} of C3D;"
            " write shorter pieces, or .csv, .npz or .parquet",
            code="too-many-frames",
            count=n,
        )
    if (tracks.frame != first + index).any() or first < 0 or first + n > MOST_FRAMES:
        first = 0
    points = np.full((4, len(tracks.ids), n), np.nan)
    points[3] = 1.0
    points[:3, :, index] = tracks.points.transpose(2, 1, 0)
    gone = np.isnan(points[0])

    file = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = first
    group = file["parameters"]["POINT"]
    group["RATE"]["value"] = [1 / period]
    group["UNITS"]["value"] = ["mm"]
    group["LABELS"]["value"] = labels_of(tracks.ids)
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = np.where(gone, -1.0, 0.0)[None]
    # As text, since the numbers of C3D have single precision.
    file.add_parameter(_GROUP, "OFFSET", [f"{start - first * period:.9f}"])
    file.add_parameter(_GROUP, "PERIOD", [f"{period:.15g}"])
    with replacing(path) as temporary:
        file.write(str(temporary))


def read_c3d(path: Path) -> Labelled:
    """All points that are places, in mm, sigma unknown. A point is missing where its residual is
    negative, and in files of others also where it is exactly (0, 0, 0). Numbers come from the
    labels. Raises CaptureError for what is no whole C3D file, has no markers, no rate, or another
    unit than m, cm and mm."""
    ezc3d = _library(path)
    check_whole(path)
    try:
        file = ezc3d.c3d(str(path))
    except Exception as error:  # whatever the C++ library throws
        raise CaptureError(
            f"{path}: cannot be read as C3D: {str(error)[:120]!r}", code="file-damaged"
        ) from None
    group, own = file["parameters"]["POINT"], file["parameters"].get(_GROUP, {})
    points = file["data"]["points"][:3].transpose(2, 1, 0)
    residual = file["data"]["meta_points"]["residuals"][0].T
    labels = [label.strip() for label in _strings(group, "LABELS")]
    labels = (labels + [""] * points.shape[1])[: points.shape[1]]
    other = {label.strip() for name in _NO_PLACES for label in _strings(group, name)}
    kept = np.array([i for i, label in enumerate(labels) if label not in other], np.int64)
    if not len(kept) or not len(points):
        raise CaptureError(
            f"{path}: has no markers ({points.shape[1]} points, {len(points)} frames)",
            code="markers-missing",
        )
    unit = (_strings(group, "UNITS") or [""])[0].strip()
    if unit.lower() not in _MM:
        raise CaptureError(
            f"{path}: the unit of its points (POINT:UNITS) is {unit!r}; it must be mm, cm or m",
            code="unknown-unit",
            unit=unit,
        )
    rate = float(np.ravel(group["RATE"]["value"])[0]) if len(group["RATE"]["value"]) else 0.0
    if not (np.isfinite(rate) and rate > 0):
        raise CaptureError(
            f"{path}: the rate of its points (POINT:RATE) is {rate:g}; it must be > 0",
            code="frame-rate-invalid",
            rate=rate,
        )

    points = points[:, kept] * _MM[unit.lower()]
    gone = (residual[:, kept] < 0) | np.isnan(points).any(-1)
    if not own:
        gone |= (points == 0).all(-1)
    points[gone] = np.nan
    period, offset = _times(own, rate)
    frame = int(file["header"]["points"]["first_frame"]) + np.arange(len(points))
    names = tuple(labels[i] for i in kept)
    time = np.asarray(offset + period * frame, float)
    tracks = Tracks(time, numbers_of(names), points, np.full_like(points, np.nan), frame)
    return Labelled(tracks, names)


def _grid(path: Path, time: Float) -> FrameGrid:
    """Where the frames are. Raises CaptureError for times that have no rate."""
    grid = frame_grid(time)
    if grid is None:
        raise CaptureError(
            f"{path}: {len(time)} frames have no rate, which C3D needs; write .csv",
            code="times-without-rate",
        )
    if not grid.even:
        worst = int(np.argmax(grid.off))
        raise CaptureError(
            f"{path}: the times are not regular, as C3D needs: at {1 / grid.period:.4g} frames/s,"
            f" that at {time[worst]:.6f} s is {100 * grid.off[worst]:.0f} % of a period off (at"
            f" most {100 * JITTER:.0f} %); write .csv, .npz, .parquet or .trc",
            code="times-uneven",
        )
    return grid


def _times(own: dict[str, Any], rate: float) -> tuple[float, float]:
    """The period and the time of frame 0, s; from the own group where it is there and agrees."""
    try:
        period, offset = (float(own[name]["value"][0]) for name in ("PERIOD", "OFFSET"))
    except (KeyError, IndexError, ValueError):
        return 1 / rate, 0.0
    # Another program that changed the rate left this as it was.
    return (period, offset) if abs(period * rate - 1) < 1e-6 else (1 / rate, offset)


def _strings(group: dict[str, Any], name: str) -> list[str]:
    """A list of texts, which goes on in NAME2, NAME3, ... past 255."""
    out: list[str] = []
    key, i = name, 1
    while key in group:
        out += [text for text in group[key]["value"] if isinstance(text, str)]
        i += 1
        key = f"{name}{i}"
    return out


def _library(path: Path) -> Any:
    with optional(CaptureError, path, "exchange"):
        import ezc3d
    return ezc3d
