"""Whether a calibration still holds: new views of a board, and what they should look like."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...core.arrays import Bool, Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard
from ..tracking.alignment import align
from ..tracking.reconstruction import triangulate
from .intrinsics import board_pose

# Why a calibration does not hold: the board's size, the order of sources, a lens, or a move.

#: A board of another size, sources in another order, zoom or focus, a camera's place.
Kind = Literal["board", "order", "lens", "moved"]
_VIEWS = 4  # that two sources are compared by, before all views tell
_TRIED = 24  # orders at most that are compared by all views
_EXPLAINS = 0.5  # of the corners' error may be left, for a size that explains it


@dataclass(frozen=True)
class Cause:
    """`square`, mm, of the board by the cameras, where it is not as stated; `order` (v,), the
    source that belongs to each camera, where it is another one."""

    kind: Kind
    square: float | None = None
    order: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Diagnosis:
    """What was measured of the cameras of these `names` (v,), and the `cause` where the calibration
    does not hold."""

    names: tuple[str, ...]
    check: RigCheck
    cause: Cause | None = None


def diagnose(
    cameras: Sequence[Camera], board: CharucoBoard, instants: Sequence[Mapping[int, BoardView]]
) -> Diagnosis:
    """By the views of each instant by source, one for each camera. Raises CaptureError where there
    are none."""
    check, names = check_rig(cameras, board, instants), tuple(c.name for c in cameras)
    if check.holds:
        return Diagnosis(names, check)
    if _only_size(check):
        return Diagnosis(names, check, Cause("board", _square(board, check)))
    best, order = None, None
    for k, tried in enumerate(_orders(cameras, board, instants)):
        found = check_rig(cameras, board, _ordered(instants, tried))
        if found.fits and (best is None or found.scaled < best.scaled):
            best, order = found, tried
        if k + 1 == _TRIED:
            break
    if best is not None:
        square = _square(board, best) if _only_size(best) else None
        return Diagnosis(names, check, Cause("order", square, order))
    return Diagnosis(names, check, Cause("lens" if (check.own > FINE_PX).any() else "moved"))


def _only_size(check: RigCheck) -> bool:
    """Whether another size of the board explains what does not hold."""
    return not check.holds and check.fits and check.scaled < _EXPLAINS * check.length


def _square(board: CharucoBoard, check: RigCheck) -> float:
    return check.scale * board.scale * board.square


def _ordered(
    instants: Sequence[Mapping[int, BoardView]], order: Sequence[int]
) -> list[dict[int, BoardView]]:
    """The views by camera, where `order` has the source of each."""
    return [{c: s[k] for c, k in enumerate(order) if k in s} for s in instants]


def _orders(
    cameras: Sequence[Camera], board: CharucoBoard, instants: Sequence[Mapping[int, BoardView]]
) -> Iterator[tuple[int, ...]]:
    """Other orders of the sources, in which each two that saw the board together fit."""
    known: dict[tuple[int, int, int, int], bool] = {}

    def fit(c: int, d: int, a: int, b: int) -> bool:
        """Whether cameras c and d are the sources a and b."""
        if (c, d, a, b) not in known:
            both = [{0: s[a], 1: s[b]} for s in instants if a in s and b in s]
            some = both[:: -(-len(both) // _VIEWS)] if both else []
            known[c, d, a, b] = not some or check_rig([cameras[c], cameras[d]], board, some).fits
        return known[c, d, a, b]

    def further(order: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        d = len(order)
        if d == len(cameras):
            yield order
            return
        for b in range(len(cameras)):
            if b not in order and all(fit(c, d, a, b) for c, a in enumerate(order)):
                yield from further((*order, b))

    same = tuple(range(len(cameras)))
    yield from (order for order in further(()) if order != same)


#: px and mm within which a calibration holds.
FINE_PX, FINE_MM = 0.5, 0.3


@dataclass(frozen=True)
class RigCheck:
    """Of each camera alone, how far it sees corners from where its intrinsics say, `own` (v,) px;
    of several, how far they are apart, `together` px, and how far the board's corners are from
    where they are on the board, `length` mm (root mean squares; NaN where not seen); views used.
    `scale`: by the cameras, the board is so many times as large as stated, and its corners then
    `scaled` mm from their places (NaN where not known). `odd` (v,): cameras without which most of
    what they see fits the others."""

    own: Float
    together: float
    length: float
    boards: int
    scale: float
    scaled: float
    odd: Bool

    @property
    def holds(self) -> bool:
        """Whether measurements are as good as right after the calibration."""
        return self._agree and not self.length > FINE_MM

    @property
    def fits(self) -> bool:
        """Whether all fits a board of `scale` times the stated size."""
        return self._agree and not self.scaled > FINE_MM

    @property
    def _agree(self) -> bool:
        own = bool((self.own[np.isfinite(self.own)] <= FINE_PX).all())
        return own and not self.together > FINE_PX


def check_rig(
    cameras: Sequence[Camera], board: CharucoBoard, instants: Sequence[Mapping[int, BoardView]]
) -> RigCheck:
    """By the views of each instant by camera. Raises CaptureError where there are none."""
    if not instants:
        raise CaptureError(
            "the cameras never saw the board together; hold it where all of them see it",
            code="board-never-shared",
        )
    own: list[list[Float]] = [[] for _ in cameras]
    apart, placed = [], []
    left, several = [np.zeros(len(cameras), int)], [np.zeros(len(cameras), int)]
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
        # Those that disagree by more than can be located count as that, and so do those that are
        # located by leaving a camera out.
        there = np.isfinite(corners[:, :, 0, 0])
        out = there & ~found.used & found.used.any(axis=1, keepdims=True)
        left.append(out.sum(axis=0))
        several.append(there.sum(axis=0))
        seen = there.sum(axis=1) >= 2
        whole = np.isfinite(found.miss) & ~out.any(axis=1)
        apart.append(np.where(whole, found.miss, 2.0)[seen])
        points = found.points
        if np.isfinite(points[:, 0]).sum() >= 4:
            back = align(points[None], board.corners[ids])
            laid = np.isfinite(back.points[0, :, 0])
            if laid.any():
                pair = np.stack([back.points[0, laid], board.corners[ids[laid]]])
                placed.append(pair - pair.mean(axis=1, keepdims=True))
    shown, stated = np.concatenate([np.zeros((2, 0, 3)), *placed], axis=1)
    # The rotation that fits best is the same at every size: only the size is left to be found.
    scale = float((shown * stated).sum() / (stated**2).sum()) if len(stated) else float("nan")
    return RigCheck(
        np.array([_rms(np.concatenate([np.zeros(0), *m])) for m in own]),
        _rms(np.concatenate([np.zeros(0), *apart])),
        _rms(np.linalg.norm(shown - stated, axis=1)),
        len(instants),
        scale,
        _rms(np.linalg.norm(shown - scale * stated, axis=1)),
        np.sum(left, axis=0) > np.sum(several, axis=0) / 2,
    )


def _alone(camera: Camera, board: CharucoBoard, view: BoardView) -> Float:
    """Distances (k,) px of corners from those of the board where it fits best."""
    points = board.corners[view.ids]
    found = board_pose(camera, points, view.corners)
    if found is None:
        return np.full(len(points), np.inf)
    return np.asarray(np.linalg.norm(found[2] - view.corners, axis=1))


def _rms(values: Float) -> float:
    """NaN of none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
