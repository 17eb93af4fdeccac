"""Cameras, tags in front of them, and the tags' corners in pixels, without images."""

import numpy as np

from defsense_fab.capture.tracking.observations import observe, store_views
from defsense_fab.capture.tracking.reconstruction import tag_corners
from tests.twin.views import camera, turn

EYES = {"left": (-120, -380, 60), "right": (120, -380, 60), "top": (0, -300, 260)}


def rig(count=2):
    return [
        camera(eye, focal=900.0, size=(1280, 720), name=name, lens=(-0.1, 0.05, 0, 0, 0))
        for name, eye in list(EYES.items())[:count]
    ]


def tags(n, rng, size=15.0, tilt=0.5):
    """Return corners (n, 4, 3), mm, of tags that roughly face the cameras."""
    out = []
    for _ in range(n):
        axes = turn(*rng.uniform(-tilt, tilt, 3)) @ turn(np.pi / 2)
        out.append(tag_corners(size) @ axes.T + rng.uniform(-40, 40, 3))
    return np.array(out)


def flat(view, corners):
    """Return corners (..., 4, 2), px, as the camera sees them without distortion."""
    at = view.to_camera(corners)
    return at[..., :2] / at[..., 2:] * view.focal + view.matrix[:2, 2]


def spread(shape, sigma):
    out = np.broadcast_to(np.eye(2) * sigma**2, (*shape, 5, 2, 2)).copy()
    out[..., 4, :, :] /= 4
    return out


def collect(time, views, ids):
    """Return observations of the tags `ids` in a few frames, in memory."""
    return observe(time, store_views(views), ids).part(np.arange(len(views)))
