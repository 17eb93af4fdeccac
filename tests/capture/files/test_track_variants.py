"""C3D and TRC of other programs: right, or refused, never silently wrong.

DEFSENSE_VARIANTS=1000 python -m pytest tests/capture/files/test_track_variants.py -s
"""

import os
import resource
import time
from collections import Counter

import numpy as np
import pytest

from defsense_fab.capture.files.formats import read_track_file
from defsense_fab.core.errors import CaptureError
from tests.support.track_variants import c3d_variant, trc_variant

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "80"))


def score(path, variant):
    """Return `right`, `refused`, `wrong`, or `unclear` for a refusal without place or action."""
    path.write_bytes(variant.content)
    try:
        tracks = read_track_file(path).tracks
    except CaptureError as error:
        return "refused" if error.action and error.where.startswith(str(path)) else "unclear"
    order = np.argsort(tracks.ids)
    expected = np.argsort(variant.ids)
    is_right = (
        tracks.ids[order].tolist() == sorted(variant.ids)
        and tracks.points.shape == variant.points.shape
        and np.allclose(tracks.time, variant.time, rtol=0, atol=1e-5)
        and np.allclose(
            tracks.points[:, order],
            variant.points[:, expected],
            rtol=1e-6,
            atol=variant.tolerance,
            equal_nan=True,
        )
    )
    return "right" if is_right else "wrong"


@pytest.mark.parametrize(("suffix", "make"), [(".c3d", c3d_variant), (".trc", trc_variant)])
def test_variants_are_read_right_or_refused(tmp_path, suffix, make):
    counts, slowest = Counter(), 0.0
    for seed in range(VARIANTS):
        variant = make(np.random.default_rng([seed, len(suffix)]))
        started_at = time.perf_counter()
        result = score(tmp_path / f"a{suffix}", variant)
        slowest = max(slowest, time.perf_counter() - started_at)
        counts[result] += 1
        assert result in ("right", "refused"), (seed, variant.traits)
        assert result == "right" or not variant.must_read, (seed, variant.traits)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\n{suffix}: {dict(counts)}, at most {slowest:.3f} s and {peak_mb:.0f} MB")


@pytest.mark.parametrize(("suffix", "make"), [(".c3d", c3d_variant), (".trc", trc_variant)])
def test_damaged_bytes_raise_no_other_errors(tmp_path, suffix, make):
    path, counts = tmp_path / f"a{suffix}", Counter()
    for seed in range(VARIANTS):
        rng = np.random.default_rng([seed, 5])
        content = bytearray(make(rng).content)
        for at in rng.integers(0, min(len(content), 3000), int(rng.integers(0, 6))):
            content[at] = rng.integers(256)
        size = len(content) if rng.random() < 0.7 else int(rng.integers(1, len(content)))
        path.write_bytes(content[:size])
        try:
            read_track_file(path)
            counts["read"] += 1
        except CaptureError:
            counts["refused"] += 1
    print(f"\n{suffix} damaged: {dict(counts)}")
