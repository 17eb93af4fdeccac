"""Which joint each stretch of a cord or wire lies in, and which joints draw it together later."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths
from ...core.mesh import Surface
from ..kernels.surface_queries import signed_distance_of

# The end of a cord that is crimped when its channel is closed: it is pulled out of its mouth.

#: Of a cord that has to be held or cut to length outside of its mouth, mm.
_ROOM = 5.0


def reach(ferrule: float, lead: float) -> float:
    """How far outside of its mouth the middle of a ferrule of this length must be for it to be
    crimped, mm; `lead` is how far outside it stays."""
    return max(ferrule / 2 + _ROOM, lead)


def pulled(between: float, loose: float, pocket: float, ferrule: float, lead: float) -> float:
    """By how much of its length a cord is stretched then, of which so many mm lie `between` its
    ferrules in the device and are as long when `loose`; the end's `pocket`, 0 for none, in mm."""
    inside = pocket - ferrule / 2 if pocket else -lead
    return (between + inside + reach(ferrule, lead)) / loose - 1


_STEP = 0.5  # mm, between the places that are asked
_BESIDE = (0.3, 0.9, 1.8)  # mm beyond the channel's wall, where parts are looked for
_SHORT = 1.5  # mm; shorter stretches are noise where three parts meet, but for a joint's only one

#: The two groups of parts, by index, that a joint brings together.
Sides = tuple[frozenset[int], frozenset[int]]


@dataclass(frozen=True)
class Stretch:
    """From `start` to `stop` (mm along the line) it lies in a `joint`, between two parts."""

    joint: int
    parts: tuple[int, int]
    start: float
    stop: float


def stretches(
    line: Float,
    normal: Float,
    radius: float,
    parts: Sequence[Surface],
    joints: Sequence[Sides],
    within: Sequence[int],
) -> tuple[Stretch, ...]:
    """Of a line (p, 3) mm, the middle of a channel of `radius` mm in a plane of this `normal` (3,):
    its stretches in the joints `within` (indices of `joints`), from its start on. Empty where it
    lies in none."""
    at = arc_lengths(line)
    if len(within) == 1:
        low, high = joints[within[0]]
        return (Stretch(within[0], (min(low), min(high)), 0.0, float(at[-1])),)
    places = np.linspace(0, at[-1], max(2, int(at[-1] / _STEP) + 1))
    points = np.stack([np.interp(places, at, line[:, k]) for k in range(3)], axis=1)
    beside = [
        [_nearest(points + sign * (radius + far) * normal, parts) for far in _BESIDE]
        for sign in (-1, 1)
    ]
    found: list[tuple[int, tuple[int, int]] | None] = []
    for k in range(len(points)):
        pairs = ((int(a[k]), int(b[k])) for a, b in zip(*beside, strict=True))
        found.append(next((f for f in (_joint(p, joints, within) for p in pairs) if f), None))
    return tuple(_merged(_filled(found), places))


def _nearest(points: Float, parts: Sequence[Surface]) -> Float:
    """The part (n,) that each point (n, 3) is deepest in, or else nearest to."""
    return np.asarray(np.argmax([signed_distance_of(part)(points) for part in parts], axis=0))


def _joint(
    pair: tuple[int, int], joints: Sequence[Sides], within: Sequence[int]
) -> tuple[int, tuple[int, int]] | None:
    a, b = pair
    for j in within:
        low, high = joints[j]
        if (a in low and b in high) or (b in low and a in high):
            return j, pair
    return None


def _filled(
    found: Sequence[tuple[int, tuple[int, int]] | None],
) -> list[tuple[int, tuple[int, int]]]:
    """Places that tell nothing are as those before them, or behind."""
    known = [k for k, f in enumerate(found) if f]
    out = []
    for k in range(len(found)):
        if not known:
            return []
        last = max((n for n in known if n <= k), default=known[0])
        out.append(found[last])
    return [f for f in out if f]


def _merged(found: Sequence[tuple[int, tuple[int, int]]], places: Float) -> Iterator[Stretch]:
    """Runs of the same joint, without the crumbs between them."""
    runs: list[list[int]] = []
    for k, (joint, _) in enumerate(found):
        if runs and found[runs[-1][0]][0] == joint:
            runs[-1].append(k)
        else:
            runs.append([k])
    whole = [r for r in runs if places[r[-1]] - places[r[0]] >= _SHORT]
    sure = {found[r[0]][0] for r in whole}
    kept: list[list[int]] = []
    for run in (r for r in runs if r in whole or found[r[0]][0] not in sure):
        if kept and found[kept[-1][0]][0] == found[run[0]][0]:
            kept[-1] += run
        else:
            kept.append(list(run))
    for n, run in enumerate(kept):
        joint, pair = found[run[len(run) // 2]]
        start = 0.0 if n == 0 else float(places[run[0]])
        stop = float(places[-1] if n == len(kept) - 1 else places[kept[n + 1][0]])
        yield Stretch(joint, pair, start, stop)


def find_late_joints(found: Sequence[Stretch], joints: Sequence[Sides]) -> list[tuple[int, int]]:
    """Where a cord is drawn together only after it was laid: (joint, k) for each joint that is
    closed later than those of the stretches k - 1 and k, and brings their parts together. Joints
    are closed in their order."""
    out = []
    for k in range(1, len(found)):
        before, behind = found[k - 1], found[k]
        for j in range(max(before.joint, behind.joint) + 1, len(joints)):
            low, high = joints[j]
            one, two = set(before.parts), set(behind.parts)
            if (one <= low and two <= high) or (one <= high and two <= low):
                out.append((j, k))
    return out
