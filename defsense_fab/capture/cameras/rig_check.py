"""Whether a calibration still holds: new views of a board, and what they should look like."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ..tags.board_detection import BoardView
from ..tags.charuco_board import CharucoBoard
from ..tracking.alignment import align
from ..tracking.triangulation import triangulate

#: px and mm within which a calibration holds.
FINE_PX, FINE_MM = 0.5, 0.3


@dataclass(frozen=True)
class RigCheck:
    """Of each camera alone, how far it sees corners from where its intrinsics say, `own` (v,) px;
    of several, how far they are apart, `together` px, and how far the board's corners are from
    where they are on the board, `length` mm (root mean squares; NaN where not seen); views used."""

    own: Float
    together: float
    length: float
    boards: int

    @property
    def holds(self) -> bool:
        """Whether measurements are as good as right after the calibration."""
        own = bool((self.own[np.isfinite(self.own)] <= FINE_PX).all())
        both = not self.together > FINE_PX and not self.length > FINE_MM
        return own and both


def check_rig(
    cameras: Sequence[Camera], board: CharucoBoard, instants: Sequence[Mapping[int, BoardView]]
) -> RigCheck:
    """By the views of each instant by camera. Raises CaptureError where there are none."""
    if not instants:
        raise CaptureError(
            "the cameras never saw the board together; hold it where all of them see it"
        )
    own: list[list[Float]] = [[] for _ in cameras]
    apart, lengths = [], []
    for views in instants:
        for c, view in views.items():
            own[c].append(_alone(cameras[c], board, view))
        if len(views) < 2:
            continue
        ids = np.unique(np.concatenate([v.ids for v in views.values()]))
        corners = np.full((len(ids), len(cameras), 4, 2), np.nan)
        for c, view in views.items():
            flat = cameras[c].to_plane(view.corners) * cameras[c].focal + cameras[c].matrix[:2, 2]
            corners[np.searchsorted(ids, view.ids), c] = flat[:, None]
        noise = np.tile(np.eye(2) * 0.01, (len(ids), len(cameras), 5, 1, 1))
        found = triangulate(cameras, corners, noise)
        # Those that disagree by more than can be located count as that.
        seen = np.isfinite(corners[:, :, 0, 0]).sum(axis=1) >= 2
        apart.append(np.where(np.isfinite(found.miss[seen]), found.miss[seen], 2.0))
        points = found.points
        if np.isfinite(points[:, 0]).sum() >= 4:
            back = align(points[None], board.corners[ids])
            gap = back.points[0] - board.corners[ids]
            lengths.append(np.linalg.norm(gap[np.isfinite(gap[:, 0])], axis=1))
    return RigCheck(
        np.array([_rms(np.concatenate(m)) if m else np.nan for m in own]),
        _rms(np.concatenate(apart)) if apart else float("nan"),
        _rms(np.concatenate(lengths)) if lengths else float("nan"),
        len(instants),
    )


def _alone(camera: Camera, board: CharucoBoard, view: BoardView) -> Float:
    """Distances (k,) px of corners from those of the board where it fits best."""
    points = board.corners[view.ids]
    _, r, t = cv2.solvePnP(points, view.corners, camera.matrix, camera.distortions)
    shown, _ = cv2.projectPoints(points, r, t, camera.matrix, camera.distortions)
    return np.asarray(np.linalg.norm(np.asarray(shown).reshape(-1, 2) - view.corners, axis=1))


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))
