"""Read and write tracks as C3D, the files of motion-capture systems. ezc3d writes them.

C3D has one rate. Frames are written on a regular grid, and frames that the tracks do not have are
written without markers; positions are never interpolated. Times more than a tenth of a period off
the grid are refused; others are moved onto it. Frames count from 0 here and from 1 in the file,
where frame 0 is at time 0. For tracks that do not fit this, the difference and the exact period are
stored as text in the group DEFSENSE.

References:
    The C3D user guide (c3d.org), "The header section" and "The parameter section".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...core.machine.optional_libraries import optional
from ...core.markers import Tracks
from ...core.storage.files import replace_file
from .c3d_file import C3dFile, read_c3d_file
from .c3d_parameters import MAX_FRAMES, Parameters
from .length_units import LengthUnit, resolve_unit
from .marker_labels import marker_labels
from .track_conversion import MAX_JITTER, FrameGrid, frame_grid
from .track_file import TrackFile, labeled_tracks

_GROUP = "DEFSENSE"
#: Parameters of POINT that list points which are not positions (Vicon's manual of C3D).
_OTHER_POINTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "USERMOS")
_RATE_TOLERANCE = 1e-3  # relative, of two statements of a rate


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


def read_c3d(path: Path, unit: LengthUnit | None = None) -> TrackFile:
    """Read all points that are positions, without standard deviations.

    A point is absent where its residual is negative, and by the rule of `absent_markers`.

    Args:
        path: The file.
        unit: Unit of files that do not state a unit that is known.

    Raises:
        CaptureError: If the file is not a complete C3D file (see `read_c3d_file`), has no markers,
            no rate or no unit, or has two markers of one number.
    """
    file = read_c3d_file(path)
    parameters = file.parameters
    count = file.points.shape[1]
    labels = (parameters.texts("POINT", "LABELS") + [""] * count)[:count]
    others = {label for name in _OTHER_POINTS for label in parameters.texts("POINT", name)}
    columns = np.array([i for i, label in enumerate(labels) if label not in others], np.int64)
    if not len(columns) or not len(file.points):
        raise CaptureError(
            f"has no markers ({count} points, {len(file.points)} frames)",
            code="markers-missing",
            where=path,
            action="Choose a file that has markers",
        )
    stated = (parameters.texts("POINT", "UNITS") or [""])[0]
    scale = resolve_unit(stated, unit, path, "POINT:UNITS")
    rate, notes = _rate(path, file)
    period, offset = _clock(parameters, rate)
    points = file.points * scale if scale != 1 else file.points
    points[file.is_absent] = np.nan
    frame = file.first - 1 + np.arange(len(points))
    return labeled_tracks(
        path,
        np.asarray(offset + period * frame, float),
        frame,
        [labels[i] for i in columns],
        points[:, columns] if len(columns) < count else points,
        is_own=parameters.has_group(_GROUP),
        notes=notes,
    )


def _rate(path: Path, file: C3dFile) -> tuple[float, list[str]]:
    """Return the rate of the points, Hz, and a note where the header's differs."""
    rate = file.parameters.number("POINT", "RATE") or 0.0
    if not rate > 0 and not file.rate:
        raise CaptureError(
            f"the rate of its points (POINT:RATE) is {rate:g}",
            code="frame-rate-invalid",
            where=path,
            action="Export it with a rate above 0",
            rate=rate,
        )
    if not rate > 0:
        return file.rate, [f"has no POINT:RATE; the header's {file.rate:g} frames/s are used"]
    notes = []
    if file.rate and abs(file.rate / rate - 1) > _RATE_TOLERANCE:
        notes = [f"POINT:RATE is {rate:g} frames/s, which is used; the header has {file.rate:g}"]
    return rate, notes


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


def _clock(parameters: Parameters, rate: float) -> tuple[float, float]:
    """Return the period and the time of frame 0, s, from the own group if it agrees."""
    try:
        period, offset = (float(parameters.texts(_GROUP, name)[0]) for name in ("PERIOD", "OFFSET"))
    except (IndexError, ValueError):
        return 1 / rate, 0.0
    # A program that changed the rate left the own group as it was.
    return (period, offset) if abs(period * rate - 1) < 1e-6 else (1 / rate, offset)


def _library(path: Path) -> Any:
    with optional(CaptureError, path, "exchange"):
        import ezc3d
    return ezc3d
