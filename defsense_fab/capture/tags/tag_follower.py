"""The tags in one image after another: looked for near where they were, which is sooner done."""

from __future__ import annotations

from collections import Counter

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from .tag_detection import Detector, Image, TagView
from .tag_dictionary import Dictionary

#: Images after which the whole one is looked at again, and a place is forgotten.
_WHOLE, _KEPT = 10, 30
_BESIDE = 0.6  # of the largest side of a tag: how far outside the last places is looked, and
_LEAST = 40  # px, at least


class TagFollower:
    """Finds tags of a dictionary in the images of a camera, one after the other in time. Of most
    images only the part around the tags' last places is looked at; a tag that is missing there has
    the whole image looked at, and one that appears elsewhere is found within ten images. A number
    that was printed twice is found as often as it is seen."""

    def __init__(self, camera: Camera, dictionary: Dictionary) -> None:
        self._detector = Detector(camera, dictionary)
        self._size = camera.size
        self._number = 0
        # Tag: image that it was last seen in, and its corners there, of each of its prints.
        self._last: dict[int, tuple[int, list[Float]]] = {}

    def find(self, image: Image) -> TagView:
        """All tags that can be read. Raises CaptureError for an image of another size."""
        now = self._number
        self._number += 1
        expected = Counter(
            {tag: len(at) for tag, (when, at) in self._last.items() if when == now - 1}
        )
        view = None
        if expected and now % _WHOLE:
            view = self._detector.find(image, self._box())
            if not expected <= Counter(view.ids.tolist()):
                view = None
        if view is None:
            view = self._detector.find(image)
        for tag in set(view.ids.tolist()):
            self._last[tag] = now, list(view.seen[view.ids == tag])
        self._last = {t: seen for t, seen in self._last.items() if now - seen[0] < _KEPT}
        return view

    def _box(self) -> tuple[int, int, int, int]:
        """Around the last places, within the image."""
        corners = np.array([c for _, at in self._last.values() for c in at])
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        around = max(_BESIDE * float(sides.max()), _LEAST)
        low = np.maximum(np.floor(corners.min(axis=(0, 1)) - around), 0).astype(int)
        high = np.minimum(np.ceil(corners.max(axis=(0, 1)) + around), self._size).astype(int)
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])
