"""An independent reader and writer of C3D after the C3D user guide (c3d.org)."""

import struct
from dataclasses import dataclass

import numpy as np

INTEL, DEC, MIPS = 84, 85, 86


@dataclass
class File:
    """Content of a file: points (t, m, 3), scaled, and residuals (t, m), negative where missing."""

    points: np.ndarray
    residual: np.ndarray
    first: int
    rate: float
    labels: list[str]
    units: str
    parameters: dict


def _floats(data, processor):
    """Return 4-byte floats as they are stored."""
    if processor == DEC:  # words swapped, exponent two higher
        words = np.frombuffer(data, "<u2").reshape(-1, 2)[:, ::-1]
        return np.ascontiguousarray(words).view("<f4").ravel().astype(float) / 4
    return np.frombuffer(data, "<f4" if processor == INTEL else ">f4").astype(float)


def _stored(values, processor):
    values = np.asarray(values, "<f4").ravel()
    if processor == DEC:
        words = (values * np.float32(4)).view("<u2").reshape(-1, 2)[:, ::-1]
        return np.ascontiguousarray(words).tobytes()
    return values.astype("<f4" if processor == INTEL else ">f4").tobytes()


def parse(data: bytes) -> File:
    block = (data[0] - 1) * 512
    assert data[1] == 0x50
    processor = data[block + 3]
    e = ">" if processor == MIPS else "<"
    n_points, n_analog, first, last, _, start = struct.unpack(f"{e}5H", data[2:12]) + struct.unpack(
        f"{e}H", data[16:18]
    )
    scale = _floats(data[12:16], processor)[0]
    parameters, groups, at = {}, {}, block + 4
    while True:
        length, group = struct.unpack("bb", data[at : at + 2])
        if group == 0:
            break
        name = data[at + 2 : at + 2 + abs(length)].decode("latin-1").upper()
        at += 2 + abs(length)
        (step,) = struct.unpack(f"{e}h", data[at : at + 2])
        if group < 0:
            groups[-group] = name
        else:
            kind, dims = struct.unpack("b", data[at + 2 : at + 3])[0], data[at + 3]
            shape = list(data[at + 4 : at + 4 + dims])
            raw = data[at + 4 + dims :][: abs(kind) * int(np.prod(shape))]
            if kind == -1:
                width = shape[0] if shape else 1
                rows = [raw[i : i + width] for i in range(0, len(raw), width or 1)]
                value = [row.decode("latin-1").strip() for row in rows]
            elif kind == 1:
                value = list(raw)
            elif kind == 2:
                value = np.frombuffer(raw, f"{e}i2").tolist()
            else:
                value = _floats(raw, processor).tolist()
            parameters[group, name] = value
        if step == 0:
            break
        at += step
    named = {(groups[g], name): value for (g, name), value in parameters.items()}
    frames, width = last - first + 1, 4 if scale < 0 else 2
    body = data[(start - 1) * 512 :][: frames * (4 * n_points + n_analog) * width]
    integers = np.frombuffer(body, f"{e}i2").astype(float)
    table = _floats(body, processor) if scale < 0 else integers
    table = table.reshape(frames, -1)[:, : 4 * n_points].reshape(frames, n_points, 4)
    words = table[..., 3].astype(np.int64)
    residual = np.where(words < 0, -1.0, (words & 0xFF) * abs(scale))
    return File(
        points=table[..., :3] * (1.0 if scale < 0 else scale),
        residual=residual,
        first=first,
        rate=named["POINT", "RATE"][0],
        labels=named["POINT", "LABELS"][:n_points],
        units=named["POINT", "UNITS"][0],
        parameters=named,
    )


def build(points, labels, rate, units="mm", processor=INTEL, scale=-1.0, first=1) -> bytes:
    """Return a file of points (t, m, 3), NaN where missing; scale > 0 stores integers."""
    e = ">" if processor == MIPS else "<"
    t, m = points.shape[:2]

    def group(number, name):
        return struct.pack("bb", len(name), -number) + name + struct.pack(f"{e}hB", 3, 0)

    def parameter(number, name, kind, shape, raw):
        body = struct.pack("bB", kind, len(shape)) + bytes(shape) + raw + b"\0"
        return (
            struct.pack("bb", len(name), number) + name + struct.pack(f"{e}h", 2 + len(body)) + body
        )

    def whole(value):
        return struct.pack(f"{e}H", value)

    width = max([len(label) for label in labels], default=1)
    text = b"".join(label.encode().ljust(width) for label in labels)
    start = 2 + 4
    body = (
        group(1, b"POINT")
        + parameter(1, b"USED", 2, [], whole(m))
        + parameter(1, b"FRAMES", 2, [], whole(t))
        + parameter(1, b"DATA_START", 2, [], whole(start))
        + parameter(1, b"SCALE", 4, [], _stored([scale], processor))
        + parameter(1, b"RATE", 4, [], _stored([rate], processor))
        + parameter(1, b"UNITS", -1, [len(units)], units.encode())
        + parameter(1, b"LABELS", -1, [width, m], text)
        + group(2, b"ANALOG")
        + parameter(2, b"USED", 2, [], whole(0))
    )
    # The last has a step of 0 to say so.
    last = parameter(2, b"RATE", 4, [], _stored([0.0], processor))
    last = last[:6] + b"\0\0" + last[8:]
    parameters = bytes([1, 0x50, start - 2, processor]) + body + last
    assert len(parameters) <= 512 * (start - 2)
    head = bytes([2, 0x50]) + struct.pack(f"{e}5H", m, 0, first, first + t - 1, 0)
    head += _stored([scale], processor) + struct.pack(f"{e}2H", start, 0)
    head += _stored([rate], processor)
    gone = np.isnan(points[..., :1])
    quads = np.concatenate([np.where(gone, 0, points), np.where(gone, -1.0, 0.0)], -1)
    if scale < 0:
        data = _stored(quads, processor)
    else:
        quads[..., :3] = np.rint(quads[..., :3] / scale)
        data = quads.astype(f"{e}i2").tobytes()
    whole_file = head.ljust(512, b"\0") + parameters.ljust(512 * (start - 2), b"\0") + data
    return whole_file + bytes(-len(whole_file) % 512)
