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


@dataclass(frozen=True)
class _Way:
    """A way of laying: the order, what is liked of a place (its corner, and what it leaves beside
    and behind), and whether rectangles are turned where they need not be."""

    order: Callable[[float, float], float]
    rule: Callable[[float, float, float, float], tuple[float, ...]]
    turning: bool


@dataclass
class _Plate:
    """What is free of a plate: rectangles as large as they can be, which may overlap."""

    free: list[_Rectangle]
    used: float = field(default=0.0)

    def best(self, wide: float, deep: float, way: _Way) -> tuple[_Rectangle, bool] | None:
        """The place that a rule likes best, as it is or turned."""
        found = [
            ((*way.rule(x, y, w - a, h - b), y, x), turned, (x, y, a, b))
            for x, y, w, h in self.free
            for a, b, turned in ((wide, deep, False), (deep, wide, True))
            if a <= w + _CLOSE and b <= h + _CLOSE
            # Turned only where it must be, if the way is so.
            if way.turning or not turned or wide > w + _CLOSE or deep > h + _CLOSE
        ]
        if not found:
            return None
        _, turned, placed = min(found)
        return placed, turned

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
#: What is liked of a place: the shortest rest, the shortest long rest, the front left corner.
_RULES: tuple[Callable[[float, float, float, float], tuple[float, ...]], ...] = (
    lambda _x, _y, w, h: (min(w, h), max(w, h)),
    lambda _x, _y, w, h: (max(w, h), min(w, h)),
    lambda x, y, _w, _h: (y + x, x),
)
_WAYS = tuple(_Way(o, r, t) for t in (True, False) for r in _RULES for o in _ORDERS)
_MANY = 80  # rectangles, for which only the first ways are tried


def pack(sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]) -> dict[str, Place]:
    """Places for rectangles (width, depth, mm) that each fit the bed: of several ways of laying
    the one with the fewest plates, and of those the one whose last plate holds the least."""
    least = _by_areas(sizes, bed)
    best: tuple[tuple[int, float], dict[str, Place]] = ((0, 0.0), {})
    for k, way in enumerate(_WAYS if len(sizes) <= _MANY else _WAYS[: len(_ORDERS)]):
        plates, places = _laid(sizes, bed, way)
        found = (len(plates), plates[-1].used if plates else 0.0)
        if k == 0 or found < best[0]:
            best = (found, places)
        if best[0][0] <= least:
            break
    return best[1]


def _laid(
    sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float], way: _Way
) -> tuple[list[_Plate], dict[str, Place]]:
    plates: list[_Plate] = []
    out: dict[str, Place] = {}
    for name in sorted(sizes, key=lambda n: (-way.order(*sizes[n]), n)):
        for k in range(len(plates) + 1):
            if k == len(plates):
                plates.append(_Plate([(0.0, 0.0, *bed)]))
            found = plates[k].best(*sizes[name], way)
            if found is not None:
                placed, turned = found
                plates[k].take(placed)
                out[name] = Place(k, placed[0], placed[1], turned)
                break
    return plates, out


def least_plates(sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]) -> int:
    """A number of plates below which no arrangement gets, by the areas and by the rectangles of
    which no two lie on one plate."""
    wide = [size for size in sizes.values() if _more_than_half(size, bed)]
    return max(_by_areas(sizes, bed), len(wide))


def _by_areas(sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]) -> int:
    return ceil(sum(w * d for w, d in sizes.values()) / (bed[0] * bed[1]) - _CLOSE)


def _more_than_half(size: tuple[float, float], bed: tuple[float, float]) -> bool:
    """Whether a rectangle takes more than half of the bed's width and of its depth, as it is and
    turned, where it fits so."""
    (width, depth), (w, d) = bed, size
    ways = [(a, b) for a, b in ((w, d), (d, w)) if a <= width + _CLOSE and b <= depth + _CLOSE]
    return all(a > width / 2 + _CLOSE and b > depth / 2 + _CLOSE for a, b in ways)
