"""Read the streams of an XDF file, up to and after damage, in a process of limited time and memory.

pyxdf relates the clocks and smooths the times. It gets the sound chunks of the file only.
"""

from __future__ import annotations

import io
import json
import logging
import sys
import traceback
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...core.machine.child_process import (
    ChildFailure,
    ChildLimits,
    error_from_record,
    error_record,
    run_module,
    start_child,
)
from ...core.machine.optional_libraries import optional
from ...core.storage.files import unreadable_code
from .xdf_chunks import MAGIC, SoundChunks, find_sound_chunks
from .xdf_headers import StreamInfo

_GZIP_MAGIC = b"\x1f\x8b"
_GZIP_WINDOW = 31  # zlib's code for the format of gzip
_BLOCK_BYTES = 1 << 16
_MAX_EXPANSION = 100  # of a compressed file
_MIN_EXPANDED_BYTES = 100 << 20  # that a compressed file may have, however small it is
# Limits of the reading process: for any file, and in addition for its content.
_CPU_S, _CPU_S_PER_MB = 30.0, 1.0
_MEMORY_BYTES, _MEMORY_RATIO = 1 << 30, 16
_TASK, _RESULT, _ARRAYS = "task.json", "streams.json", "streams.npz"
# Longest step between samples whose times are smoothed together: s, and steps of the nominal rate.
# pyxdf's own 500 steps spread a pause of 8 s at 60 Hz over the samples around it.
_MAX_SMOOTH_STEP_S, _MAX_SMOOTH_STEPS = 0.2, 8
_MAX_NAMED_STREAMS = 6
_CRASH_ACTION = "Copy it again, or export signals and tracks as tables"


@dataclass(frozen=True)
class XdfStream(StreamInfo):
    """A stream of numbers.

    Attributes:
        time: Times of the n samples, shape (n,), s.
        values: Samples, shape (n, k).
        is_clock_lost: Whether the damage took the offsets of its clock from the recorder's.
    """

    time: Float
    values: Float
    is_clock_lost: bool = False

    @property
    def label(self) -> str:
        """Name and number, which identify the stream in its file."""
        return f"{self.name}#{self.number}"

    @property
    def description(self) -> str:
        """Label, type and channels, for messages."""
        labels = ", ".join(self.labels[:4]) + (", ..." if len(self.labels) > 4 else "")
        labels = labels if any(self.labels) else "channels without labels"
        return f"{self.label} (type {self.kind!r}, {labels})"

    @property
    def source(self) -> tuple[object, ...]:
        """What streams have in common whose sender was restarted."""
        return self.name, self.kind, self.labels, self.units


def read_streams(path: Path) -> tuple[list[XdfStream], list[str]]:
    """Read the streams of numbers of an .xdf or .xdfz file.

    Args:
        path: The file.

    Returns:
        The streams that have samples, and notes on parts of the file that are damaged or missing.

    Raises:
        TrainingError: If the file cannot be read, is not an XDF file, or takes too much time or
            memory to read.
    """
    _library(path)
    size = _content_limit(path)
    megabytes = size / 2**20
    limits = ChildLimits.of_cpu_time(
        _CPU_S + _CPU_S_PER_MB * megabytes, _MEMORY_BYTES + _MEMORY_RATIO * size
    )
    failure = ChildFailure(
        TrainingError,
        str(path),
        "reading the file",
        crash_action=_CRASH_ACTION,
        timeout_action=_CRASH_ACTION,
    )

    def write_task(folder: Path) -> None:
        task = {"path": str(path.absolute()), "limit": size}
        (folder / _TASK).write_text(json.dumps(task), encoding="utf-8")

    with run_module(__name__, write_task, _RESULT, limits, failure) as folder:
        result = json.loads((folder / _RESULT).read_text(encoding="utf-8"))
        if "error" in result:
            raise error_from_record(TrainingError, result["error"], str(path))
        with np.load(folder / _ARRAYS, allow_pickle=False) as arrays:
            streams = [
                XdfStream(
                    **{**facts, "labels": tuple(facts["labels"]), "units": tuple(facts["units"])},
                    time=arrays[f"time{k}"],
                    values=arrays[f"values{k}"],
                )
                for k, facts in enumerate(result["streams"])
            ]
    return streams, result["notes"]


def join_restarted(streams: Sequence[XdfStream]) -> tuple[list[XdfStream], list[str]]:
    """Join streams of one source that do not overlap in time: their sender was restarted.

    Times of a stream whose clock is lost do not compare with those of others: it is not joined.

    Args:
        streams: The streams.

    Returns:
        The streams, joined where possible, and notes on those that are.
    """
    groups: dict[tuple[object, ...], list[XdfStream]] = {}
    for stream in streams:
        groups.setdefault(stream.source, []).append(stream)
    joined, notes = list[XdfStream](), list[str]()
    for parts in groups.values():
        parts = sorted(parts, key=lambda s: float(np.min(s.time)))
        pauses = [float(np.min(b.time) - np.max(a.time)) for a, b in pairwise(parts)]
        if len(parts) == 1 or min(pauses) <= 0 or any(s.is_clock_lost for s in parts):
            joined += parts
            continue
        time, values = (np.concatenate([getattr(s, n) for s in parts]) for n in ("time", "values"))
        joined.append(replace(parts[0], time=time, values=values))
        lost = ", ".join(f"{pause:.1f} s" for pause in pauses[:_MAX_NAMED_STREAMS])
        notes.append(
            f"the sender of {parts[0].name!r} was restarted: its {len(parts)} streams are joined,"
            f" with pauses of {lost}"
        )
    return joined, notes


def _content_limit(path: Path) -> int:
    """Return the largest number of bytes that a file may have when it is expanded."""
    try:
        with path.open("rb") as file:
            header = file.read(len(MAGIC))
            size = file.seek(0, io.SEEK_END)
    except OSError as error:
        raise TrainingError(
            f"cannot be read: {error.strerror}",
            code=unreadable_code(error),
            where=path,
            action="Check the path and its permissions",
        ) from None
    if header.startswith(_GZIP_MAGIC):
        return max(_MAX_EXPANSION * size, _MIN_EXPANDED_BYTES)
    if header != MAGIC:
        raise _wrong_format(path)
    return size


def _library(path: Path) -> Any:
    with optional(TrainingError, path, "exchange"):
        import pyxdf
    return pyxdf


def _wrong_format(path: Path) -> TrainingError:
    return TrainingError(
        f"is not an XDF file (it does not start with {MAGIC.decode()})",
        code="wrong-file-format",
        where=path,
        action="Choose another file",
    )


def _unreadable(path: Path, problem: str, code: str) -> TrainingError:
    return TrainingError(problem, code=code, where=path, action=_CRASH_ACTION)


def _read_content(path: Path, limit: int) -> tuple[bytes, bool]:
    """Return the content of a file, and whether a compressed file is damaged or cut off."""
    with path.open("rb") as file:
        is_compressed = file.read(len(_GZIP_MAGIC)) == _GZIP_MAGIC
        file.seek(0)
        if not is_compressed:
            return file.read(), False
        blocks, size = list[bytes](), 0
        try:
            for block in _expand(file):
                blocks.append(block)
                size += len(block)
                if size > limit:
                    raise TrainingError(
                        f"expands to more than {limit / 2**20:.0f} MB",
                        code="memory-limit-exceeded",
                        where=path,
                        action="Expand it, and give the .xdf file",
                        limit=limit,
                    )
        except (EOFError, zlib.error):
            return b"".join(blocks), True
    return b"".join(blocks), False


def _expand(file: IO[bytes]) -> Iterator[bytes]:
    """Iterate over the content of a gzip file in blocks.

    In contrast to `gzip`, what is before damage is returned.

    Raises:
        zlib.error: If the file is damaged.
        EOFError: If it is cut off.
    """
    member, data = zlib.decompressobj(_GZIP_WINDOW), b""
    while data := data or file.read(_BLOCK_BYTES):
        if member.eof:
            member = zlib.decompressobj(_GZIP_WINDOW)
        yield member.decompress(data, _BLOCK_BYTES)
        data = member.unused_data if member.eof else member.unconsumed_tail
    while not member.eof and (block := member.decompress(b"", _BLOCK_BYTES)):
        yield block
    if not member.eof:
        raise EOFError


def load_streams(path: Path, limit: int) -> tuple[list[XdfStream], list[str]]:
    """Read the streams of a file in this process; see `read_streams`.

    Args:
        path: The file.
        limit: Largest number of bytes that a compressed file may expand to.
    """
    pyxdf = _library(path)
    content, is_cut = _read_content(path, limit)
    if not content.startswith(MAGIC):
        raise _wrong_format(path)
    chunks = find_sound_chunks(content)
    if is_cut and chunks.cut_at is None:
        chunks.cut_at = len(content)
    del content
    with np.errstate(all="ignore"):
        loaded, _ = pyxdf.load_xdf(
            io.BytesIO(chunks.to_file()),
            dejitter_timestamps=not chunks.damaged,  # it would spread a loss over the samples
            jitter_break_threshold_seconds=_MAX_SMOOTH_STEP_S,
            jitter_break_threshold_samples=_MAX_SMOOTH_STEPS,
        )
        streams = [_to_stream(chunks, entry) for entry in loaded]
    streams = [s for s in streams if len(s.time)]
    return streams, _describe_damage(chunks, streams)


def _to_stream(chunks: SoundChunks, loaded: dict[str, Any]) -> XdfStream:
    header = chunks.headers[loaded["info"]["stream_id"]]
    return XdfStream(
        header.number,
        header.name,
        header.kind,
        header.uid,
        header.labels,
        header.units,
        np.asarray(loaded["time_stamps"], float),
        np.asarray(loaded["time_series"], float),
        chunks.is_clock_lost(header.number),
    )


def _describe_damage(chunks: SoundChunks, streams: Sequence[XdfStream]) -> list[str]:
    """Return notes on what is missing in the streams."""
    notes = []
    if chunks.cut_at is not None:
        ends = [f"{s.name!r} {np.ptp(s.time):.1f} s" for s in streams[:_MAX_NAMED_STREAMS]]
        notes.append(
            f"the file is cut off or damaged from byte {chunks.cut_at} to its end; used is what is"
            f" before: {', '.join(ends) or 'nothing'}"
        )
    if chunks.damaged:
        lost = [(s.name, _lost_seconds(s, chunks.breaks[s.number])) for s in streams]
        shown = [f"{t:.1f} s of {name!r}" for name, t in lost if t > 0][:_MAX_NAMED_STREAMS]
        count = len(chunks.damaged)
        notes.append(
            f"the file is damaged in {count} place{'s' if count > 1 else ''}, first at byte"
            f" {chunks.damaged[0]}" + (f": {', '.join(shown)} are lost" if shown else "")
        )
    for stream in streams:
        stated, count = chunks.stated_rows.get(stream.number, 0), chunks.rows[stream.number]
        if stated > count:
            notes.append(f"{stated - count} of {stated} samples of {stream.name!r} are missing")
    endless = [s.name for s in streams if s.number not in chunks.stated_rows]
    if endless and chunks.cut_at is None:
        names = ", ".join(map(repr, endless[:_MAX_NAMED_STREAMS]))
        notes.append(f"the recording may have been interrupted: {names} has no end mark")
    if chunks.orphans - set(chunks.headers):
        numbers = ", ".join(map(str, sorted(chunks.orphans - set(chunks.headers))))
        notes.append(f"streams without a header are left out: number {numbers}")
    return notes


def _lost_seconds(stream: XdfStream, breaks: Sequence[int]) -> float:
    """Return the seconds that are missing where samples may be lost."""
    if len(stream.time) < 2:
        return 0.0
    step = float(np.median(np.diff(stream.time)))
    inner = [k for k in sorted(set(breaks)) if 0 < k < len(stream.time)]
    gaps = [float(stream.time[k] - stream.time[k - 1]) - step for k in inner]
    return sum(gap for gap in gaps if gap > step / 2)


def _main(folder: Path) -> None:
    """Read the file that the task names, and write its streams."""
    task = json.loads((folder / _TASK).read_text(encoding="utf-8"))
    path = Path(task["path"])
    try:
        logging.disable()  # of pyxdf
        streams, notes = load_streams(path, task["limit"])
    except TrainingError as error:
        result: dict[str, Any] = {"error": error_record(error)}
    except MemoryError:
        problem = "takes too much memory to read"
        result = {"error": error_record(_unreadable(path, problem, "memory-limit-exceeded"))}
    except Exception:  # pyxdf raises errors of any kind
        traceback.print_exc()
        problem = "is damaged, and cannot be read around the damage"
        result = {"error": error_record(_unreadable(path, problem, "file-damaged"))}
    else:
        names = ("number", "name", "kind", "uid", "labels", "units", "is_clock_lost")
        facts = [{name: getattr(s, name) for name in names} for s in streams]
        result = {"streams": facts, "notes": notes}
        arrays = {f"time{k}": s.time for k, s in enumerate(streams)}
        arrays |= {f"values{k}": s.values for k, s in enumerate(streams)}
        np.savez(folder / _ARRAYS, **arrays)  # type: ignore[arg-type]
    (folder / _RESULT).write_text(json.dumps(result), encoding="utf-8")


if __name__ == "__main__":
    start_child()
    _main(Path(sys.argv[1]))
