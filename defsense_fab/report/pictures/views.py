"""Define the directions from which pictures show an upright body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float


@dataclass(frozen=True)
class View:
    """A direction of view, given by unit vectors (3,) in the rest frame.

    Attributes:
        right: Direction to the right in the picture.
        up: Direction up in the picture.
        back: Direction from the body to the eye.
        title: Where the eye is, such as "from the front".
    """

    right: Float
    up: Float
    back: Float
    title: str = ""

    def flat(self, points: Float) -> Float:
        """Project points (n, 3) onto the picture: (n, 2) to the right and up, mm."""
        return np.asarray(points @ np.stack([self.right, self.up], axis=1))


def looking(back: Float, up: Float, title: str = "") -> View:
    """Return a view from a direction.

    Args:
        back: Direction (3,) from the body to the eye.
        up: Direction (3,) that points up in the picture as far as possible.
        title: Title of the view.
    """
    back = np.asarray(back, float) / np.linalg.norm(back)
    right = np.cross(up, back)
    right = right / np.linalg.norm(right)
    return View(right, np.cross(back, right), back, title)


# In the functions below, `frame` (3, 3) holds the axes to the right, up and towards the viewer of a
# standing body, one a row (`geometry.bodies.orientation`).


def three_quarter(frame: Float) -> View:
    """Return the view from the front, right and above, which shows most of a body."""
    right, up, back = frame
    return looking(0.35 * right + 0.55 * up + back, up, "from the front, right and above")


def behind(frame: Float) -> View:
    """Return the view from behind, which shows what `three_quarter` hides."""
    right, up, back = frame
    return looking(-0.35 * right + 0.45 * up - back, up, "from behind and above")


def around(frame: Float) -> tuple[View, ...]:
    """Return other views from above that may show what `three_quarter` hides."""
    right, up, back = frame
    return (
        looking(-0.35 * right + 0.55 * up + back, up, "from the front, left and above"),
        looking(right + 0.55 * up + 0.5 * back, up, "from the right and above"),
        looking(-right + 0.55 * up + 0.5 * back, up, "from the left and above"),
        looking(0.35 * right + 1.2 * up + back, up, "from above and the front"),
        behind(frame),
    )


def front(frame: Float) -> View:
    """Return the view straight from the front."""
    return looking(frame[2], frame[1], "from the front")


def side(frame: Float) -> View:
    """Return the view straight from the right."""
    return looking(frame[0], frame[1], "from the right")


def top(frame: Float) -> View:
    """Return the view straight from above, with the front at the bottom."""
    return looking(frame[1], -frame[2], "from above")


def elevations(frame: Float, bounds: Float) -> tuple[View, View]:
    """Return two straight views that together show all three dimensions of a body.

    Args:
        frame: Axes (3, 3) to the right, up and towards the viewer.
        bounds: Bounds (2, 3) of the body, mm.

    Returns:
        The view from the front, and the one from above or the right that shows more.
    """
    wide, high, _ = np.abs(frame) @ np.ptp(bounds, axis=0)
    return front(frame), top(frame) if wide > high else side(frame)
