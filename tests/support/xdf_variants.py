"""Random XDF files, sound and damaged, with the samples that they hold.

    python -m tests.support.xdf_variants [--count 1000] [--seed 0]

reads each one, and counts wrong samples outside the damage (must be 0), samples lost without a
note (must be 0), tracebacks (must be 0), and the share of the samples that is read.
"""

from __future__ import annotations

import argparse
import logging
import resource
import struct
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from defsense_fab.core.errors import DefsenseError
from defsense_fab.training.recordings.series import increasing_times
from defsense_fab.training.recordings.xdf_streams import join_restarted, load_streams

_FORMATS = {"double64": "<f8", "float32": "<f4", "int32": "<i4", "int16": "<i2"}
_BOUNDARY = bytes.fromhex("43a546dccbf5410fb30ed5467383cbe4")
_START = 5000.0  # s, on the recorder's clock
MAX_TIME_ERROR_S = 2e-3
DAMAGE = ("none", "cut", "garbage", "zeroed sectors", "bytes removed", "bytes inserted", "flip")


@dataclass
class TrueStream:
    """A stream as it was recorded.

    Attributes:
        name: Its name.
        time: Times (n,) on the recorder's clock, s.
        values: Samples (n, k).
        spans: First byte of each sample in the file, and the byte after it (n, 2).
        is_stated: Which samples state their time (n,); that of the others follows from it.
        is_damaged: Samples of which the damage touches values or time (n,).
    """

    name: str
    time: np.ndarray
    values: np.ndarray
    spans: np.ndarray
    is_stated: np.ndarray
    is_damaged: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))


@dataclass
class XdfVariant:
    """A file and what it holds.

    Attributes:
        content: Its bytes.
        streams: The streams by their numbers.
        damage: Kind of the damage.
    """

    content: bytes
    streams: dict[int, TrueStream]
    damage: str


@dataclass
class Score:
    """Result of reading a variant.

    Attributes:
        read: Number of samples that were read.
        spoiled: Number of samples that were read with other values, as the damage made them.
        total: Number of samples that were recorded.
        faults: What is wrong.
    """

    read: int = 0
    spoiled: int = 0
    total: int = 0
    faults: list[str] = field(default_factory=list)


def random_variant(rng: np.random.Generator) -> XdfVariant:
    """Return a file of two to four streams, damaged in most cases."""
    pieces, streams = _random_streams(rng)
    content = bytearray(b"XDF:" + _chunk(rng, 1, b"<?xml version='1.0'?><info></info>"))
    for data, number, spans in pieces:
        if number is not None:
            streams[number].spans = np.concatenate([streams[number].spans, spans + len(content)])
        content += data
    damage = str(rng.choice(DAMAGE, p=[0.1, 0.25, 0.2, 0.15, 0.1, 0.1, 0.1]))
    first, last, damaged = _damage(rng, bytes(content), damage)
    for stream in streams.values():
        is_damaged = (stream.spans[:, 0] < last) & (stream.spans[:, 1] > first)
        for k in range(1, len(is_damaged)):
            is_damaged[k] |= is_damaged[k - 1] and not stream.is_stated[k]
        stream.is_damaged = is_damaged
    return XdfVariant(damaged, streams, damage)


def check(variant: XdfVariant, path: Path) -> Score:
    """Read a variant and compare it with its truth."""
    path.write_bytes(variant.content)
    score = Score(total=sum(len(s.time) for s in variant.streams.values()))
    found, notes = load_streams(path, 1 << 30)
    join_restarted(found)
    for stream in found:
        truth = variant.streams.get(stream.number)
        if truth is None or not len(truth.time):
            score.faults.append(f"unknown stream {stream.label}")
            continue
        rows = {row.tobytes(): k for k, row in enumerate(truth.values)}
        index = np.array([rows.get(row.tobytes(), -1) for row in stream.values], int)
        spoiled = int((index < 0).sum())
        if spoiled > truth.is_damaged.sum():
            score.faults.append(f"{spoiled} wrong samples of {stream.name}")
        score.read += int((index >= 0).sum())
        score.spoiled += spoiled
        is_used = (index >= 0) & increasing_times(stream.time)  # as datasets use them
        error = np.abs(stream.time - truth.time[index])[is_used]
        is_sound = ~truth.is_damaged[index[is_used]]
        if stream.is_clock_lost:  # refused by datasets
            continue
        if is_sound.any() and not error[is_sound].max() <= MAX_TIME_ERROR_S:
            score.faults.append(f"times of {stream.name} wrong by {error[is_sound].max():.4f} s")
    if score.read + score.spoiled < score.total and not notes:
        score.faults.append(f"{score.total - score.read} samples lost without a note")
    if variant.damage == "none" and score.read < score.total:
        score.faults.append("samples of a sound file lost")
    return score


def _random_streams(
    rng: np.random.Generator,
) -> tuple[list[tuple[bytes, int | None, np.ndarray]], dict[int, TrueStream]]:
    """Return chunks with the number of their stream and the places of its samples, and streams."""
    duration = float(rng.uniform(3, 20))
    has_footers = rng.random() < 0.7
    plans = [("Board", 3, 0.0, duration), ("Cameras", 12, 0.0, duration)]
    if rng.random() < 0.3:  # the board's sender was restarted
        at = duration * rng.uniform(0.3, 0.6)
        plans = [("Board", 3, 0.0, at), ("Board", 3, at + 1.0, duration), plans[1]]
    if rng.random() < 0.3:
        plans.append(("Notes", 0, 0.0, duration))
    timed: list[tuple[float, bytes, int | None, np.ndarray]] = []
    heads, feet, streams = [], [], {}
    for number, (name, width, start, stop) in enumerate(plans, 1):
        if not width:
            heads.append(_chunk(rng, 2, _header(number, name, 1, "string", 0.0)))
            text = struct.pack("<I", number) + b"\x01\x01\x08" + struct.pack("<d", _START)
            timed.append((1.0, _chunk(rng, 3, text + b"\x01\x04note"), None, np.zeros((0, 2))))
            continue
        rate = float(rng.choice([25, 60, 100]))
        value_format = str(rng.choice(list(_FORMATS))) if name == "Board" else "float32"
        clock = float(rng.choice([0.0, 731.5, -12.25]))
        when = _START + np.arange(start, stop, 1 / rate)
        values = rng.normal(size=(len(when), width)) * 10000
        if name == "Cameras":
            values[rng.random(values.shape) < 0.05] = 0.0
        values[:, 0] = np.arange(len(when)) + 1 + 0.25 * (value_format in ("double64", "float32"))
        values = values.astype(_FORMATS[value_format]).astype(float)
        streams[number] = TrueStream(
            name, when, values, np.zeros((0, 2), int), np.ones(len(when), bool)
        )
        nominal = rate if rng.random() < 0.7 else 0.0
        heads.append(_chunk(rng, 2, _header(number, name, width, value_format, nominal)))
        timed += _sample_chunks(rng, number, streams[number], value_format, clock, nominal)
        for t in np.arange(start, stop, 5.0):
            offset = struct.pack("<Idd", number, _START + t + clock, -clock)
            timed.append((t, _chunk(rng, 4, offset), None, np.zeros((0, 2))))
        xml = f"<info><sample_count>{len(when)}</sample_count></info>".encode()
        feet.append(_chunk(rng, 6, struct.pack("<I", number) + xml))
    for t in np.arange(2.0, duration, float(rng.choice([3.0, 10.0]))):
        timed.append((t, _chunk(rng, 5, _BOUNDARY), None, np.zeros((0, 2))))
    timed.sort(key=lambda piece: piece[0])
    pieces: list[tuple[bytes, int | None, np.ndarray]] = []
    pieces += [(head, None, np.zeros((0, 2))) for head in heads]
    pieces += [(data, number, spans) for _, data, number, spans in timed]
    pieces += [(foot, None, np.zeros((0, 2))) for foot in feet if has_footers]
    return pieces, streams


def _sample_chunks(
    rng: np.random.Generator,
    number: int,
    stream: TrueStream,
    value_format: str,
    clock: float,
    nominal: float,
) -> list[tuple[float, bytes, int | None, np.ndarray]]:
    """Return the chunks of a stream's samples; some samples do not state their time."""
    size = int(rng.choice([10, 50, 200]))
    states_all = not nominal or rng.random() < 0.5
    out: list[tuple[float, bytes, int | None, np.ndarray]] = []
    for k in range(0, len(stream.time), size):
        rows, spans, at = [], [], 0
        for j in range(k, min(k + size, len(stream.time))):
            is_stated = states_all or j == k or rng.random() < 0.1
            stream.is_stated[j] = is_stated
            mark = b"\x08" + struct.pack("<d", stream.time[j] + clock) if is_stated else b"\0"
            row = mark + stream.values[j].astype(_FORMATS[value_format]).tobytes()
            rows.append(row)
            spans.append((at, at + len(row)))
            at += len(row)
        head = struct.pack("<IBI", number, 4, len(rows))
        data = _chunk(rng, 3, head + b"".join(rows))
        first = len(data) - at
        last_time = stream.time[min(k + size, len(stream.time)) - 1] - _START
        out.append((float(last_time), data, number, np.array(spans) + first))
    return out


def _header(number: int, name: str, width: int, value_format: str, rate: float) -> bytes:
    channels = "".join(f"<channel><label>c{k}</label></channel>" for k in range(width))
    return (
        struct.pack("<I", number)
        + f"<?xml version='1.0'?><info><name>{name}</name><type>T</type><channel_count>{width}"
        f"</channel_count><nominal_srate>{rate}</nominal_srate><channel_format>{value_format}"
        f"</channel_format><desc><channels>{channels}</channels></desc></info>".encode()
    )


def _chunk(rng: np.random.Generator, tag: int, content: bytes) -> bytes:
    length = len(content) + 2
    widths = [4, 8] + ([1] if length < 256 else [])
    width = int(rng.choice(widths))
    return bytes([width]) + length.to_bytes(width, "little") + struct.pack("<H", tag) + content


def _damage(rng: np.random.Generator, content: bytes, kind: str) -> tuple[float, float, bytes]:
    """Return the first byte that is not as it was, the one after the last, and the new content."""
    at = int(rng.integers(4, len(content)))
    if kind == "none":
        return 0, 0, content
    if kind == "cut":
        tail = b"\0" * int(rng.choice([0, 0, 3000]))
        return at, np.inf, content[:at] + tail
    if kind == "zeroed sectors":
        first = at // 512 * 512
        last = min(first + 512 * int(rng.integers(1, 9)), len(content))
        first = max(first, 512)
        last = max(last, first)
        return first, last, content[:first] + bytes(last - first) + content[last:]
    size = min(int(rng.integers(1, 600)), len(content) - at)
    if kind == "flip":
        flipped = bytes([content[at] ^ (1 << int(rng.integers(8)))])
        return at, at + 1, content[:at] + flipped + content[at + 1 :]
    if kind == "garbage":
        return at, at + size, content[:at] + rng.bytes(size) + content[at + size :]
    if kind == "bytes removed":
        return at, at + size, content[:at] + content[at + size :]
    return at, at + 1, content[:at] + rng.bytes(size) + content[at:]


def main() -> None:
    """Check many variants and print the counts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    logging.disable()
    counts, slowest, shares = Counter[str](), 0.0, Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.seed, options.seed + options.count):
            variant = random_variant(np.random.default_rng(seed))
            started = time.perf_counter()
            try:
                score = check(variant, Path(folder) / "v.xdf")
            except DefsenseError as error:
                counts[f"refused: {error.code}"] += 1
                continue
            except Exception:
                counts["tracebacks"] += 1
                print(seed, variant.damage, traceback.format_exc().splitlines()[-3:])
                continue
            slowest = max(slowest, time.perf_counter() - started)
            counts["read"] += 1
            counts["faults"] += bool(score.faults)
            counts[f"{variant.damage}: files"] += 1
            shares[variant.damage] += score.read / max(score.total, 1)
            if score.faults:
                print(seed, variant.damage, score.faults)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(dict(counts))
    for kind in DAMAGE:
        files = counts[f"{kind}: files"]
        print(f"{kind}: {shares[kind] / max(files, 1):.3f} of the samples of {files} files read")
    print(f"slowest {slowest:.2f} s, peak {peak:.0f} MB")


if __name__ == "__main__":
    main()
