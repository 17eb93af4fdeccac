"""What the first blocks of a C3D file promise, held against the length of the file.

ezc3d reads as many frames as there are in a file that was cut, and says nothing; parameters whose
sizes are wrong can crash it. Layout: the C3D user guide (c3d.org), "The header section" and "The
parameter section".
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

from ...core.errors import CaptureError

_BLOCK = 512
_MAGIC = 0x50
_MOST_BLOCKS = 256
#: By the processor's number: order of bytes, and the byte of a float that has the sign.
_PROCESSORS = {84: ("<", 3), 85: ("<", 1), 86: (">", 0)}  # Intel, DEC, MIPS
#: Most frames that the header's 16 bits can count.
MOST_FRAMES = 65535


def check_whole(path: Path) -> None:
    """Raises CaptureError for a file that is no C3D file, or ends before its last frame."""
    try:
        with path.open("rb") as file:
            head = file.read(_BLOCK)
            if len(head) < _BLOCK or head[1] != _MAGIC or head[0] < 1:
                raise CaptureError(
                    f"{path}: is no C3D file (it does not begin like one)", code="not-a-c3d-file"
                )
            file.seek((head[0] - 1) * _BLOCK)
            parameters = file.read(_BLOCK * _MOST_BLOCKS)
            size = file.seek(0, 2)
    except OSError as error:
        raise CaptureError(
            f"{path}: cannot be read: {error.strerror}", code="file-unreadable"
        ) from None
    if len(parameters) < 4:
        raise CaptureError(
            f"{path}: is cut short before its parameters; copy it again", code="file-truncated"
        )
    if parameters[3] not in _PROCESSORS:
        raise CaptureError(
            f"{path}: is no C3D file (no processor has the number {parameters[3]})",
            code="not-a-c3d-file",
        )
    order, sign = _PROCESSORS[parameters[3]]
    if not _sound(parameters, order):
        raise CaptureError(
            f"{path}: its parameters are damaged; copy it again", code="file-damaged"
        )
    points, analog, first, last = struct.unpack(f"{order}4H", head[2:10])
    (start,) = struct.unpack(f"{order}H", head[16:18])
    width = 4 if head[12 + sign] & 0x80 else 2  # a negative scale stands for data stored as floats
    needed = max(last - first + 1, 0) * (4 * points + analog) * width
    there = max(size - (start - 1) * _BLOCK, 0)
    if there < needed:
        raise CaptureError(
            f"{path}: is cut short: frames {first} to {last} need {needed} bytes, and there are"
            f" {there}; copy it again",
            code="file-truncated",
            first=first,
            last=last,
            needed=needed,
        )


def _sound(data: bytes, order: str) -> bool:
    """Whether groups and parameters follow each other to the last, each with the bytes it says."""
    at, kinds = 4, (-1, 1, 2, 4)
    while at + 2 <= len(data):
        length, group = struct.unpack_from("2b", data, at)
        if length == 0 or group == 0:
            return True
        at += 2 + abs(length)
        if at + 4 > len(data):
            return False
        (step,) = struct.unpack_from(f"{order}H", data, at)
        if group > 0:
            (kind,) = struct.unpack_from("b", data, at + 2)
            shape = data[at + 4 : at + 4 + data[at + 3]]
            end = at + 4 + len(shape) + abs(kind) * math.prod(shape)
        else:
            kind, end = 1, at + 2
        # A text of description comes last, its length before it.
        if kind not in kinds or end >= len(data) or (step and end + 1 + data[end] > at + step):
            return False
        if step == 0:
            return True
        at += step
    return False
