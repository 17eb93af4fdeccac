"""Where a picture is seen from, so that the body stands upright in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float


@dataclass(frozen=True)
class View:
    """Unit vectors (3,) in the rest frame: to the `right` and `up` in the picture, and `back` from
    what is seen to the eye; `title` says where the eye is."""

    right: Float
    up: Float
    back: Float
    title: str = ""

    def flat(self, points: Float) -> Float:
        """Points (n, 3) mm as seen: (n, 2) mm to the right and up."""
        return np.asarray(points @ np.stack([self.right, self.up], axis=1))


def looking(back: Float, up: Float, title: str = "") -> View:
    """A view from the direction `back` (3,), in which `up` (3,) points up as far as it can."""
    back = np.asarray(back, float) / np.linalg.norm(back)
    right = np.cross(up, back)
    right = right / np.linalg.norm(right)
    return View(right, np.cross(back, right), back, title)


# Below, `frame` (3, 3) has in its rows what is to the right, up and towards the viewer for a body
# that stands before them (`geometry.bodies.standing`).


def three_quarter(frame: Float) -> View:
    """From the front, the right and above: most of a body in one picture."""
    right, up, back = frame
    return looking(0.35 * right + 0.55 * up + back, up, "from the front, right and above")


def behind(frame: Float) -> View:
    """What `three_quarter` hides: from the other side."""
    right, up, back = frame
    return looking(-0.35 * right + 0.45 * up - back, up, "from behind and above")


def around(frame: Float) -> tuple[View, ...]:
    """Other views from above that may show what `three_quarter` hides."""
    right, up, back = frame
    return (
        looking(-0.35 * right + 0.55 * up + back, up, "from the front, left and above"),
        looking(right + 0.55 * up + 0.5 * back, up, "from the right and above"),
        looking(-right + 0.55 * up + 0.5 * back, up, "from the left and above"),
        looking(0.35 * right + 1.2 * up + back, up, "from above and the front"),
        behind(frame),
    )


def front(frame: Float) -> View:
    """Straight from the front."""
    return looking(frame[2], frame[1], "from the front")


def side(frame: Float) -> View:
    """Straight from the right."""
    return looking(frame[0], frame[1], "from the right")


def top(frame: Float) -> View:
    """Straight from above, the front below."""
    return looking(frame[1], -frame[2], "from above")


def elevations(frame: Float, bounds: Float) -> tuple[View, View]:
    """Two straight views that show all three dimensions of a body with `bounds` (2, 3) mm: from the
    front, and from above or the right, where there is more to see."""
    wide, high, _ = np.abs(frame) @ np.ptp(bounds, axis=0)
    return front(frame), top(frame) if wide > high else side(frame)
