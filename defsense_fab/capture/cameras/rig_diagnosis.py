"""Why a calibration does not hold: the board's size, the order of sources, a lens, or a move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ...core.camera import Camera
from ..tags.board_detection import BoardView
from ..tags.charuco_board import CharucoBoard
from .rig_check import FINE_PX, RigCheck, check_rig

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
