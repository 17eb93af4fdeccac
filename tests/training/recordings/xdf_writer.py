"""A writer of XDF files, by the specification (sccn/xdf), for tests of reading."""

from __future__ import annotations

import struct
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np


def chunk(tag: int, content: bytes) -> bytes:
    """Return [bytes of the length][length of tag and content][tag][content]."""
    return b"\x04" + struct.pack("<I", len(content) + 2) + struct.pack("<H", tag) + content


def stream(
    number: int,
    name: str,
    kind: str,
    labels: list[str],
    time: np.ndarray,
    values: np.ndarray,
    *,
    units: str = "",
    rate: float = 0.0,
    clock: float = 0.0,
) -> tuple[bytes, bytes, bytes]:
    """Return header, samples and footer of a stream of doubles.

    Its clock is `clock` s ahead of the recorder's.
    """
    head = struct.pack("<I", number)
    of = "".join(
        f"<channel><label>{escape(label)}</label><unit>{units}</unit></channel>" for label in labels
    )
    header = (
        f'<?xml version="1.0"?><info><name>{name}</name><type>{kind}</type>'
        f"<channel_count>{values.shape[1]}</channel_count><nominal_srate>{rate}</nominal_srate>"
        f"<channel_format>double64</channel_format><created_at>0</created_at>"
        f"<desc><channels>{of}</channels></desc></info>"
    )
    chunks = [
        chunk(4, head + struct.pack("<dd", t - clock, -clock)) for t in (time[0], time[-1])
    ]  # clock offsets at times of the recorder
    for k in range(0, len(time), 100):
        rows = b"".join(
            b"\x08" + struct.pack("<d", t + clock) + np.asarray(row, "<f8").tobytes()
            for t, row in zip(time[k : k + 100], values[k : k + 100], strict=True)
        )
        count = len(time[k : k + 100])
        chunks.append(chunk(3, head + b"\x04" + struct.pack("<I", count) + rows))
    footer = (
        f'<?xml version="1.0"?><info><first_timestamp>{time[0]}</first_timestamp>'
        f"<last_timestamp>{time[-1]}</last_timestamp><sample_count>{len(time)}</sample_count></info>"
    )
    return chunk(2, head + header.encode()), b"".join(chunks), chunk(6, head + footer.encode())


def write_xdf(path: Path, *streams: tuple[bytes, bytes, bytes]) -> Path:
    head = b'<?xml version="1.0"?><info><version>1.0</version></info>'
    parts = [b"XDF:", chunk(1, head)]
    parts += [s[k] for k in range(3) for s in streams]
    path.write_bytes(b"".join(parts))
    return path
