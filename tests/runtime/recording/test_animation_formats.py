"""The suffix chooses the format."""

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError
from defsense_fab.runtime.recording.animation import Animation
from defsense_fab.runtime.recording.animation_recorder import SUFFIXES, write_animation
from tests.runtime.recording_bars import animation
from tests.support.errors import raises

MAGIC = {".glb": b"glTF", ".usda": b"#usda", ".npz": b"PK"}


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".GLB"])
def test_suffix_chooses_the_format(tmp_path, suffix):
    path = tmp_path / f"bar{suffix}"
    written = write_animation(path, animation(5))
    assert written.path == path
    assert written.size == path.stat().st_size
    assert path.read_bytes().startswith(MAGIC.get(suffix.lower(), b"PXR-USDC"))


def test_unknown_format_is_refused(tmp_path):
    with raises(LiveError, "unknown-format", suffix=".abc"):
        write_animation(tmp_path / "bar.abc", animation(3))


@pytest.mark.parametrize(
    ("count", "steps", "code"),
    [
        (0, [], "no-frames"),
        (2, [0], "shape-mismatch"),
        (2, [1, 1], "not-increasing"),
        (2, [-1, 1], "not-increasing"),
    ],
)
def test_invalid_animations_are_refused(count, steps, code):
    with raises(LiveError, code):
        Animation(
            "x",
            np.eye(3),
            np.array([[0, 1, 2]]),
            np.zeros((count, 3, 3), np.float32),
            np.array(steps, int),
            30.0,
        )
