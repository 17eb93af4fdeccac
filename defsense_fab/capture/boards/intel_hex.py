"""Read Intel HEX files, the format of compiled firmware.

References:
    Intel, "Hexadecimal Object File Format Specification", revision A, 1988.
"""

from __future__ import annotations

from pathlib import Path

from ...core.errors import CaptureError

ERASED = 0xFF  # value of the bytes of flash memory that no record sets
_DATA, _END, _SEGMENT, _SEGMENT_START, _LINEAR, _LINEAR_START = range(6)
#: Address records, and the number of bits by which they shift the addresses of the data.
_ADDRESS_SHIFTS = {_SEGMENT: 4, _LINEAR: 16}
_MIN_RECORD_BYTES = 5  # length, address, type and checksum
_MAX_IMAGE_BYTES = 1 << 20  # a larger address is not that of a microcontroller


def read_intel_hex(path: Path) -> bytes:
    """Read an Intel HEX file.

    Args:
        path: The file.

    Returns:
        The memory from address 0 to the last byte; gaps are filled with 0xFF.

    Raises:
        CaptureError: The file cannot be read (`hex-not-readable`), or is not a valid Intel HEX file
            (`hex-invalid`).
    """
    try:
        text = path.read_text("ascii")
    except OSError as error:
        raise CaptureError(
            f"cannot be read ({error.strerror})",
            code="hex-not-readable",
            where=path,
            action="Install defsense-fab again",
        ) from None
    except UnicodeDecodeError:
        raise _invalid(path, 1, "it is not text") from None
    image, base = bytearray(), 0
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        kind, address, data = _parse_record(path, number, line.strip())
        if kind == _END:
            return bytes(image)
        if kind == _DATA:
            _place(image, base + address, data, path, number)
        elif kind in _ADDRESS_SHIFTS and len(data) == 2:
            base = int.from_bytes(data, "big") << _ADDRESS_SHIFTS[kind]
        elif kind not in (_SEGMENT_START, _LINEAR_START):
            raise _invalid(path, number, f"its record of type {kind} is unknown")
    raise _invalid(path, text.count("\n") + 1, "its end is missing")


def _parse_record(path: Path, number: int, line: str) -> tuple[int, int, bytes]:
    """Return type, address and data of a record."""
    try:
        record = bytes.fromhex(line[1:])
    except ValueError:
        record = b""
    if line[0] != ":" or len(record) < _MIN_RECORD_BYTES or " " in line:
        raise _invalid(path, number, "it is not a record")
    if len(record) != record[0] + _MIN_RECORD_BYTES:
        raise _invalid(path, number, "the record has another length than it states")
    if sum(record) % 256:
        raise _invalid(path, number, "the checksum is wrong")
    return record[3], int.from_bytes(record[1:3], "big"), record[4:-1]


def _place(image: bytearray, start: int, data: bytes, path: Path, number: int) -> None:
    end = start + len(data)
    if end > _MAX_IMAGE_BYTES:
        raise _invalid(path, number, f"its address {start:#x} is too large")
    image.extend([ERASED] * (end - len(image)))
    image[start:end] = data


def _invalid(path: Path, line: int, problem: str) -> CaptureError:
    return CaptureError(
        f"is not a valid Intel HEX file: {problem}",
        code="hex-invalid",
        where=f"{path}, line {line}",
        action="Build or download the file again",
        line=line,
    )
