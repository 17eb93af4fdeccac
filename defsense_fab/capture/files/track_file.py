"""A file of tracks as it was read: its tracks, and what the reader left out or assumed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.markers import Tracks
from .absent_markers import hide_absent
from .marker_labels import number_markers


@dataclass(frozen=True)
class TrackFile:
    """Tracks of a file.

    Attributes:
        tracks: The tracks.
        labels: Labels of the tracks' markers in the file; empty for formats with numbers.
        notes: What was left out or assumed.
        is_in_file_order: Whether the labels have no numbers, and markers are numbered in the order
            of the file.
    """

    tracks: Tracks
    labels: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    is_in_file_order: bool = False


def labeled_tracks(
    path: Path,
    time: Float,
    frame: Int,
    labels: Sequence[str],
    points: Float,
    *,
    is_own: bool,
    notes: Sequence[str] = (),
) -> TrackFile:
    """Return the tracks of labeled markers, without standard deviations.

    Args:
        path: The file.
        time: Times of the frames (t,), s.
        frame: Numbers of the frames (t,).
        labels: Labels of the m markers.
        points: Positions (t, m, 3), mm.
        is_own: Whether this package wrote the file, so that 0, 0, 0 is a position.
        notes: What the reader left out or assumed.

    Raises:
        CaptureError: If two markers are the same tag (`marker-repeated`), or times do not increase.
    """
    numbered = number_markers(path, labels)
    used = [labels[k].strip() for k in numbered.columns.tolist()]
    points, absent = hide_absent(points[:, numbered.columns], used, is_own=is_own)
    tracks = Tracks(time, numbered.ids, points, np.full_like(points, np.nan), frame)
    return TrackFile(
        tracks, tuple(used), (*notes, *numbered.notes, *absent), numbered.is_in_file_order
    )
