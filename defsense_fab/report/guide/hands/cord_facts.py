"""What follows for the hands from where cords lie: ends that wait, what slides, ohms."""

from __future__ import annotations

from ....store.manifest import CutCord, Manifest
from .actions import Expected

#: How far pieces of one kind of cord may differ in resistance, and a cord from what it measured
#: before it was laid, times what laying makes of it.
BATCH, LAID = 0.1, 0.05


def anchored_later(cord: CutCord) -> int | None:
    """The end of a cord that is crimped only when all its joints are closed, if any."""
    return next((k for k, e in enumerate(cord.ends) if e.after is not None), None)


def joint_of(cord: CutCord, end: int) -> int | None:
    """The joint that an end lies in; None where the cord lies in none."""
    return cord.stretches[-end].joint if cord.stretches else None


def strained(cord: CutCord) -> tuple[int, ...]:
    """Joints that are still to be closed when both ends of a cord hold it on either side of them:
    it is stretched further as long as they are open."""
    if anchored_later(cord) is not None or not cord.stretches:
        return ()
    last = max(s.joint for s in (cord.stretches[0], cord.stretches[-1]))
    return tuple(j for j, _ in cord.drawn if j > last)


def sliding(cord: CutCord, joint: int, at: int) -> tuple[int, ...]:
    """The joints in which a cord has to slide while `joint` draws it together before its stretch
    `at`: those on the side whose end is free then, or else was laid last."""
    sides = cord.stretches[:at], cord.stretches[at:]
    late = anchored_later(cord)
    free = [any(s.joint > joint for s in side) for side in sides]
    last = [max(s.joint for s in side) for side in sides]
    chosen = max((0, 1), key=lambda k: (free[k], k == late, last[k]))
    return tuple(s.joint for s in sides[chosen] if s.joint < joint)


def wet_until(manifest: Manifest, i: int) -> int | None:
    """The joint up to which the glue of joint i must stay wet: bonded cords that lie in it have to
    slide until that draws them together."""
    if manifest.assembly_of_cords != "bonded":
        return None
    waits = [
        j
        for cord in manifest.cords
        for j, _ in cord.drawn
        if i < j and any(s.joint == i for s in cord.stretches)
    ]
    return max(waits, default=None)


def joints_within(manifest: Manifest, j: int) -> list[int]:
    """The joints whose parts are all on one side of this one: closed before it."""
    sides = [set(side) for side in manifest.assembly[j].join]
    wholes = [{*s.join[0], *s.join[1]} for s in manifest.assembly]
    return [i for i, w in enumerate(wholes) if i != j and any(w <= side for side in sides)]


def loose(cord: CutCord) -> Expected:
    """Before it is laid."""
    return _around(cord.sensor, cord.resistance_before)


def laid(cord: CutCord) -> Expected:
    """In the device at rest."""
    return _around(cord.sensor, cord.resistance)


def _around(cord: str, ohm: float) -> Expected:
    return Expected(cord, ohm, (1 - BATCH) * ohm, (1 + BATCH) * ohm)
