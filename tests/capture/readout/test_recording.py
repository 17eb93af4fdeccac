"""Recordings stay readable up to the last line whatever happens to the writer, and are played."""

import errno
import os
import random
import signal
import subprocess
import sys
import time
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest

from defsense_fab.capture.readout.recording import Recorder, Replay, has_frames, read_recording
from defsense_fab.capture.readout.source import Event, RecordingEnd, StampedSample
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.sensing.serial_frames import NOT_READ, Sample
from tests.support.errors import raises
from tests.support.places import ROOT

#: Times that the writer is killed.
KILLS = int(os.environ.get("DEFSENSE_KILLS", "4"))
_COLUMNS = "host_ns,device_us,counter,led,late,averages"


def stamped(n, channels=3):
    sums = tuple(1000 * c + n for c in range(channels))
    return StampedSample(10**6 * n, 1000 * n, Sample(n, 1000 * n, bool(n % 2), False, 16, sums))


def test_round_trip(tmp_path):
    path = tmp_path / "r.csv"
    with Recorder(path, 3) as r:
        r.add(Event(5, "start", {"full_scale": 1024}))
        r.extend(stamped(n) for n in range(10))
        r.add(Event(6, "gap", {"why": "unplugged"}))
        r.add(StampedSample(1, 2, Sample(77, 2, True, True, 4, (NOT_READ, 8, 0))))
    recording = read_recording(path)
    assert recording.counter.tolist() == [*range(10), 77]
    assert recording.sums[3].tolist() == [3, 1003, 2003]
    assert recording.counts[-1] == pytest.approx([np.nan, 2, 0], nan_ok=True)
    assert (recording.led[-1], recording.late[-1], recording.averages[-1]) == (1, 1, 4)
    assert [(at, e["event"]) for at, e in recording.events] == [(0, "start"), (10, "gap")]
    assert recording.damaged_lines == 0


@pytest.mark.parametrize("cut", [1, 7, 25])
def test_cut_line_stays_left_out(tmp_path, cut):
    """The rest of the line may look like a whole line."""
    path = tmp_path / "r.csv"
    with Recorder(path, 3) as r:
        r.extend(stamped(n) for n in range(5))
    path.write_bytes(path.read_bytes()[:-cut])
    whole = read_recording(path)
    assert whole.counter.tolist() == [0, 1, 2, 3]
    assert whole.damaged_lines == 1
    with Recorder(path, 3) as r:
        r.extend(stamped(n) for n in range(5, 8))
    again = read_recording(path)
    assert again.counter.tolist() == [0, 1, 2, 3, 5, 6, 7]
    assert again.damaged_lines == 1


def test_partial_write_loses_only_its_line(tmp_path, monkeypatch):
    """After the disk was full, the next line is not appended to the rest of a line."""
    path, write, room = tmp_path / "r.csv", os.write, 10**6

    def limited(file, data):
        nonlocal room
        if not room:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = write(file, data[:room])
        room -= count
        return count

    monkeypatch.setattr(os, "write", limited)
    with Recorder(path, 3) as r:
        r.add(stamped(0))
        room = 9
        with pytest.raises(StorageError):
            r.add(stamped(1))
        room = 1  # not even the mark finds room
        with pytest.raises(StorageError):
            r.add(stamped(2))
        room = 10**6
        r.add(stamped(3))
    recording = read_recording(path)
    assert recording.counter.tolist() == [0, 3]
    assert recording.damaged_lines == 1


def test_recording_works_without_file_locks(tmp_path, monkeypatch):
    def no_locks(file, operation):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", no_locks)
    with Recorder(tmp_path / "r.csv", 3) as r:
        r.add(stamped(0))
    assert read_recording(tmp_path / "r.csv").counter.tolist() == [0]


def test_recording_with_a_cut_header_is_started_again(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("# defsense recording 1\nhost_ns,dev")
    with Recorder(path, 3) as r:
        r.add(stamped(0))
    assert read_recording(path).counter.tolist() == [0]


def test_reading_needs_little_more_memory_than_the_numbers(tmp_path):
    """The text of an hour's recording need not be in memory at once."""
    path, count = tmp_path / "r.csv", 5000
    rows = [f"{10**15 + n},{n},{n},0,0,16,{n},{n + 1}\n" for n in range(count)]
    path.write_text(f"# defsense recording 1\n{_COLUMNS},s1,s2\n{''.join(rows)}")
    tracemalloc.start()
    try:
        recording = read_recording(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert recording.sums[-1].tolist() == [count - 1, count]
    assert peak < 2 * 8 * (8 + 1) * count + 200_000  # as the array grows; and the full scale


def test_recordings_with_frames_are_recognized(tmp_path):
    path = tmp_path / "r.csv"
    with Recorder(path, 3) as r:
        r.add(Event(5, "start", {"full_scale": 1024}))
        assert not has_frames(path)
        r.add(stamped(0))
        assert has_frames(path)
    path.write_text("1,2,3\n")
    with raises(CaptureError, "not-a-recording"):
        has_frames(path)


_WRITER = """
import sys, time
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from tests.capture.readout.test_recording import stamped
from defsense_fab.capture.readout.recording import Recorder, read_recording
path = Path(sys.argv[1])
first = len(read_recording(path).counter) if path.exists() else 0
with Recorder(path, 3) as r:
    print("ready", flush=True)
    for n in range(first, 10**9):
        r.add(stamped(n))
        sys.stdout.write(f"{n}\\n"); sys.stdout.flush()
"""


@pytest.mark.slow
def test_killed_at_any_moment(tmp_path):
    """After SIGKILL every frame written before is readable, and the next run continues."""
    path, rng = tmp_path / "r.csv", random.Random(0)
    root = str(ROOT)
    for _ in range(KILLS):
        with subprocess.Popen(
            [sys.executable, "-c", _WRITER, str(path), root], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout.readline() == "ready\n"
            time.sleep(rng.uniform(0.005, 0.1))
            process.send_signal(signal.SIGKILL)
            message = process.stdout.read().splitlines()
        recording = read_recording(path)
        counters = recording.counter.tolist()
        assert counters == list(range(len(counters)))
        # The last number may have been printed in part.
        assert not message[:-1] or counters[-1] >= int(message[-2])
    assert recording.sums[-1].tolist() == list(stamped(counters[-1]).sample.sums)


_HEAD = f"# defsense recording 1\n{_COLUMNS},s1\n"


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("a,b\n", "not-a-recording", None),
        ("# defsense recording 1\na,b\n", "header-wrong", 2),
        (_HEAD + "1,2\n", "cell-count-differs", 3),
        (_HEAD + "# x\n", "event-invalid", 3),
        (_HEAD + "1,2,3,4,5,6,x\n", "not-a-number", 3),
        (_HEAD + f"{1 << 63},2,3,4,5,6,7\n", "not-a-number", 3),
        (_HEAD + "1,2,3,4,5,0,7\n", "frame-without-conversions", 3),
    ],
)
def test_files_that_are_not_recordings(tmp_path, text, code, line):
    path = tmp_path / "r.csv"
    path.write_text(text)
    with raises(CaptureError, code, line=line):
        read_recording(path)


@pytest.mark.parametrize("text", ["", "# defsense", "# defsense recording 1"])
def test_recording_with_a_cut_first_line_has_no_frames(tmp_path, text):
    """So a session whose first write failed can be resumed."""
    (tmp_path / "r.csv").write_text(text)
    assert len(read_recording(tmp_path / "r.csv").counter) == 0
    assert not has_frames(tmp_path / "r.csv")


def test_other_channels_are_rejected(tmp_path):
    path = tmp_path / "r.csv"
    with Recorder(path, 3) as r, raises(CaptureError, "channels-differ", count=2, channels=3):
        r.add(stamped(0, channels=2))
    with pytest.raises(CaptureError):
        Recorder(path, 2)
    with Recorder(path, 3), pytest.raises(CaptureError):
        Recorder(path, 3)
    path.write_text("mine\n")
    with pytest.raises(CaptureError):
        Recorder(path, 3)
    assert path.read_text("utf-8") == "mine\n"


def test_replay(tmp_path):
    path = tmp_path / "r.csv"
    about = {"protocol": 1, "version": [1, 0], "converter": 0, "channels": 3, "averages": 16,
             "rate": 50, "led_period": 0, "most_channels": 8, "full_scale": 1024}  # fmt: skip
    with Recorder(path, 3) as r:
        r.add(Event(0, "start", about))
        r.extend(stamped(n) for n in range(100))
    source = Replay(path, speed=2)
    assert source.start().full_scale == 1024
    begun, received = time.monotonic(), []
    while len(received) < 100:
        received += source.drain()
        time.sleep(0.002)
    assert time.monotonic() - begun >= 0.0495 - 1e-3  # later on a machine that is busy
    assert [i.sample for i in received] == [stamped(n).sample for n in range(100)]
    assert source.read_latest(5).sample.counter == 99
    with raises(RecordingEnd, "recording-ended"):
        source.drain()


def test_recordings_that_cannot_be_played(tmp_path):
    path = tmp_path / "r.csv"
    with Recorder(path, 3) as r:
        r.add(Event(0, "gap", {}))
        with raises(CaptureError, "recording-empty"):
            Replay(path).start()
        r.add(stamped(0))
    with raises(CaptureError, "unknown-board"):
        Replay(path).start()


BOARD = {
    "protocol": 1, "version": [1, 0], "converter": 0, "channels": 1, "averages": 4, "rate": 100,
    "led_period": 0, "most_channels": 1, "full_scale": 1024,
}  # fmt: skip


def record_run(path, host_s, count, device_us):
    """Add a run to a recording, with these clocks at its start."""
    with Recorder(path, 1) as recorder:
        start_ns = round(host_s * 1e9)
        recorder.add(Event(start_ns, "start", BOARD))
        for k in range(count):
            sample = Sample(k, (device_us + 10_000 * k) % (1 << 32), False, False, 4, (2000 + k,))
            recorder.add(StampedSample(start_ns + 10_000_000 * k, device_us + 10_000 * k, sample))


def test_runs_in_one_file_are_played_a_second_apart(tmp_path):
    """The second run was hours later, and both clocks had started again."""
    path = tmp_path / "board.csv"
    record_run(path, 50_000.0, 20, 7_000_000)
    record_run(path, 120.0, 20, 300)
    replay, samples = Replay(path, speed=20.0), []
    replay.start()
    end = time.monotonic() + 120
    while len(samples) < 40 and time.monotonic() < end:
        samples += [s for s in replay.drain() if isinstance(s, StampedSample)]
    assert len(samples) == 40
    micros = [s.device_us for s in samples]
    assert micros[0] == 7_000_000
    steps = [b - a for a, b in pairwise(micros)]
    assert steps == [10_000] * 19 + [1_000_000] + [10_000] * 19
    assert [s.sample.sums[0] for s in samples] == [*range(2000, 2020)] * 2
