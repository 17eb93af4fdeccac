"""A bar that bends, twists and stretches, as frames and as an animation."""

import numpy as np

from defsense_fab.runtime.recording.animation import Animation
from tests.runtime.live_frames import frame


def bar(along=12, around=8):
    """Return vertices (v, 3), mm, and faces of a closed tube of 100 mm along z."""
    angle = np.arange(around) * 2 * np.pi / around
    ring = np.stack([10 * np.cos(angle), 6 * np.sin(angle)], axis=1)
    heights = np.linspace(0, 100, along)
    rings = [np.column_stack([ring, np.full(around, h)]) for h in heights]
    vertices = np.concatenate([*rings, [[0, 0, 0], [0, 0, 100]]])
    faces = []
    for i in range(along - 1):
        for j in range(around):
            a, b = i * around + j, i * around + (j + 1) % around
            faces += [(a, b, b + around), (a, b + around, a + around)]
    bottom, top, last = along * around, along * around + 1, (along - 1) * around
    for j in range(around):
        k = (j + 1) % around
        faces += [(bottom, k, j), (top, last + j, last + k)]
    return vertices, np.array(faces)


def moved(vertices, time):
    """Return the bar at a time (s): bent up to 90 degrees, twisted up to 30, stretched 10 %."""
    bend = np.deg2rad(90) * np.sin(1.3 * time) / 100
    twist = np.deg2rad(30) * np.sin(2.1 * time) / 100
    x, y, z = vertices.T
    z = z * (1 + 0.1 * np.sin(3.1 * time))
    c, s = np.cos(twist * z), np.sin(twist * z)
    x, y = c * x - s * y, s * x + c * y
    angle = bend * z
    safe = bend if abs(bend) > 1e-9 else 1e-9
    return np.stack(
        [
            (1 - np.cos(angle)) / safe + x * np.cos(angle),
            y,
            np.sin(angle) / safe - x * np.sin(angle),
        ],
        axis=1,
    )


def animation(count=90, fps=30.0, **size):
    vertices, faces = bar(**size)
    positions = np.stack([moved(vertices, k / fps) for k in range(count)]).astype(np.float32)
    return Animation("a bar", vertices, faces, positions, np.arange(count), fps)


def frames(seconds, rate, vertices, start=0.0):
    """Yield live frames of the bar at a rate (Hz)."""
    for k in range(round(seconds * rate) + 1):
        yield frame(k, time=start + k / rate, vertices=moved(vertices, k / rate))
