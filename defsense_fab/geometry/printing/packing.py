"""Rectangles on as few plates as they need (maximal free rectangles, Jylaenki 2010)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import ceil

_Rectangle = tuple[float, float, float, float]  # x, y, width, depth
_CLOSE = 1e-9


@dataclass(frozen=True)
class Place:
    """The plate (from 0) on which a rectangle lies, its front left corner, mm, and whether it is
    turned by a right angle."""

    plate: int
    x: float
    y: float
    turned: bool


@dataclass
class _Plate:
    """What is free of a plate: rectangles as large as they can be, which may overlap."""

    free: list[_Rectangle]
    used: float = field(default=0.0)

    def best(self, wide: float, deep: float) -> tuple[tuple[float, ...], _Rectangle, bool] | None:
        """The place that leaves the shortest rest beside the rectangle, and nearest the front."""
        found = [
            ((min(w - a, h - b), max(w - a, h - b), y, x), (x, y, a, b), turned)
            for x, y, w, h in self.free
            for a, b, turned in ((wide, deep, False), (deep, wide, True))
            if a <= w + _CLOSE and b <= h + _CLOSE
        ]
        return min(found, key=lambda f: (f[0], f[2])) if found else None

    def take(self, placed: _Rectangle) -> None:
        x, y, w, h = placed
        left: list[_Rectangle] = []
        for fx, fy, fw, fh in self.free:
            apart = x >= fx + fw - _CLOSE or x + w <= fx + _CLOSE
            if apart or y >= fy + fh - _CLOSE or y + h <= fy + _CLOSE:
                left.append((fx, fy, fw, fh))
                continue
            left += [
                (fx, fy, x - fx, fh),
                (x + w, fy, fx + fw - x - w, fh),
                (fx, fy, fw, y - fy),
                (fx, y + h, fw, fy + fh - y - h),
            ]
        left = [r for r in left if r[2] > _CLOSE and r[3] > _CLOSE]
        self.free = [
            r
            for k, r in enumerate(left)
            if not any(
                _within(r, o) and (j < k or not _within(o, r)) for j, o in enumerate(left) if j != k
            )
        ]
        self.used += w * h


def _within(inner: _Rectangle, outer: _Rectangle) -> bool:
    return (
        inner[0] >= outer[0] - _CLOSE
        and inner[1] >= outer[1] - _CLOSE
        and inner[0] + inner[2] <= outer[0] + outer[2] + _CLOSE
        and inner[1] + inner[3] <= outer[1] + outer[3] + _CLOSE
    )


#: The orders in which rectangles are laid: the largest first, by one measure or another.
_ORDERS: tuple[Callable[[float, float], float], ...] = (
    lambda w, d: w * d,
    lambda w, d: max(w, d),
    lambda w, d: min(w, d),
    lambda w, d: w + d,
)


def pack(sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]) -> dict[str, Place]:
    """Places for rectangles (width, depth, mm) that each fit the bed: of several orders the one
    with the fewest plates, and of those the one whose last plate holds the least."""
    tried = [
        _laid(sorted(sizes, key=lambda n: (-order(*sizes[n]), n)), sizes, bed) for order in _ORDERS
    ]
    return min(tried, key=lambda t: (len(t[0]), t[0][-1].used if t[0] else 0.0))[1]


def _laid(
    names: list[str], sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]
) -> tuple[list[_Plate], dict[str, Place]]:
    plates: list[_Plate] = []
    out: dict[str, Place] = {}
    for name in names:
        for k in range(len(plates) + 1):
            if k == len(plates):
                plates.append(_Plate([(0.0, 0.0, *bed)]))
            found = plates[k].best(*sizes[name])
            if found is not None:
                _, placed, turned = found
                plates[k].take(placed)
                out[name] = Place(k, placed[0], placed[1], turned)
                break
    return plates, out


def least_plates(sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]) -> int:
    """The number of plates below which no arrangement gets, by the areas."""
    return ceil(sum(w * d for w, d in sizes.values()) / (bed[0] * bed[1]) - _CLOSE)
