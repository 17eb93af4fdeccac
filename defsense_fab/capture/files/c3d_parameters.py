"""Parse the parameter section of C3D files, and numbers as processors store them.

References:
    The C3D user guide (c3d.org), "The parameter section".
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError

MAX_FRAMES = 65535  # that the header's 16 bits can count
_INTEL, DEC, _SGI = 84, 85, 86
BYTE_ORDER = {_INTEL: "<", DEC: "<", _SGI: ">"}
#: NumPy type by the number of a parameter's type; -1 is text.
_TYPES = {-1: "S1", 1: "u1", 2: "i2", 4: "f4"}


@dataclass(frozen=True)
class Parameters:
    """Parameters of a C3D file, by group and name in upper case.

    Attributes:
        values: Arrays of numbers, or tuples of texts.
    """

    values: dict[tuple[str, str], Float | tuple[str, ...]]

    def has_group(self, group: str) -> bool:
        """Return whether a group has parameters."""
        return any(key[0] == group for key in self.values)

    def texts(self, group: str, name: str) -> list[str]:
        """Return a list of texts, which continues in NAME2, NAME3, ... after 255."""
        texts: list[str] = []
        key, i = name, 1
        while isinstance(part := self.values.get((group, key)), tuple):
            texts += part
            i += 1
            key = f"{name}{i}"
        return texts

    def numbers(self, group: str, name: str) -> list[float]:
        """Return the numbers of a parameter; empty if it is missing or text."""
        value = self.values.get((group, name))
        return [] if value is None or isinstance(value, tuple) else value.tolist()

    def number(self, group: str, name: str) -> float | None:
        """Return the first number of a parameter; None if it has no numbers."""
        return next((x for x in self.numbers(group, name) if math.isfinite(x)), None)

    def count(self, group: str, name: str) -> int | None:
        """Return a parameter that counts without sign, in 16 bits or as a float."""
        number = self.number(group, name)
        return None if number is None else int(number) % (MAX_FRAMES + 1)


def parse_parameters(path: Path, data: bytes, processor: int) -> tuple[Parameters, int]:
    """Return the parameters of a section, after its head of four bytes, and its length.

    A record is: length of the name (negative if locked), number of the group (negative for a group
    itself), name, offset to the next record, and for parameters type, dimensions and values. A
    description follows; it is not read.
    """
    order = BYTE_ORDER[processor]
    groups: dict[int, str] = {}
    records: dict[tuple[int, str], Float | tuple[str, ...]] = {}
    at, step = 4, 1
    while step and at + 2 <= len(data):
        length, group = struct.unpack_from("2b", data, at)
        if length == 0 or group == 0:
            break
        name_end = at + 2 + abs(length)
        if name_end + 2 > len(data):
            raise _damaged(path)
        name = data[at + 2 : name_end].decode("latin-1").strip().upper()
        (step,) = struct.unpack_from(f"{order}H", data, name_end)
        at = name_end + step
        end = at if step else len(data)
        if end > len(data):
            raise _damaged(path)
        if group < 0:
            groups[-group] = name
        else:
            records[group, name] = _parse_value(path, data[name_end + 2 : end], processor)
    values = {(groups[group], name): x for (group, name), x in records.items() if group in groups}
    return Parameters(values), at


def _parse_value(path: Path, data: bytes, processor: int) -> Float | tuple[str, ...]:
    """Return the value of a parameter: a flat array of numbers, or texts."""
    if len(data) < 2 or len(data) < 2 + data[1]:
        raise _damaged(path)
    (kind,) = struct.unpack_from("b", data)
    shape = tuple(data[2 : 2 + data[1]])
    if kind not in _TYPES:
        raise _damaged(path)
    raw = data[2 + len(shape) :][: abs(kind) * math.prod(shape)]
    if len(raw) < abs(kind) * math.prod(shape):
        raise _damaged(path)
    if kind != -1:
        return decode(raw, _TYPES[kind], processor)
    width = shape[0] if shape else 1
    rows = [raw[i : i + width] for i in range(0, len(raw), width or 1)]
    return tuple(_text(row) for row in rows)


def _text(raw: bytes) -> str:
    raw = raw.replace(b"\0", b" ")
    try:
        return raw.decode("utf-8").strip()
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace").strip()


def decode(raw: bytes, kind: str, processor: int) -> Float:
    """Return stored numbers as floats (n,)."""
    if kind == "f4" and processor == DEC:  # swapped words, and an exponent that is larger by two
        words = np.frombuffer(raw, "<u2").reshape(-1, 2)[:, ::-1]
        return np.ascontiguousarray(words).view("<f4").ravel().astype(float) / 4
    return np.frombuffer(raw, f"{BYTE_ORDER[processor]}{kind}").astype(float)


def _damaged(path: Path) -> CaptureError:
    return CaptureError(
        "its parameters are damaged", code="file-damaged", where=path, action="Copy it again"
    )
