"""Names of markers in the files of motion-capture systems."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Int
from ...core.errors import CaptureError
from ...core.tracks import Tracks


@dataclass(frozen=True)
class Labelled:
    """Tracks of m markers, and the `labels` (m) that the file has for them."""

    tracks: Tracks
    labels: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.labels) != len(self.tracks.ids):
            raise CaptureError(
                f"{len(self.tracks.ids)} markers cannot have {len(self.labels)} labels",
                code="labels-differ",
            )


def labels_of(ids: Int) -> list[str]:
    """The labels that tags (m,) get: `tag_7`."""
    return [f"tag_{number}" for number in ids.tolist()]


def numbers_of(labels: Sequence[str]) -> Int:
    """Numbers (m,) for labels: the digits at their ends where all have some and no two the same,
    else 0 to m - 1."""
    ends = [re.search(r"[0-9]{1,15}$", label) for label in labels]
    found = [int(end.group()) for end in ends if end]
    if len(set(found)) < len(labels):
        found = list(range(len(labels)))
    return np.array(found, np.int64)
