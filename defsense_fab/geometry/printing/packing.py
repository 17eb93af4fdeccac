"""Pack rectangles on as few plates as possible (maximal free rectangles, Jylaenki 2010)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import ceil

_Rectangle = tuple[float, float, float, float]  # x, y, width, depth
TOLERANCE_MM = 1e-9


@dataclass(frozen=True)
class PlatePlace:
    """A place of a rectangle.

    Attributes:
        plate: The plate, counted from 0.
        x: Left edge, mm.
        y: Front edge, mm.
        turned: Whether the rectangle is turned by a right angle.
    """

    plate: int
    x: float
    y: float
    turned: bool


@dataclass(frozen=True)
class _Strategy:
    """A packing strategy: the order of rectangles, the preferred place (by its corner, and what it
    leaves next to and behind it), and whether rectangles are turned when they need not be.
    """

    order: Callable[[float, float], float]
    rule: Callable[[float, float, float, float], tuple[float, ...]]
    turning: bool


@dataclass
class _Plate:
    """The free space of a plate: rectangles as large as possible, which may overlap."""

    free: list[_Rectangle]
    used: float = field(default=0.0)

    def find_best(
        self, width: float, depth: float, strategy: _Strategy
    ) -> tuple[_Rectangle, bool] | None:
        """Return the place that a rule prefers, as it is or turned."""
        options = [
            ((*strategy.rule(x, y, w - a, h - b), y, x), turned, (x, y, a, b))
            for x, y, w, h in self.free
            for a, b, turned in ((width, depth, False), (depth, width, True))
            if a <= w + TOLERANCE_MM and b <= h + TOLERANCE_MM
            # Without turning, only rectangles that must be turned are.
            if strategy.turning
            or not turned
            or width > w + TOLERANCE_MM
            or depth > h + TOLERANCE_MM
        ]
        if not options:
            return None
        _, turned, placed = min(options)
        return placed, turned

    def take(self, placed: _Rectangle) -> None:
        """Remove a rectangle from the free space."""
        x, y, w, h = placed
        rest: list[_Rectangle] = []
        for fx, fy, fw, fh in self.free:
            is_apart = x >= fx + fw - TOLERANCE_MM or x + w <= fx + TOLERANCE_MM
            if is_apart or y >= fy + fh - TOLERANCE_MM or y + h <= fy + TOLERANCE_MM:
                rest.append((fx, fy, fw, fh))
                continue
            rest += [
                (fx, fy, x - fx, fh),
                (x + w, fy, fx + fw - x - w, fh),
                (fx, fy, fw, y - fy),
                (fx, y + h, fw, fy + fh - y - h),
            ]
        rest = [r for r in rest if r[2] > TOLERANCE_MM and r[3] > TOLERANCE_MM]
        self.free = [
            r
            for k, r in enumerate(rest)
            if not any(
                _within(r, o) and (j < k or not _within(o, r)) for j, o in enumerate(rest) if j != k
            )
        ]
        self.used += w * h


def _within(inner: _Rectangle, outer: _Rectangle) -> bool:
    return (
        inner[0] >= outer[0] - TOLERANCE_MM
        and inner[1] >= outer[1] - TOLERANCE_MM
        and inner[0] + inner[2] <= outer[0] + outer[2] + TOLERANCE_MM
        and inner[1] + inner[3] <= outer[1] + outer[3] + TOLERANCE_MM
    )


#: Orders of rectangles: the largest first, by several measures.
_ORDERS: tuple[Callable[[float, float], float], ...] = (
    lambda w, d: w * d,
    lambda w, d: max(w, d),
    lambda w, d: min(w, d),
    lambda w, d: w + d,
)
#: Preferred places: the shortest rest, the shortest long rest, the front left corner.
_RULES: tuple[Callable[[float, float, float, float], tuple[float, ...]], ...] = (
    lambda _x, _y, w, h: (min(w, h), max(w, h)),
    lambda _x, _y, w, h: (max(w, h), min(w, h)),
    lambda x, y, _w, _h: (y + x, x),
)
_STRATEGIES = tuple(_Strategy(o, r, t) for t in (True, False) for r in _RULES for o in _ORDERS)
MAX_THOROUGH = 80  # with more rectangles only the first strategies are used


def pack(
    sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]
) -> dict[str, PlatePlace]:
    """Pack rectangles that each fit the bed.

    Args:
        sizes: Width and depth of each rectangle, mm.
        bed: Width and depth of the bed, mm.

    Returns:
        Places by the strategy with the fewest plates, and of those with the least on the last
        plate.
    """
    lower_bound = _plates_by_area(sizes, bed)
    best: tuple[tuple[int, float], dict[str, PlatePlace]] = ((0, 0.0), {})
    for k, strategy in enumerate(
        _STRATEGIES if len(sizes) <= MAX_THOROUGH else _STRATEGIES[: len(_ORDERS)]
    ):
        plates, places = _pack_with(sizes, bed, strategy)
        score = (len(plates), plates[-1].used if plates else 0.0)
        if k == 0 or score < best[0]:
            best = (score, places)
        if best[0][0] <= lower_bound:
            break
    return best[1]


def _pack_with(
    sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float], strategy: _Strategy
) -> tuple[list[_Plate], dict[str, PlatePlace]]:
    plates: list[_Plate] = []
    out: dict[str, PlatePlace] = {}
    for name in sorted(sizes, key=lambda n: (-strategy.order(*sizes[n]), n)):
        for k in range(len(plates) + 1):
            if k == len(plates):
                plates.append(_Plate([(0.0, 0.0, *bed)]))
            place = plates[k].find_best(*sizes[name], strategy)
            if place is not None:
                placed, turned = place
                plates[k].take(placed)
                out[name] = PlatePlace(k, placed[0], placed[1], turned)
                break
    return plates, out


def count_least_plates(sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]) -> int:
    """Return a number of plates below which no arrangement gets.

    It follows from the areas, and from the rectangles of which no two lie on one plate.
    """
    large = [size for size in sizes.values() if _exceeds_half(size, bed)]
    return max(_plates_by_area(sizes, bed), len(large))


def _plates_by_area(sizes: Mapping[str, tuple[float, float]], bed: tuple[float, float]) -> int:
    return ceil(sum(w * d for w, d in sizes.values()) / (bed[0] * bed[1]) - TOLERANCE_MM)


def _exceeds_half(size: tuple[float, float], bed: tuple[float, float]) -> bool:
    """Whether a rectangle takes more than half of the bed's width and of its depth, in each
    orientation in which it fits.
    """
    (width, depth), (w, d) = bed, size
    orientations = [
        (a, b)
        for a, b in ((w, d), (d, w))
        if a <= width + TOLERANCE_MM and b <= depth + TOLERANCE_MM
    ]
    return all(
        a > width / 2 + TOLERANCE_MM and b > depth / 2 + TOLERANCE_MM for a, b in orientations
    )
