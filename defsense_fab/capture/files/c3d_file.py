"""Read the points and parameters of C3D files.

The header and the parameters state the same sizes twice. Where they disagree, the header is used if
the file is exactly as long as it says and a third statement confirms it: the length of the
parameter section, the labels, or the residuals of the points. The length alone is no proof, because
a file may also be cut. Other files that disagree are refused. Nothing is allocated before sizes are
checked against the file's length. Analog samples are skipped.

References:
    The C3D user guide (c3d.org), "The header section", "The parameter section" and "The data
    section".
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from .c3d_parameters import BYTE_ORDER, DEC, MAX_FRAMES, Parameters, decode, parse_parameters
from .tracks_csv import unreadable_error

BLOCK_BYTES = 512
_MAGIC = 0x50
_MAX_BLOCKS = 255  # that the 8 bits of the parameter section's size can count
_SCALE_TOLERANCE = 1e-5  # relative, of two statements of a scale in single precision
_MAX_RESIDUAL = 2**15 - 1  # of 16 bits: seven cameras, and the residual in 8 bits
_RATE_TOLERANCE = 0.01  # relative, of the ratio of the rates of analog samples and frames


@dataclass(frozen=True)
class C3dFile:
    """The points of a C3D file.

    Attributes:
        points: Positions (t, m, 3) in the file's unit.
        is_absent: Whether a point has a negative residual (t, m).
        first: Number of the first frame, from 1.
        rate: Rate of the header, Hz; 0 if it is not stated.
        parameters: The parameters.
    """

    points: Float
    is_absent: Bool
    first: int
    rate: float
    parameters: Parameters


@dataclass(frozen=True)
class _Layout:
    """Sizes of the data section, by the header or the parameters.

    Attributes:
        start: First block, from 1.
        points: Points of a frame.
        analog: Analog values of a frame.
        frames: Number of frames.
        scale: Factor of points stored as whole numbers; negative for floats.
    """

    start: int
    points: int
    analog: int
    frames: int
    scale: float

    @property
    def word_bytes(self) -> int:
        return 4 if self.scale < 0 else 2

    @property
    def size(self) -> int:
        """Size of the data, bytes."""
        return self.frames * (4 * self.points + self.analog) * self.word_bytes

    def agrees_with(self, other: _Layout) -> bool:
        is_scale_alike = (
            self.scale < 0
            if other.scale < 0
            else math.isclose(self.scale, other.scale, rel_tol=_SCALE_TOLERANCE)
        )
        return is_scale_alike and replace(self, scale=other.scale) == other


@dataclass(frozen=True)
class _Evidence:
    """What a file states in addition to its layout.

    Attributes:
        size: Size of the file, bytes.
        processor: Type of the processor.
        first: Number of the first frame.
        samples: Analog samples of a frame and channel, by the header.
        section_end: First block after the parameter section, from 1; None if it is not stated.
    """

    size: int
    processor: int
    first: int
    samples: int
    section_end: int | None


def read_c3d_file(path: Path) -> C3dFile:
    """Read the points of a file, of any processor and storage.

    Raises:
        CaptureError: If the file cannot be read (`file-unreadable`), is not C3D (`not-a-c3d-file`),
            is damaged (`file-damaged`), ends early (`file-truncated`), or its header and parameters
            disagree (`header-differs`).
    """
    try:
        with path.open("rb") as file:
            return _read(path, file, path.stat().st_size)
    except OSError as error:
        raise unreadable_error(path, error) from None


def _read(path: Path, file: BinaryIO, size: int) -> C3dFile:
    head = file.read(BLOCK_BYTES)
    if len(head) < BLOCK_BYTES or head[1] != _MAGIC or head[0] < 1:
        raise _foreign(path, "it does not start like one")
    file.seek((head[0] - 1) * BLOCK_BYTES)
    start = file.read(4)
    if len(start) < 4:
        raise _truncated(path, "ends before its parameters")
    processor = start[3]
    if processor not in BYTE_ORDER:
        raise _foreign(path, f"there is no processor type {processor}")
    order = BYTE_ORDER[processor]
    n_points, n_analog, first, last, _ = struct.unpack(f"{order}5H", head[2:12])
    data_start, samples = struct.unpack(f"{order}2H", head[16:20])
    blocks = start[2] if 0 < start[2] < _MAX_BLOCKS else max(data_start - head[0], _MAX_BLOCKS)
    section = start + file.read(blocks * BLOCK_BYTES - len(start))
    parameters, length = parse_parameters(path, section, processor)
    scale, rate = (float(decode(head[i : i + 4], "f4", processor)[0]) for i in (12, 20))
    header = _Layout(data_start, n_points, n_analog, max(last - first + 1, 0), scale)
    header = _count_long_files(header, parameters, last, size)
    end = head[0] + start[2] if 0 < start[2] < _MAX_BLOCKS else None
    evidence = _Evidence(size, processor, first, samples, end)
    layout = _choose_layout(path, file, header, parameters, evidence)
    if layout.start < head[0] + -(-length // BLOCK_BYTES):
        raise CaptureError(
            f"its data start in block {layout.start}, before its parameters end",
            code="file-damaged",
            where=path,
            action="Copy it again",
        )
    file.seek((layout.start - 1) * BLOCK_BYTES)
    points, is_absent = _read_points(file.read(layout.size), layout, processor)
    rate = rate if math.isfinite(rate) and rate > 0 else 0.0
    return C3dFile(points, is_absent, first, rate, parameters)


def _count_long_files(header: _Layout, parameters: Parameters, last: int, size: int) -> _Layout:
    """Return the header's layout with all frames of files that have more than it can count."""
    ends = [parameters.numbers("TRIAL", f"ACTUAL_{end}_FIELD") for end in ("START", "END")]
    counts = [parameters.number("POINT", name) or 0 for name in ("LONG_FRAMES", "FRAMES")]
    if all(len(words) == 2 for words in ends):
        first, end = (low % 65536 + 65536 * (high % 65536) for low, high in ends)
        counts.append(end - first + 1)
    frames = int(max(counts))
    longer = replace(header, frames=frames)
    is_longer = last == MAX_FRAMES and frames > header.frames
    return longer if is_longer and _spare(longer, size) >= 0 else header


def _choose_layout(
    path: Path, file: BinaryIO, header: _Layout, parameters: Parameters, evidence: _Evidence
) -> _Layout:
    """Return the layout of the header, if the parameters agree or other statements confirm it."""
    other = _stated_layout(header, parameters, evidence.samples)
    header = replace(header, start=header.start or other.start, scale=header.scale or other.scale)
    _require_complete(path, header, evidence.first, evidence.size)
    if header.agrees_with(other):
        return header
    is_fitting = [0 <= _spare(x, evidence.size) < BLOCK_BYTES for x in (header, other)]
    if is_fitting == [True, False] and _is_confirmed(file, header, other, parameters, evidence):
        return header
    names = {
        "start": "the block of the data",
        "points": "points",
        "analog": "analog values of a frame",
        "frames": "frames",
        "scale": "the scale of points",
    }
    name = next(n for n in names if getattr(header, n) != getattr(other, n))
    stated, by_parameters = getattr(header, name), getattr(other, name)
    raise CaptureError(
        f"its header and its parameters disagree on {names[name]}: {stated:g} and"
        f" {by_parameters:g}",
        code="header-differs",
        where=path,
        action="Copy it again; if that does not help, export it again",
        name=name,
        header=stated,
        parameters=by_parameters,
    )


def _is_confirmed(
    file: BinaryIO, header: _Layout, other: _Layout, parameters: Parameters, evidence: _Evidence
) -> bool:
    """Return whether other statements confirm a header that the parameters contradict.

    Each size that differs needs its own confirmation. A number of frames needs none: those that
    the file has are read right with either.
    """
    if header.start != other.start:
        # Blocks before the data are empty, and the data are not.
        low, high = sorted([header.start, other.start])
        file.seek((low - 1) * BLOCK_BYTES)
        is_empty = not any(file.read((high - low) * BLOCK_BYTES))
        if header.start != evidence.section_end or is_empty != (header.start == high):
            return False
    if header.points != other.points and header.points != len(parameters.texts("POINT", "LABELS")):
        return False
    channels = len(parameters.texts("ANALOG", "LABELS"))
    if header.analog != other.analog and header.analog != channels * evidence.samples:
        return False
    if replace(header, frames=other.frames).agrees_with(other):
        return True
    file.seek((header.start - 1) * BLOCK_BYTES)
    return _has_valid_residuals(file.read(header.size), header, evidence.processor)


def _stated_layout(header: _Layout, parameters: Parameters, samples: int) -> _Layout:
    """Return the layout by the parameters; what they do not state is the header's."""
    channels = parameters.count("ANALOG", "USED")
    rates = [parameters.number(group, "RATE") or 0.0 for group in ("ANALOG", "POINT")]
    analog = header.analog
    if channels is not None:
        if min(rates) > 0 and abs(rates[0] / rates[1] - round(rates[0] / rates[1])) < (
            _RATE_TOLERANCE * rates[0] / rates[1]
        ):
            samples = round(rates[0] / rates[1])
        analog = channels * samples if samples or not channels else header.analog
    frames = parameters.count("POINT", "FRAMES")
    is_counted = frames is not None and frames < MAX_FRAMES and header.frames < MAX_FRAMES
    points, start = parameters.count("POINT", "USED"), parameters.count("POINT", "DATA_START")
    scale = parameters.number("POINT", "SCALE")
    return _Layout(
        start or header.start,
        header.points if points is None else points,
        analog,
        frames if is_counted and frames is not None else header.frames,
        scale or header.scale,
    )


def _spare(layout: _Layout, size: int) -> int:
    """Return how many bytes the file has after the data; negative if it ends before."""
    return size - (layout.start - 1) * BLOCK_BYTES - layout.size if layout.start > 1 else -1


def _require_complete(path: Path, layout: _Layout, first: int, size: int) -> None:
    available = max(size - max(layout.start - 1, 0) * BLOCK_BYTES, 0)
    if available < layout.size:
        last = first + layout.frames - 1
        raise _truncated(
            path,
            f"is truncated: frames {first} to {last} need {layout.size} bytes, but it has"
            f" {available}",
            first=first,
            last=last,
            needed=layout.size,
        )


@np.errstate(invalid="ignore")  # signaling NaN of other programs' memory
def _read_points(data: bytes, layout: _Layout, processor: int) -> tuple[Float, Bool]:
    """Return positions (t, m, 3) and which are absent (t, m)."""
    table = _read_table(data, layout, processor)
    if layout.scale >= 0:
        return table[..., :3] * layout.scale, table[..., 3] < 0
    return table[..., :3].astype(float), ~(table[..., 3] >= 0)


def _read_table(data: bytes, layout: _Layout, processor: int) -> Float:
    """Return the four stored numbers of each point (t, m, 4): its place and its residual."""
    t, m = layout.frames, layout.points
    if not (t and m):
        return np.empty((t, m, 4))
    order = BYTE_ORDER[processor]
    if layout.scale < 0 and processor == DEC:
        words = np.frombuffer(data, "<u2").reshape(t, -1, 2)[:, : 4 * m, ::-1]
        return np.ascontiguousarray(words).view("<f4").reshape(t, m, 4).astype(float) / 4
    kind = "f4" if layout.scale < 0 else "i2"
    return np.frombuffer(data, f"{order}{kind}").reshape(t, -1)[:, : 4 * m].reshape(t, m, 4)


@np.errstate(invalid="ignore")
def _has_valid_residuals(data: bytes, layout: _Layout, processor: int) -> bool:
    """Return whether the fourth number of every point can be a residual with its cameras."""
    residual = _read_table(data, layout, processor)[..., 3]
    is_in_range = (residual >= -1) & (residual <= _MAX_RESIDUAL)
    return bool(is_in_range.all() and (residual == np.rint(residual)).all())


def _foreign(path: Path, reason: str) -> CaptureError:
    return CaptureError(
        f"is not a C3D file ({reason})",
        code="not-a-c3d-file",
        where=path,
        action="Choose another file",
    )


def _truncated(path: Path, problem: str, **data: object) -> CaptureError:
    return CaptureError(problem, code="file-truncated", where=path, action="Copy it again", **data)
