"""Find which joint each stretch of a cord lies in, and which joints strain it during assembly.

A cord whose channel is closed is crimped outside its mouth: it is pulled out for that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths
from ...core.mesh import Surface
from ..kernels.surface_queries import signed_distance_of

#: Length of cord outside its mouth that is needed to hold it or cut it to length.
HOLDING_LENGTH_MM = 5.0


def crimping_reach(ferrule: float, lead: float) -> float:
    """Return how far outside its mouth the middle of a ferrule must be to be crimped, mm.

    Args:
        ferrule: Length of the ferrule, mm.
        lead: How far outside the mouth it stays, mm.
    """
    return max(ferrule / 2 + HOLDING_LENGTH_MM, lead)


def crimping_strain(
    between: float, loose: float, pocket: float, ferrule: float, lead: float
) -> float:
    """Return the strain of a cord while it is crimped outside its mouth.

    Args:
        between: Length between the ferrules in the device, mm.
        loose: The same length of the slack cord, mm.
        pocket: Length of the end's pocket, mm; 0 for none.
        ferrule: Length of the ferrule, mm.
        lead: How far outside the mouth the ferrule stays, mm.
    """
    inside = pocket - ferrule / 2 if pocket else -lead
    return (between + inside + crimping_reach(ferrule, lead)) / loose - 1


PROBE_STEP_MM = 0.5  # between probed places
PROBE_DISTANCES_MM = (0.3, 0.9, 1.8)  # beyond the channel's wall
MIN_STRETCH_MM = (
    1.5  # shorter stretches are noise where three parts meet, unless they are a joint's only one
)

#: The two groups of parts, by index, that a joint brings together.
JointSides = tuple[frozenset[int], frozenset[int]]


@dataclass(frozen=True)
class Stretch:
    """A stretch of a cord in one joint.

    Attributes:
        joint: Index of the joint.
        parts: The two parts on both sides.
        start: Start along the line, mm.
        stop: End along the line, mm.
    """

    joint: int
    parts: tuple[int, int]
    start: float
    stop: float


def find_stretches(
    line: Float,
    normal: Float,
    radius: float,
    parts: Sequence[Surface],
    joints: Sequence[JointSides],
    within: Sequence[int],
) -> tuple[Stretch, ...]:
    """Return the stretches of a line in joints, from its start on.

    Args:
        line: Center line (p, 3) of a channel, mm.
        normal: Unit normal (3,) of its plane.
        radius: Radius of the channel, mm.
        parts: Surfaces of the parts.
        joints: The two groups of parts of each joint.
        within: Indices of the joints to consider.

    Returns:
        The stretches; empty if the line lies in no joint.
    """
    lengths = arc_lengths(line)
    if len(within) == 1:
        low, high = joints[within[0]]
        return (Stretch(within[0], (min(low), min(high)), 0.0, float(lengths[-1])),)
    places = np.linspace(0, lengths[-1], max(2, int(lengths[-1] / PROBE_STEP_MM) + 1))
    points = np.stack([np.interp(places, lengths, line[:, k]) for k in range(3)], axis=1)
    nearest_parts = [
        [
            _nearest(points + sign * (radius + distance) * normal, parts)
            for distance in PROBE_DISTANCES_MM
        ]
        for sign in (-1, 1)
    ]
    joint_at_place: list[tuple[int, tuple[int, int]] | None] = []
    for k in range(len(points)):
        pairs = ((int(a[k]), int(b[k])) for a, b in zip(*nearest_parts, strict=True))
        joint_at_place.append(
            next((f for f in (_joint(p, joints, within) for p in pairs) if f), None)
        )
    return tuple(_merge(_fill_gaps(joint_at_place), places))


def _nearest(points: Float, parts: Sequence[Surface]) -> Float:
    """Return the part (n,) that each point (n, 3) is deepest in, or else nearest to."""
    return np.asarray(np.argmax([signed_distance_of(part)(points) for part in parts], axis=0))


def _joint(
    pair: tuple[int, int], joints: Sequence[JointSides], within: Sequence[int]
) -> tuple[int, tuple[int, int]] | None:
    a, b = pair
    for j in within:
        low, high = joints[j]
        if (a in low and b in high) or (b in low and a in high):
            return j, pair
    return None


def _fill_gaps(
    places_found: Sequence[tuple[int, tuple[int, int]] | None],
) -> list[tuple[int, tuple[int, int]]]:
    """Give places without a joint that of the place before them, or after them."""
    known_places = [k for k, f in enumerate(places_found) if f]
    out = []
    for k in range(len(places_found)):
        if not known_places:
            return []
        last = max((n for n in known_places if n <= k), default=known_places[0])
        out.append(places_found[last])
    return [f for f in out if f]


def _merge(
    joint_at_place: Sequence[tuple[int, tuple[int, int]]], places: Float
) -> Iterator[Stretch]:
    """Join runs of the same joint, without the short runs between them."""
    runs: list[list[int]] = []
    for k, (joint, _) in enumerate(joint_at_place):
        if runs and joint_at_place[runs[-1][0]][0] == joint:
            runs[-1].append(k)
        else:
            runs.append([k])
    long_runs = [r for r in runs if places[r[-1]] - places[r[0]] >= MIN_STRETCH_MM]
    known_joints = {joint_at_place[r[0]][0] for r in long_runs}
    merged: list[list[int]] = []
    for run in (r for r in runs if r in long_runs or joint_at_place[r[0]][0] not in known_joints):
        if merged and joint_at_place[merged[-1][0]][0] == joint_at_place[run[0]][0]:
            merged[-1] += run
        else:
            merged.append(list(run))
    for n, run in enumerate(merged):
        joint, pair = joint_at_place[run[len(run) // 2]]
        start = 0.0 if n == 0 else float(places[run[0]])
        stop = float(places[-1] if n == len(merged) - 1 else places[merged[n + 1][0]])
        yield Stretch(joint, pair, start, stop)


def find_late_joints(
    stretches: Sequence[Stretch], joints: Sequence[JointSides]
) -> list[tuple[int, int]]:
    """Return where a joint that is closed later draws an inserted cord together.

    Args:
        stretches: Stretches of the cord.
        joints: Joints, in the order in which they are closed.

    Returns:
        Pairs (joint, k): the joint is closed later than those of the stretches k - 1 and k, and
            brings
        their parts together.
    """
    out = []
    for k in range(1, len(stretches)):
        before, after = stretches[k - 1], stretches[k]
        for j in range(max(before.joint, after.joint) + 1, len(joints)):
            low, high = joints[j]
            first, second = set(before.parts), set(after.parts)
            if (first <= low and second <= high) or (first <= high and second <= low):
                out.append((j, k))
    return out
