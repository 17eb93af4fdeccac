"""The rule for the labels of markers in files of other programs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Int
from ...core.errors import CaptureError
from .absent_markers import list_some

#: Label of a tag: `tag_7`, with or without the subject's name as in `bar:tag_7`.
_TAG = re.compile(r"(?:.*[:.])?tag[_ -]?0*([0-9]{1,15})", re.IGNORECASE)
#: Labels of trajectories that nobody named: `*60` (Vicon, Qualisys), `Unlabeled 1001` (Motive),
#: and `name*1` for a further trajectory of a name.
_UNNAMED = re.compile(r"(?:.*:)?(?:.*\*[0-9]*|unlabell?ed[ _-]*[0-9]*|)", re.IGNORECASE)
_END_NUMBER = re.compile(r"[0-9]{1,15}$")


@dataclass(frozen=True)
class NumberedMarkers:
    """Markers of a file that are used, and their numbers.

    Attributes:
        columns: Indices (m,) of the used markers among the file's markers.
        ids: Numbers (m,) of these.
        notes: What was left out, or assumed.
        is_in_file_order: Whether the labels have no numbers, and the order of the file is used.
    """

    columns: Int
    ids: Int
    notes: tuple[str, ...] = ()
    is_in_file_order: bool = False


def marker_labels(ids: Int) -> list[str]:
    """Return the labels of markers (m,), such as `tag_7`."""
    return [f"tag_{number}" for number in ids.tolist()]


def number_markers(path: Path, labels: Sequence[str]) -> NumberedMarkers:
    """Choose the markers of a file by their labels, and number them.

    1. Where a label is `tag_N` or `subject:tag_N`, these markers have the numbers N, and all others
       are left out.
    2. Otherwise, if the labels end in different numbers, these are the markers' numbers, and
       trajectories without a name (`*60`, `name*1`, `Unlabeled 1001`) are left out.
    3. Otherwise markers are numbered from 0 in the order of the file.

    Args:
        path: The file.
        labels: Labels of all its markers; empty for markers without one.

    Raises:
        CaptureError: If two markers are the same tag (`marker-repeated`).
    """
    tags = {k: int(m[1]) for k, label in enumerate(labels) if (m := _TAG.fullmatch(label.strip()))}
    if tags:
        _require_different(path, labels, tags)
        return _use(labels, tags, "not named tag_N")
    ends = {
        k: int(m[0])
        for k, label in enumerate(labels)
        if not _UNNAMED.fullmatch(label.strip()) and (m := _END_NUMBER.search(label.strip()))
    }
    named = [k for k, label in enumerate(labels) if not _UNNAMED.fullmatch(label.strip())]
    if ends and len(set(ends.values())) == len(named):
        return _use(labels, ends, "without a name")
    numbers = np.arange(len(labels))
    order = list_some([f"{k} = {label or 'without a label'}" for k, label in enumerate(labels)])
    notes = (f"markers are numbered in the order of the file: {order}",) if len(labels) else ()
    return NumberedMarkers(numbers, numbers, notes, is_in_file_order=True)


def _require_different(path: Path, labels: Sequence[str], tags: dict[int, int]) -> None:
    """Raise an error if two labels are of the same tag."""
    first: dict[int, int] = {}
    for k, number in tags.items():
        if number in first:
            names = (labels[first[number]].strip(), labels[k].strip())
            raise CaptureError(
                f"markers {first[number] + 1} and {k + 1} are both tag {number}"
                f" ({names[0]!r} and {names[1]!r})",
                code="marker-repeated",
                where=path,
                action="Rename one of them, or export one subject",
                marker=number,
                labels=names,
            )
        first[number] = k


def _use(labels: Sequence[str], numbers: dict[int, int], reason: str) -> NumberedMarkers:
    """Return some markers of a file, and a note on the others."""
    others = [
        label.strip() or "without a label" for k, label in enumerate(labels) if k not in numbers
    ]
    are = " is" if len(others) == 1 else "s are"
    notes = (
        (f"{len(others)} marker{are} left out, {reason}: {list_some(others)}",) if others else ()
    )
    return NumberedMarkers(
        np.array(list(numbers), np.int64), np.array(list(numbers.values()), np.int64), notes
    )
