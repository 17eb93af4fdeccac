"""Damaged XDF files: no wrong sample outside the damage, and no loss without a note.

DEFSENSE_XDF_VARIANTS sets the number of random variants.
"""

from __future__ import annotations

import gzip
import os
import struct

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.recordings.xdf_chunks import find_sound_chunks
from defsense_fab.training.recordings.xdf_streams import XdfStream, join_restarted, read_streams
from tests.support.errors import raises
from tests.support.xdf_variants import check, random_variant
from tests.training.recordings.xdf_writer import chunk, stream, write_xdf

pytestmark = pytest.mark.slow

VARIANTS = int(os.environ.get("DEFSENSE_XDF_VARIANTS", "40"))
TIME = 100 + np.arange(600) / 60
VALUES = np.random.default_rng(0).normal(size=(600, 3))
BOARD = stream(1, "Board", "R", ["a", "b", "c"], TIME, VALUES, rate=60.0)


@pytest.mark.parametrize("seed", range(VARIANTS))
def test_samples_outside_the_damage_are_right(tmp_path, seed):
    assert check(random_variant(np.random.default_rng(seed)), tmp_path / "v.xdf").faults == []


@pytest.mark.parametrize("name", ["take.xdf", "take.xdfz"])
def test_whole_files_are_read_without_notes(tmp_path, name):
    path = write_xdf(tmp_path / name, BOARD)
    if name.endswith("z"):
        path.write_bytes(gzip.compress(path.read_bytes()))
    (board,), notes = read_streams(path)
    assert notes == []
    np.testing.assert_array_equal(board.values, VALUES)
    np.testing.assert_allclose(board.time, TIME, atol=1e-6)


def test_compressed_file_is_read_up_to_its_cut(tmp_path):
    path = write_xdf(tmp_path / "take.xdfz", BOARD)
    data = gzip.compress(path.read_bytes())
    path.write_bytes(data[: len(data) // 2])
    (board,), notes = read_streams(path)
    np.testing.assert_array_equal(board.values, VALUES[: len(board.values)])
    assert 200 < len(board.values) < 400
    assert notes


def stream_header(number, channels, value_format="double64"):
    xml = (
        f"<info><name>A</name><channel_count>{channels}</channel_count>"
        f"<nominal_srate>60</nominal_srate><channel_format>{value_format}</channel_format></info>"
    )
    return chunk(2, struct.pack("<I", number) + xml.encode())


@pytest.mark.parametrize(
    "extra",
    [
        stream_header(2, 3) + chunk(3, struct.pack("<IBQ", 2, 8, 2**60)),
        stream_header(2, 10**9) + chunk(3, struct.pack("<IBI", 2, 4, 0)),
        stream_header(2, 10**30),
        b"\x08" + struct.pack("<QHI", 2**62, 3, 1),
        chunk(6, struct.pack("<I", 1) + b"<info><sample_count>" + b"9" * 9000),
        b"\x01\x06\x03\x00" * 1000,
    ],
)
def test_declared_sizes_take_no_memory(tmp_path, extra):
    header, samples, footer = BOARD
    path = write_xdf(tmp_path / "take.xdf", (header, samples, footer + extra))
    chunks = find_sound_chunks(path.read_bytes())
    assert dict(chunks.rows)[1] == len(TIME)
    assert len(chunks.to_file()) < 2 * path.stat().st_size


def test_compressed_files_that_expand_too_much_are_refused(tmp_path):
    path = write_xdf(tmp_path / "take.xdfz", BOARD)
    path.write_bytes(gzip.compress(path.read_bytes() + bytes(120 << 20)))
    with raises(TrainingError, "memory-limit-exceeded"):
        read_streams(path)


def test_files_that_take_too_long_are_refused(tmp_path, monkeypatch):
    """Each of the clock's restarts takes pyxdf some ms."""
    offsets = [struct.pack("<Idd", 1, k % 4, k // 4 % 2 * 1e6) for k in range(20_000)]
    header, samples, footer = BOARD
    restarts = b"".join(chunk(4, content) for content in offsets)
    path = write_xdf(tmp_path / "take.xdf", (header, restarts + samples, footer))
    monkeypatch.setattr("defsense_fab.training.recordings.xdf_streams._CPU_S", 0.8)
    monkeypatch.setattr("defsense_fab.training.recordings.xdf_streams._CPU_S_PER_MB", 0.0)
    with raises(TrainingError, "time-limit-exceeded"):
        read_streams(path)


@pytest.mark.parametrize("content", [b"XDF:", b"XDF:" + bytes(3000), b"XDF:\x04\xff"])
def test_files_without_streams_have_none(tmp_path, content):
    (tmp_path / "take.xdf").write_bytes(content)
    assert read_streams(tmp_path / "take.xdf")[0] == []


@pytest.mark.parametrize("content", [b"", b"\x1f\x8b", b"time,a\n"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "take.xdf").write_bytes(content)
    with raises(TrainingError, "wrong-file-format"):
        read_streams(tmp_path / "take.xdf")


@pytest.mark.parametrize("channels", [63, 64, 100, 129])
@pytest.mark.parametrize("idle", [64, 1.0], ids=["idle channels", "all idle"])
def test_zeros_that_were_recorded_are_no_damage(tmp_path, channels, idle):
    values = np.random.default_rng(1).normal(size=(600, channels))
    values[:, : idle if idle == 64 else channels] = 0
    labels = [f"c{k}" for k in range(channels)]
    path = write_xdf(
        tmp_path / "idle.xdf", stream(1, "Board", "R", labels, TIME, values, rate=60.0)
    )
    (board,), notes = read_streams(path)
    assert notes == []
    np.testing.assert_array_equal(board.values, values)


def test_streams_whose_clock_is_lost_are_not_joined():
    def part(number, start, is_lost):
        time = start + np.arange(3.0)
        return XdfStream(number, "A", "R", "", ("a",), ("",), time, np.ones((3, 1)), is_lost)

    joined, notes = join_restarted([part(1, 0.0, False), part(2, 10.0, True)])
    assert [s.number for s in joined] == [1, 2]
    assert notes == []
    joined, notes = join_restarted([part(1, 0.0, False), part(2, 10.0, False)])
    assert len(joined) == len(notes) == 1
