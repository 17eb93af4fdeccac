"""Find the sound chunks of an XDF file, up to and after damage.

An XDF file is a sequence of chunks: `[length][tag][content]`, of the file's header (tag 1), a
stream's header (2), samples (3), clock offsets (4), boundaries (5) and a stream's footer (6). They
have no checksums, but samples are checked completely: each must have a valid mark and time, and
their number must fill the chunk.

References:
    https://github.com/sccn/xdf/wiki/Specifications
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_left
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from .xdf_headers import (
    CLOCK_OFFSET,
    FOOTER,
    SAMPLES,
    STREAM_HEADER,
    StreamHeader,
    is_count,
    make_chunk,
    parse_header,
    parse_xml,
    xml_text,
)

MAGIC = b"XDF:"

_BOUNDARY = 5
_TAGS_OF_STREAMS = (STREAM_HEADER, SAMPLES, CLOCK_OFFSET, FOOTER)
_LENGTH_FORMATS = {1: "<B", 4: "<I", 8: "<Q"}
_CHUNK_START = re.compile(rb"(?=(?:\x01.|\x04.{4}|\x08.{8})[\x01-\x06]\x00)", re.DOTALL)
_BOUNDARY_ID = bytes.fromhex("43a546dccbf5410fb30ed5467383cbe4")
_TIME_BYTES = 8
_SECTOR = 512  # bytes of a disk's smallest block
_ZEROED = re.compile(rb"\x00{512,}")
_MAX_OUTER_ZEROS = 16  # zero bytes of sound values next to a zeroed sector
_MAX_OFFSET_ERROR_S = 1.0  # of a clock offset from those before and after, which agree


@dataclass
class SoundChunks:
    """What is sound of a file.

    Attributes:
        headers: Headers of the streams by their numbers.
        chunks: Samples, clock offsets and footers of the streams by their numbers, in order.
        rows: Number of samples of each stream.
        breaks: Of each stream, the samples before which others may be missing.
        stated_rows: Number of samples that the streams' footers state.
        damaged: Byte at which each damaged part starts.
        cut_at: Byte at which the file is cut off; None if it ends with a whole chunk.
        orphans: Numbers of streams whose headers are missing.
        with_clock: Numbers of the streams that have clock offsets.
    """

    headers: dict[int, StreamHeader] = field(default_factory=dict)
    chunks: list[tuple[int, bytes]] = field(default_factory=list)
    rows: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    breaks: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    stated_rows: dict[int, int] = field(default_factory=dict)
    damaged: list[int] = field(default_factory=list)
    cut_at: int | None = None
    orphans: set[int] = field(default_factory=set)
    with_clock: set[int] = field(default_factory=set)

    def is_clock_lost(self, number: int) -> bool:
        """Return whether the offsets of a stream's clock may be among what is damaged.

        In a file that is only cut off, all offsets of a stream can be missing only if those of
        other streams are not.
        """
        may_be = bool(self.damaged) or (self.cut_at is not None and bool(self.with_clock))
        return may_be and number not in self.with_clock

    def to_file(self) -> bytes:
        """Return a file of all streams of numbers that have samples."""
        headers = [h.to_chunk() for h in self.headers.values() if self.rows[h.number]]
        chunks = [chunk for number, chunk in self.chunks if self.rows[number]]
        return b"".join([MAGIC, *headers, *chunks])


@dataclass(frozen=True)
class _Chunk:
    """Frame of a chunk in the file; `end` may be beyond the file's end."""

    start: int
    content: int
    end: int
    tag: int
    stream: int


def find_sound_chunks(data: bytes) -> SoundChunks:
    """Return the sound chunks of a file.

    Damaged parts are left out; after them, samples are used from the next one whose time is stated.
    Of samples that the file's end cuts off, those before are used.

    Args:
        data: Content of the file.
    """
    return _Walk(data).run()


class _Walk:
    """One pass over a file."""

    def __init__(self, data: bytes) -> None:
        self._data = data[: _end_of_content(data)]
        self._is_zero_filled = len(self._data) < len(data)
        self._zeroed = _zeroed_sectors(self._data)
        self._out = SoundChunks()
        self._without_time = set[int]()  # streams whose next sample must state its time
        self._last_offset: _Chunk | None = None
        self._offsets: dict[int, list[tuple[int, float]]] = defaultdict(list)

    def run(self) -> SoundChunks:
        """Walk from the first to the last chunk."""
        position, end = len(MAGIC), len(self._data)
        while position < end:
            chunk = self._frame(position)
            if chunk is not None and self._accept(chunk):
                position = chunk.end
                continue
            following = self._next_sound(position + 1)
            if following is None:
                self._end_at(position, chunk)
                break
            self._out.damaged.append(position)
            self._remove_offset_before(position)
            self._break_streams()
            position = following
        else:
            if self._is_zero_filled:
                self._out.cut_at = end
        self._remove_wrong_offsets()
        return self._out

    def _frame(self, start: int) -> _Chunk | None:
        """Return the frame of the chunk at a byte, if there is one."""
        data = self._data
        after = start + 1 + data[start]
        if data[start] not in _LENGTH_FORMATS or after + 2 > len(data):
            return None
        length, tag = _integer(data, start), data[after] + 256 * data[after + 1]
        has_stream = tag in _TAGS_OF_STREAMS
        content = after + 2 + 4 * has_stream
        if not 1 <= tag <= FOOTER or content > min(after + length, len(data)):
            return None
        stream = struct.unpack_from("<I", data, content - 4)[0] if has_stream else -1
        return _Chunk(start, content, after + length, tag, stream)

    def _is_sound(self, chunk: _Chunk) -> bool:
        """Return whether a chunk is whole and its content valid."""
        if chunk.end > len(self._data) or self._is_zeroed(chunk):
            return False
        content = self._data[chunk.content : chunk.end]
        if chunk.tag == SAMPLES:
            header = self._out.headers.get(chunk.stream)
            if header is None:  # its end decides
                return self._is_chunk_end(chunk.end)
            if not header.has_numbers:
                return self._is_chunk_end(chunk.end)
            return self._whole_rows(chunk, header)[1]
        if chunk.tag == CLOCK_OFFSET:
            return len(content) == 16 and bool(np.isfinite(np.frombuffer(content, "<f8")).all())
        if chunk.tag == _BOUNDARY:
            return content == _BOUNDARY_ID
        if chunk.tag == STREAM_HEADER:
            return parse_header(chunk.stream, content) is not None
        return parse_xml(content) is not None

    def _accept(self, chunk: _Chunk) -> bool:
        """Add a chunk to the result if it is sound; return whether it is."""
        if not self._is_sound(chunk):
            return False
        data, out = self._data, self._out
        if chunk.tag == STREAM_HEADER:
            header = parse_header(chunk.stream, data[chunk.content : chunk.end])
            assert header is not None
            out.headers.setdefault(chunk.stream, header)
        elif chunk.stream not in out.headers:
            if chunk.tag == SAMPLES and chunk.stream not in out.orphans:
                out.orphans.add(chunk.stream)  # its header or its number is damaged
                out.damaged.append(chunk.start)
                self._break_streams()
        elif chunk.tag == SAMPLES and out.headers[chunk.stream].has_numbers:
            self._add_rows(chunk, *self._row_range(chunk))
        elif chunk.tag == CLOCK_OFFSET:
            value = struct.unpack_from("<d", data, chunk.content + 8)[0]
            out.with_clock.add(chunk.stream)
            self._offsets[chunk.stream].append((len(out.chunks), value))
            out.chunks.append((chunk.stream, data[chunk.start : chunk.end]))
            self._last_offset = chunk
        elif chunk.tag == FOOTER:
            self._add_footer(chunk)
        return True

    def _add_footer(self, chunk: _Chunk) -> None:
        count = xml_text(parse_xml(self._data[chunk.content : chunk.end]), "sample_count")
        if is_count(count):
            self._out.stated_rows[chunk.stream] = int(count)
            xml = f"<info><sample_count>{int(count)}</sample_count></info>".encode()
            footer = make_chunk(FOOTER, struct.pack("<I", chunk.stream) + xml)
            self._out.chunks.append((chunk.stream, footer))

    def _row_range(self, chunk: _Chunk) -> tuple[int, int]:
        """Return the first byte of the samples in a chunk and their number."""
        count_at = chunk.content
        return count_at + 1 + self._data[count_at], _integer(self._data, count_at)

    def _add_rows(self, chunk: _Chunk, first: int, count: int, end: int | None = None) -> None:
        """Add samples, from the first that states its time if others before may be missing."""
        data, out, number = self._data, self._out, chunk.stream
        rows = data[first : chunk.end if end is None else end]
        if number in self._without_time:
            skipped, row = 0, 1 + out.headers[number].row_bytes
            while skipped < count and not rows[skipped * row]:
                skipped += 1
            rows, count = rows[skipped * row :], count - skipped
            if not count:
                return
            self._without_time.discard(number)
        if count:
            out.rows[number] += count
            samples = struct.pack("<IBQ", number, 8, count) + rows
            out.chunks.append((number, make_chunk(SAMPLES, samples)))

    def _whole_rows(self, chunk: _Chunk, header: StreamHeader) -> tuple[int, bool, int]:
        """Return how many samples of a chunk are whole, whether it is valid, and their end.

        It is valid if they are as many as stated and fill the chunk.
        """
        data, last = self._data, min(chunk.end, len(self._data))
        count_at = chunk.content
        if count_at >= last or data[count_at] not in _LENGTH_FORMATS:
            return 0, False, count_at
        first = count_at + 1 + data[count_at]
        if first > last:
            return 0, False, count_at
        count, row = _integer(data, count_at), 1 + header.row_bytes
        if last - first == count * (row + _TIME_BYTES):  # each sample states its time
            rows = np.frombuffer(data, np.uint8, last - first, first).reshape(count, -1)
            times = rows[:, 1 : 1 + _TIME_BYTES].copy().view("<f8")
            if (rows[:, 0] == _TIME_BYTES).all() and np.isfinite(times).all():
                return count, True, last
        at = first
        for k in range(count):
            mark = data[at] if at < last else None
            following = at + row + (mark or 0)
            if mark is None or following > last:
                return k, False, at
            if mark not in (0, _TIME_BYTES):
                return 0, False, first
            if mark and not np.isfinite(struct.unpack_from("<d", data, at + 1)[0]):
                return 0, False, first
            at = following
        return count, at == last, at

    def _is_chunk_end(self, position: int) -> bool:
        """Return whether a chunk ends at a byte: another one, or the file's end, follows."""
        return position == len(self._data) or self._frame(position) is not None

    def _is_zeroed(self, chunk: _Chunk) -> bool:
        """Return whether a part of a chunk was lost with a sector of the disk."""
        k = bisect_left(self._zeroed, (chunk.end, 0)) - 1
        ranges = []
        while k >= 0 and self._zeroed[k][1] > chunk.start:
            ranges.append(self._zeroed[k])
            k -= 1
        return not all(self._are_values(chunk, *limits) for limits in ranges)

    def _are_values(self, chunk: _Chunk, start: int, end: int) -> bool:
        """Return whether a range of zeros is values of one sample, whose time is stated.

        It is if all values of the sample are zero, or the same ones of the sample before or after.
        """
        header = self._out.headers.get(chunk.stream)
        if chunk.tag != SAMPLES or header is None or not header.has_numbers:
            return False
        first, count = self._row_range(chunk)
        head, size = 1 + _TIME_BYTES, 1 + _TIME_BYTES + header.row_bytes
        if not count or chunk.end > len(self._data) or chunk.end - first != count * size:
            return False
        rows = np.frombuffer(self._data, np.uint8, count * size, first).reshape(count, size)
        row, low = divmod(start - first, size)
        high = min(end, chunk.end) - first - row * size
        if start < first or low < head or high > size:
            return False
        neighbors = rows[max(row - 1, 0) : row + 2, low:high]
        return high - low == header.row_bytes or int((~neighbors.any(axis=1)).sum()) > 1

    def _next_sound(self, position: int) -> int | None:
        """Return the start of the next chunk that is sound for certain."""
        for match in _CHUNK_START.finditer(self._data, position):
            chunk = self._frame(match.start())
            if chunk is None or (chunk.tag in (SAMPLES, CLOCK_OFFSET) and not self._knows(chunk)):
                continue
            if self._is_sound(chunk):
                return chunk.start
        return None

    def _knows(self, chunk: _Chunk) -> bool:
        header = self._out.headers.get(chunk.stream)
        return header is not None and (header.has_numbers or chunk.tag != SAMPLES)

    def _end_at(self, position: int, chunk: _Chunk | None) -> None:
        """End with what is left before the cut."""
        self._out.cut_at = position
        if chunk is None or chunk.tag != SAMPLES or not self._knows(chunk):
            return
        count, _, end = self._whole_rows(chunk, self._out.headers[chunk.stream])
        is_cut = chunk.end > len(self._data)
        if count and is_cut and not self._is_zeroed(chunk):
            self._add_rows(chunk, self._row_range(chunk)[0], count, end)

    def _break_streams(self) -> None:
        """Note that samples of any stream may be missing from here on."""
        for number, header in self._out.headers.items():
            if header.has_numbers:
                self._without_time.add(number)
                self._out.breaks[number].append(self._out.rows[number])

    def _remove_offset_before(self, position: int) -> None:
        """Remove a clock offset that ends where damage was found: its value may be damaged, too."""
        last = self._last_offset
        if last is None or last.end != position:
            return
        self._out.chunks.pop()
        self._offsets[last.stream].pop()
        if not self._offsets[last.stream]:
            self._out.with_clock.discard(last.stream)
        self._last_offset = None

    def _remove_wrong_offsets(self) -> None:
        """Remove clock offsets that differ from those before and after, which agree."""
        wrong = set[int]()
        for offsets in self._offsets.values():
            values = np.array([value for _, value in offsets])
            if len(values) < 3:
                continue
            step = np.abs(np.diff(values)) > _MAX_OFFSET_ERROR_S
            agree = np.abs(values[2:] - values[:-2]) <= _MAX_OFFSET_ERROR_S
            is_wrong = np.concatenate([[False], step[:-1] & step[1:] & agree, [False]])
            wrong |= {offsets[k][0] for k in np.flatnonzero(is_wrong).tolist()}
        if wrong:
            self._out.chunks = [c for k, c in enumerate(self._out.chunks) if k not in wrong]


def _integer(data: bytes, start: int) -> int:
    """Return an integer after a byte that states its length."""
    layout = _LENGTH_FORMATS[data[start]]
    if start + 1 + data[start] > len(data):
        return 0
    return int(struct.unpack_from(layout, data, start + 1)[0])


def _end_of_content(data: bytes) -> int:
    """Return the end of a file without the zeros that a crash leaves after it."""
    end = len(data.rstrip(b"\0"))
    return end if len(data) - end >= _SECTOR else len(data)


def _zeroed_sectors(data: bytes) -> list[tuple[int, int]]:
    """Return the ranges of zeros that start and end with sectors of the disk."""
    ranges = []
    for match in _ZEROED.finditer(data):
        start, end = match.span()
        if -start % _SECTOR <= _MAX_OUTER_ZEROS and end % _SECTOR <= _MAX_OUTER_ZEROS:
            ranges.append((start, end))
    return ranges
