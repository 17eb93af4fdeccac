"""Videos whose pictures change their size are refused where they do; others are read whole.

DEFSENSE_VARIANTS=100 python -m pytest tests/capture/cameras/test_picture_sizes.py -s
"""

import os
import resource
import time
from collections import Counter

import numpy as np
import pytest

from defsense_fab.capture.cameras.image_sources import Video, silence_opencv
from defsense_fab.capture.cameras.packet_sizes import PacketSizes
from defsense_fab.core.errors import CaptureError
from tests.support.video_variants import (
    ENCODED,
    KINDS,
    SIZES,
    Segment,
    changed_at,
    segments_of,
    write_video,
)

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "4"))


def read(path):
    """Return the number of frames, and the data of the error or None."""
    video, count = Video(path), 0
    try:
        for _ in video.frames():
            count += 1
    except CaptureError as error:
        return count, error.data | {"code": error.code}
    finally:
        video.close()
    return count, None


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_change_of_the_size_is_found_where_it_is(tmp_path, kind):
    silence_opencv()
    counts, slowest = Counter(), 0.0
    for seed in range(VARIANTS):
        rng = np.random.default_rng([seed, 8])
        segments = segments_of(rng, seed % 3 == 0, list(ENCODED.get(kind[0], SIZES)))
        folder = tmp_path / str(seed)
        folder.mkdir()
        path, change = write_video(folder, kind, segments, rng), changed_at(segments)
        started_at = time.perf_counter()
        frames, error = read(path)
        slowest = max(slowest, time.perf_counter() - started_at)
        if change is None:
            assert error is None, (seed, segments, error)
            # Decoders may lose the last picture of each part.
            assert frames >= sum(s.count - 1 for s in segments), (seed, segments)
        else:
            assert error is not None, (seed, segments)
            facts = [error[name] for name in ("code", "frame", "size", "expected")]
            assert facts == ["image-sizes-differ", *change, segments[0].size], (seed, segments)
        counts["read" if error is None else "refused"] += 1
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\n{'-'.join(kind)}: {dict(counts)}, at most {slowest:.3f} s and {peak_mb:.0f} MB")


def test_change_is_found_behind_the_last_picture_that_can_be_decoded(tmp_path):
    segments = [Segment((64, 48), 5), Segment((48, 64), 1)]
    path = write_video(tmp_path, ("H264", ".ivf", "ivf"), segments, np.random.default_rng(0))
    path.write_bytes(path.read_bytes()[:-4])
    assert read(path)[1]["frame"] == 5


def test_damaged_packets_raise_no_errors():
    rng = np.random.default_rng(0)
    for code in (b"H264", b"HEVC", b"VP80", b"VP90", b"MJPG", b"FMP4", b"MPG2"):
        for k in range(20 * VARIANTS):
            packet = bytearray(
                bytes.fromhex(ENCODED["H265" if code == b"HEVC" else "H264"][64, 48])
            )
            if k % 2:
                packet = bytearray(rng.bytes(int(rng.integers(0, 60))))
            for at in rng.integers(0, max(len(packet), 1), 3 * (len(packet) > 0)):
                packet[at] = rng.integers(256)
            reader = PacketSizes(int.from_bytes(code, "little"))
            reader.read(bytes(packet))
            start = {b"MJPG": b"\xff\xd8\xff\xc0", b"MPG2": b"\0\0\1\xb3", b"FMP4": b"\0\0\1\x20"}
            reader.read(start.get(code, b"") + bytes(packet))
