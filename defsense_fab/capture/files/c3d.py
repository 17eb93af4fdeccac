"""Read and write C3D, the files of motion-capture systems, with ezc3d.

C3D has one rate. Frames are written on a regular grid, and frames that the tracks do not have are
written without markers; positions are never interpolated. Times more than a tenth of a period off
the grid are refused; others are moved onto it. Frames count from 0 here and from 1 in the file,
where frame 0 is at time 0. For tracks that do not fit this, the difference and the exact period are
stored as text in the group DEFSENSE.

References:
    The C3D user guide (c3d.org), "The header section" and "The parameter section".
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
from ...core.storage.files import replace_file
from .track_conversion import (
    MAX_JITTER,
    FrameGrid,
    frame_grid,
    marker_labels,
    marker_numbers,
)
from .tracks_csv import unreadable_error

BLOCK_BYTES = 512
MAX_PARAMETER_BLOCKS = 256
MAX_FRAMES = 65535  # that the header's 16 bits can count
_MAGIC = 0x50
#: By the processor's number: byte order, and the byte of a float that holds the sign.
_PROCESSORS = {84: ("<", 3), 85: ("<", 1), 86: (">", 0)}  # Intel, DEC, MIPS
_MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_GROUP = "DEFSENSE"
#: Parameters of POINT that list points which are not positions (Vicon's manual of C3D).
_OTHER_POINTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "USERMOS")


def write_c3d(path: Path, tracks: Tracks) -> None:
    """Write markers in mm, labeled such as `tag_7`, at the rate of the times.

    Raises:
        CaptureError: If there are no markers, times are irregular, or there are more frames than
            C3D can count.
        StorageError: If the file cannot be written.
    """
    ezc3d = _library(path)
    if not len(tracks.ids):
        raise CaptureError(
            "there are no markers to write",
            code="markers-missing",
            where=path,
            action="Choose tracks that have markers",
        )
    grid = _even_grid(path, tracks.time)
    index, start, period = grid.index, grid.start, grid.period
    n, first = int(index[-1]) + 1, int(tracks.frame[0])
    if n > MAX_FRAMES:
        raise CaptureError(
            f"{n} frames from the first to the last are more than the {MAX_FRAMES} of C3D",
            code="too-many-frames",
            where=path,
            action="Write shorter pieces, or .csv, .npz or .parquet",
            count=n,
        )
    if (tracks.frame != first + index).any() or first < 0 or first + n > MAX_FRAMES:
        first = 0
    points = np.full((4, len(tracks.ids), n), np.nan)
    points[3] = 1.0
    points[:3, :, index] = tracks.points.transpose(2, 1, 0)
    is_missing = np.isnan(points[0])

    file = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = first
    group = file["parameters"]["POINT"]
    group["RATE"]["value"] = [1 / period]
    group["UNITS"]["value"] = ["mm"]
    group["LABELS"]["value"] = marker_labels(tracks.ids)
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = np.where(is_missing, -1.0, 0.0)[None]
    # As text, because the numbers of C3D have single precision.
    file.add_parameter(_GROUP, "OFFSET", [f"{start - first * period:.9f}"])
    file.add_parameter(_GROUP, "PERIOD", [f"{period:.15g}"])
    with replace_file(path) as temporary:
        file.write(str(temporary))


def read_c3d(path: Path) -> Tracks:
    """Read all points that are positions, in mm, without standard deviations.

    A point is missing where its residual is negative, and in files of other programs also where it
    is exactly (0, 0, 0). Marker numbers come from the labels.

    Raises:
        CaptureError: If the file is not a complete C3D file, has no markers or no rate, or has a
            unit other than m, cm and mm.
    """
    ezc3d = _library(path)
    _check_complete(path)
    try:
        file = ezc3d.c3d(str(path))
    except Exception as error:  # whatever the C++ library throws
        raise CaptureError(
            f"cannot be read as C3D: {str(error)[:120]!r}",
            code="file-damaged",
            where=path,
            action="Copy or export it again",
        ) from None
    group, own_group = file["parameters"]["POINT"], file["parameters"].get(_GROUP, {})
    points = file["data"]["points"][:3].transpose(2, 1, 0)
    residual = file["data"]["meta_points"]["residuals"][0].T
    labels = [label.strip() for label in _texts(group, "LABELS")]
    labels = (labels + [""] * points.shape[1])[: points.shape[1]]
    others = {label.strip() for name in _OTHER_POINTS for label in _texts(group, name)}
    columns = np.array([i for i, label in enumerate(labels) if label not in others], np.int64)
    if not len(columns) or not len(points):
        raise CaptureError(
            f"has no markers ({points.shape[1]} points, {len(points)} frames)",
            code="markers-missing",
            where=path,
            action="Choose a file that has markers",
        )
    scale, rate = _scale(path, group), _rate(path, group)
    points = points[:, columns] * scale
    is_missing = (residual[:, columns] < 0) | np.isnan(points).any(-1)
    if not own_group:
        is_missing |= (points == 0).all(-1)
    points[is_missing] = np.nan
    period, offset = _clock(own_group, rate)
    frame = int(file["header"]["points"]["first_frame"]) + np.arange(len(points))
    ids = marker_numbers([labels[i] for i in columns])
    time = np.asarray(offset + period * frame, float)
    return Tracks(time, ids, points, np.full_like(points, np.nan), frame)


def _scale(path: Path, group: dict[str, Any]) -> float:
    """Return mm per unit of the points."""
    unit = (_texts(group, "UNITS") or [""])[0].strip()
    if unit.lower() not in _MM_PER_UNIT:
        raise CaptureError(
            f"the unit of its points (POINT:UNITS) is {unit!r}",
            code="unknown-unit",
            where=path,
            action="Export it in mm, cm or m",
            unit=unit,
        )
    return _MM_PER_UNIT[unit.lower()]


def _rate(path: Path, group: dict[str, Any]) -> float:
    """Return the rate of the points, Hz."""
    rate = float(np.ravel(group["RATE"]["value"])[0]) if len(group["RATE"]["value"]) else 0.0
    if not (np.isfinite(rate) and rate > 0):
        raise CaptureError(
            f"the rate of its points (POINT:RATE) is {rate:g}",
            code="frame-rate-invalid",
            where=path,
            action="Export it with a rate above 0",
            rate=rate,
        )
    return rate


def _even_grid(path: Path, time: Float) -> FrameGrid:
    """Return the grid of times (t,), s; irregular times raise CaptureError."""
    grid = frame_grid(time)
    if grid is None:
        raise CaptureError(
            f"{len(time)} frames have no rate, which C3D needs",
            code="times-without-rate",
            where=path,
            action="Write .csv",
        )
    if not grid.is_even:
        worst = int(np.argmax(grid.deviation))
        raise CaptureError(
            f"the times are not regular, as C3D needs: at {1 / grid.period:.4g} frames/s, the"
            f" frame at {time[worst]:.6f} s is {100 * grid.deviation[worst]:.0f} % of a period off"
            f" (limit {100 * MAX_JITTER:.0f} %)",
            code="times-uneven",
            where=path,
            action="Write .csv, .npz, .parquet or .trc",
        )
    return grid


def _clock(own_group: dict[str, Any], rate: float) -> tuple[float, float]:
    """Return the period and the time of frame 0, s, from the own group if it agrees."""
    try:
        period, offset = (float(own_group[name]["value"][0]) for name in ("PERIOD", "OFFSET"))
    except (KeyError, IndexError, ValueError):
        return 1 / rate, 0.0
    # A program that changed the rate left the own group as it was.
    return (period, offset) if abs(period * rate - 1) < 1e-6 else (1 / rate, offset)


def _texts(group: dict[str, Any], name: str) -> list[str]:
    """Return a list of texts, which continues in NAME2, NAME3, ... after 255."""
    texts: list[str] = []
    key, i = name, 1
    while key in group:
        texts += [text for text in group[key]["value"] if isinstance(text, str)]
        i += 1
        key = f"{name}{i}"
    return texts


def _check_complete(path: Path) -> None:
    """Check that the file is as long as its header states.

    ezc3d reads a truncated file without a warning, and parameters with wrong sizes can crash it.

    Raises:
        CaptureError: If the file is not a C3D file, or ends before its last frame.
    """
    head, parameters, size = _read_header(path)
    if len(parameters) < 4:
        raise CaptureError(
            "ends before its parameters",
            code="file-truncated",
            where=path,
            action="Copy it again",
        )
    if parameters[3] not in _PROCESSORS:
        raise CaptureError(
            f"is not a C3D file (there is no processor type {parameters[3]})",
            code="not-a-c3d-file",
            where=path,
            action="Choose another file",
        )
    order, sign = _PROCESSORS[parameters[3]]
    if not _has_sound_parameters(parameters, order):
        raise CaptureError(
            "its parameters are damaged", code="file-damaged", where=path, action="Copy it again"
        )
    points, analog, first, last = struct.unpack(f"{order}4H", head[2:10])
    (start,) = struct.unpack(f"{order}H", head[16:18])
    width = 4 if head[12 + sign] & 0x80 else 2  # a negative scale means data stored as floats
    needed = max(last - first + 1, 0) * (4 * points + analog) * width
    available = max(size - (start - 1) * BLOCK_BYTES, 0)
    if available < needed:
        raise CaptureError(
            f"is truncated: frames {first} to {last} need {needed} bytes, but it has {available}",
            code="file-truncated",
            where=path,
            action="Copy it again",
            first=first,
            last=last,
            needed=needed,
        )


def _read_header(path: Path) -> tuple[bytes, bytes, int]:
    """Return the header, the parameters, and the size of the file."""
    try:
        with path.open("rb") as file:
            head = file.read(BLOCK_BYTES)
            if len(head) < BLOCK_BYTES or head[1] != _MAGIC or head[0] < 1:
                raise CaptureError(
                    "is not a C3D file (it does not start like one)",
                    code="not-a-c3d-file",
                    where=path,
                    action="Choose another file",
                )
            file.seek((head[0] - 1) * BLOCK_BYTES)
            parameters = file.read(BLOCK_BYTES * MAX_PARAMETER_BLOCKS)
            return head, parameters, file.seek(0, 2)
    except OSError as error:
        raise unreadable_error(path, error) from None


def _has_sound_parameters(data: bytes, order: str) -> bool:
    """Return whether groups and parameters follow each other to the last, with the stated sizes."""
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
        # A description comes last, preceded by its length.
        if kind not in kinds or end >= len(data) or (step and end + 1 + data[end] > at + step):
            return False
        if step == 0:
            return True
        at += step
    return False


def _library(path: Path) -> Any:
    with optional(CaptureError, path, "exchange"):
        import ezc3d
    return ezc3d
