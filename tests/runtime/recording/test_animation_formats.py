"""The format is that of the suffix."""

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError
from defsense_fab.runtime.recording.animation import Animation
from defsense_fab.runtime.recording.animation_formats import SUFFIXES, write_animation
from tests.runtime.recording_bars import animation

BEGINS = {".glb": b"glTF", ".usda": b"#usda", ".npz": b"PK"}


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".GLB"])
def test_by_suffix(tmp_path, suffix):
    path = tmp_path / f"bar{suffix}"
    written = write_animation(path, animation(5))
    assert written.path == path
    assert written.size == path.stat().st_size
    assert path.read_bytes().startswith(BEGINS.get(suffix.lower(), b"PXR-USDC"))


def test_an_unknown_one(tmp_path):
    with pytest.raises(LiveError, match=r"bar.abc: no animation format '.abc'; there is .glb,"):
        write_animation(tmp_path / "bar.abc", animation(3))


@pytest.mark.parametrize(
    ("count", "steps", "message"),
    [
        (0, [], "no frame"),
        (2, [0], "are not those of 1 frames of 3 vertices"),
        (2, [1, 1], "do not rise"),
        (2, [-1, 1], "do not rise"),
    ],
)
def test_no_animation(count, steps, message):
    with pytest.raises(LiveError, match=message):
        Animation(
            "x",
            np.eye(3),
            np.array([[0, 1, 2]]),
            np.zeros((count, 3, 3), np.float32),
            np.array(steps, int),
            30.0,
        )
