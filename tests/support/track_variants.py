"""Variants of C3D and TRC files of other programs, with the tracks that are right for them."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

Rng = np.random.Generator
INTEL, DEC, SGI = 84, 85, 86
UNITS = {
    "mm": 1, "MM": 1, "Millimeters": 1, "mill": 1, "cm": 10, "centimetres": 10, "m": 1000,
    "mete": 1000, "Meters": 1000,
}  # fmt: skip


@dataclass
class Variant:
    """A file, and what it means.

    Attributes:
        content: The bytes of the file.
        ids: Numbers of the markers that are to be read.
        points: Their positions (t, m, 3), mm; NaN where absent.
        time: Times (t,), s.
        tolerance: Allowed difference of positions, mm.
        traits: What is special about the file.
        must_read: Whether the file is sound, and so must not be refused.
    """

    content: bytes
    ids: list[int]
    points: np.ndarray
    time: np.ndarray
    tolerance: float
    traits: list[str] = field(default_factory=list)
    must_read: bool = True


def _pick(rng: Rng, *items):
    return items[int(rng.integers(len(items)))]


def labels_of(rng: Rng) -> tuple[list[str], list[int], list[int]]:
    """Return labels, the columns that are to be read, and their numbers."""
    count = int(rng.integers(1, 6))
    numbers = rng.choice(np.arange(1, 90), count, replace=False).tolist()
    subject = _pick(rng, "", "", "bar:", "My Bar.")
    style = _pick(rng, "tag", "tag", "tag", "end", "order")
    if style == "order":
        return [f"{'ABCDEF'[k]}SI" for k in range(count)], list(range(count)), list(range(count))
    name = "tag_" if style == "tag" else _pick(rng, "M", "marker")
    labels = [f"{subject}{name}{number}" for number in numbers]
    others = ["*60", f"{labels[0]}*1", "Unlabeled 1001", "*7"]
    if style == "tag":
        others += ["wand", "LASI", "wand4", "xtag_5x", "C7"]
    extra = rng.choice(others, int(rng.integers(0, 4)), replace=False).tolist()
    order = rng.permutation(count + len(extra))
    columns = [int(np.flatnonzero(order == k)[0]) for k in range(count)]
    ranked = sorted(zip(columns, numbers, strict=True))
    all_labels = [(labels + extra)[k] for k in order]
    return all_labels, [c for c, _ in ranked], [n for _, n in ranked]


def points_of(rng: Rng, frames: int, count: int, mm_per_unit: float) -> np.ndarray:
    """Return positions (t, m, 3) in a unit; 15 % are NaN."""
    points = rng.uniform(-500, 500, (frames, count, 3)) / mm_per_unit
    points[rng.random((frames, count)) < 0.15] = np.nan
    return points


# ---- C3D ----


def _floats(values, processor: int) -> bytes:
    values = np.asarray(values, "<f4").ravel()
    if processor == DEC:  # words swapped, exponent two higher
        words = (values * np.float32(4)).view("<u2").reshape(-1, 2)[:, ::-1]
        return np.ascontiguousarray(words).tobytes()
    return values.astype(">f4" if processor == SGI else "<f4").tobytes()


class _Section:
    """The parameter section."""

    def __init__(self, rng: Rng, processor: int) -> None:
        self.rng, self.processor, self.body = rng, processor, b""
        self.order = ">" if processor == SGI else "<"

    def _describe(self) -> bytes:
        length = int(_pick(self.rng, 0, 0, 20, 127, 128, 163, 255))
        return bytes([length]) + b"x" * length

    def _record(self, number: int, name: str, body: bytes, ends: bool = False) -> None:
        sign = int(_pick(self.rng, 1, 1, -1))  # locked
        raw = name.encode()
        step = 0 if ends else 2 + len(body)
        self.body += struct.pack("2b", sign * len(raw), number) + raw
        self.body += struct.pack(f"{self.order}H", step) + body

    def group(self, number: int, name: str) -> None:
        self._record(-number, name, self._describe())

    def texts(self, number: int, name: str, texts: list[str], width: int = 0) -> None:
        rows = [text.encode() for text in texts]
        width = max([width, 1, *map(len, rows)])
        body = struct.pack("b3B", -1, 2, width, len(rows)) + b"".join(r.ljust(width) for r in rows)
        self._record(number, name, body + self._describe())

    def words(self, number: int, name: str, values: list[int], ends: bool = False) -> None:
        raw = b"".join(struct.pack(f"{self.order}H", v % 65536) for v in values)
        shape = [] if len(values) == 1 else [len(values)]
        body = struct.pack("bB", 2, len(shape)) + bytes(shape) + raw
        self._record(number, name, body + self._describe(), ends)

    def floats(self, number: int, name: str, values: list[float]) -> None:
        shape = [] if len(values) == 1 else [len(values)]
        body = struct.pack("bB", 4, len(shape)) + bytes(shape) + _floats(values, self.processor)
        self._record(number, name, body + self._describe())


def c3d_variant(rng: Rng) -> Variant:
    """Return a file whose header and parameters may disagree, of any processor and storage."""
    labels, columns, ids = labels_of(rng)
    unit = _pick(rng, *UNITS)
    processor, is_float = _pick(rng, INTEL, DEC, SGI), bool(rng.random() < 0.6)
    t, m, first = int(rng.integers(1, 40)), len(labels), int(_pick(rng, 1, 1, 61, 40000))
    rate = float(_pick(rng, 50, 100, 120))
    analog, samples = int(_pick(rng, 0, 0, 3, 6)), int(_pick(rng, 1, 2, 10))
    points = points_of(rng, t, m, UNITS[unit])
    scale = -1.0 if is_float else float(np.float32(1000 / UNITS[unit] / 32000))
    state = {"points": m, "analog": analog * samples, "frames": t, "start": 0, "scale": scale}
    header, stated, traits, must_read = _disagree(rng, dict(state))
    traits += [f"processor {processor}", "floats" if is_float else "integers", unit]

    section = _Section(rng, processor)
    section.group(1, "POINT")
    section.group(2, "ANALOG")
    section.words(1, "USED", [stated["points"]])
    section.words(1, "FRAMES", [stated["frames"]])
    section.floats(1, "SCALE", [stated["scale"]])
    section.floats(1, "RATE", [rate])
    others = ["LKneeAngles"] if rng.random() < 0.3 and ids != list(range(m)) else []
    section.texts(1, "LABELS", labels)
    section.texts(1, "UNITS", [unit])
    section.texts(1, "ANGLES", ["LKneeAngles", *others])
    section.words(2, "USED", [stated["analog"] // samples])
    if analog:
        section.texts(2, "LABELS", [f"Ch{k}" for k in range(analog)])
        if rng.random() < 0.6 or stated["analog"] != header["analog"]:
            section.floats(2, "RATE", [rate * samples])
        if rng.random() < 0.5:
            section.floats(2, "OFFSET", [0.0] * analog)
    ends = bool(rng.random() < 0.5)
    size = 4 + len(section.body) + 300
    blocks = -(-size // 512) + int(_pick(rng, 0, 0, 3))
    start = 2 + blocks
    header["start"] += start
    section.words(1, "DATA_START", [start + stated["start"]], ends=ends)
    body = section.body + (b"" if ends else b"\0\0")
    count = int(_pick(rng, blocks, blocks, blocks, 0))
    raw = bytes([int(_pick(rng, 0, 1)), 0x50, count, processor]) + body
    assert len(raw) <= blocks * 512
    data, is_absent = _c3d_data(rng, points, scale, processor, analog * samples)
    o = section.order
    head = bytes([2, 0x50]) + struct.pack(
        f"{o}5H", header["points"], header["analog"], first, first + header["frames"] - 1, 10
    )
    head += _floats([header["scale"]], processor)
    head += struct.pack(f"{o}2H", header["start"], samples if analog else 0)
    head += _floats([rate], processor)
    content = head.ljust(512, b"\0") + raw.ljust(512 * blocks, b"\0") + data
    if rng.random() < 0.7:
        content += bytes(-len(content) % 512)
    fault = traits[0] if not must_read else ""
    if fault and "frames" not in fault and rng.random() < 0.5:  # as long as a wrong size needs
        wrong = header if fault.endswith("header") else stated | {"start": start + stated["start"]}
        content = _fit(rng, content, wrong, blocks)
        traits.append("cut or extended to fit it")
    if must_read and rng.random() < 0.15:
        content, must_read = content[: len(content) - len(data) + len(data) // 2], False
        traits.append("truncated")
    points = np.where(is_absent[..., None], np.nan, points)[:, columns] * UNITS[unit]
    off = 1e-3 if is_float else 0.51 * scale * UNITS[unit] + 1e-3
    time = (first - 1 + np.arange(t)) / rate
    return Variant(content, ids, points, time, off, traits, must_read)


def _disagree(rng: Rng, state: dict) -> tuple[dict, dict, list[str], bool]:
    """Return the sizes of the header and of the parameters, of which one may be wrong."""
    header, stated = dict(state), dict(state)
    if rng.random() < 0.5:
        return header, stated, [], True
    name = _pick(rng, *state)
    wrong = _pick(rng, header, stated)
    where = "header" if wrong is header else "parameters"
    if name == "scale":
        wrong[name] = float(_pick(rng, -state[name], 2 * state[name]))
    elif name == "start":
        wrong[name] = int(_pick(rng, -1, 1, 2))
    else:
        wrong[name] = max(state[name] + int(_pick(rng, -2, -1, 1, 3, 12)), 0)
    return header, stated, [f"{name} wrong in the {where}"], False


def _fit(rng: Rng, content: bytes, sizes: dict, blocks: int) -> bytes:
    """Return a file that is exactly as long as sizes state, or that and the rest of a block."""
    word = 4 if sizes["scale"] < 0 else 2
    size = (4 * sizes["points"] + sizes["analog"]) * sizes["frames"] * word
    length = (sizes["start"] - 1) * 512 + size
    rest = int(_pick(rng, 0, -length % 512))
    more = max(length + rest - len(content), 0)
    filling = bytes(more) if rng.random() < 0.5 else rng.bytes(more)
    if rng.random() < 0.3:  # memory that the exporter did not clear, after the parameters
        end = 512 * (1 + blocks)
        used = len(content[:end].rstrip(b"\0")) + 3
        content = content[:used] + rng.bytes(max(end - used, 0)) + content[max(used, end) :]
    return (content + filling)[: length + rest]


def _c3d_data(
    rng: Rng, points: np.ndarray, scale: float, processor: int, analog: int
) -> tuple[bytes, np.ndarray]:
    """Return the data section, and which positions are absent."""
    t, m = points.shape[:2]
    is_absent = np.isnan(points[..., 0])
    by_zero = is_absent & (rng.random((t, m)) < 0.3)
    residual = np.where(is_absent & ~by_zero, -1.0, 0.0)
    quads = np.concatenate([np.nan_to_num(points), residual[..., None]], -1)
    if scale >= 0:
        quads[..., :3] = np.rint(quads[..., :3] / scale)
    table = np.concatenate([quads.reshape(t, -1), rng.integers(-99, 99, (t, analog))], 1)
    if scale >= 0:
        return table.astype(">i2" if processor == SGI else "<i2").tobytes(), is_absent
    return _floats(table, processor), is_absent


# ---- TRC ----


def trc_variant(rng: Rng) -> Variant:
    """Return a text file with any separators, blanks, labels, counts and encodings."""
    labels, columns, ids = labels_of(rng)
    unit = _pick(rng, *UNITS)
    t, m, rate = int(rng.integers(2, 30)), len(labels), float(_pick(rng, 50, 100))
    points, first = points_of(rng, t, m, UNITS[unit]), int(_pick(rng, 1, 1, 0, -25, 400))
    cell = _pick(rng, "\t", "\t", "\t", ",", ";", " ")
    has_spaces = any(" " in label for label in labels)
    head = _pick(rng, cell, "\t", " ")
    unnamed = int(_pick(rng, 0, 0, 0, 2)) if cell != " " else 0
    stated = int(_pick(rng, m, m, m, 2 * m, m + unnamed))
    traits, must_read = [f"cells {cell!r}", f"head {head!r}", unit], True
    names = ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate",
             "OrigDataStartFrame", "OrigNumFrames"][: int(_pick(rng, 8, 8, 7))]  # fmt: skip
    count = t - int(_pick(rng, 0, 0, 1))
    values = [f"{rate:.2f}", f"{rate:.2f}", str(count), str(stated), unit, f"{rate:.2f}",
              str(first), str(t)][: len(names)]  # fmt: skip
    label_line = _trc_labels(rng, labels, cell, has_spaces)
    axes = ["", "", *(f"{a}{i}" for i in range(1, m + 1) for a in "XYZ")]
    lines = [head.join(["PathFileType", "4", "(X/Y/Z)", "a.trc"]), head.join(names),
             head.join(values), label_line, cell.join(axes)]  # fmt: skip
    lines += [""] if rng.random() < 0.7 else []
    decimal = "," if rng.random() < 0.06 else "."
    must_read &= decimal == "."
    start = len(lines)
    for k in range(t):
        row = [str(first + k), f"{k / rate:.5f}"]
        for p in points[k]:
            row += _trc_position(rng, p, cell)
        row += [f"{x:.3f}" if k > 1 else "" for x in rng.random(3 * unnamed)]
        lines.append(cell.join(x.replace(".", decimal) if i > 1 else x for i, x in enumerate(row)))
    if cell != " " and rng.random() < 0.3:
        lines[start:] = [line + cell for line in lines[start:]]
        traits.append("separator at the end")
    damage = _pick(rng, *["none"] * 12, "shifted", "truncated", "word")
    if damage != "none":
        must_read, k = False, start + int(rng.integers(1, t))
        traits.append(damage)
        if damage == "truncated":
            lines = lines[: start + max(count - 1, 1)]
            must_read = len(lines) - start >= count
        else:
            cells = lines[k].split(cell)
            at = int(rng.integers(2, len(cells)))
            cells[at:at] = ["7.5"] if damage == "shifted" else []
            cells[at] = cells[at] if damage == "shifted" else "1,5x"
            lines[k] = cell.join(cells)
    end = _pick(rng, "\n", "\r\n", "\r")
    encoding = _pick(rng, "utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252")
    traits += [encoding, f"NumMarkers {stated} of {m}", f"{unnamed} unnamed"]
    content = (end.join(lines) + end).encode(encoding)
    right = points[:, columns] * UNITS[unit]
    rows = len(lines) - start if damage == "truncated" else t
    time = np.round(np.arange(t) / rate, 5)
    return Variant(content, ids, right[:rows], time[:rows], 1e-3, traits, must_read)


def _trc_labels(rng: Rng, labels: list[str], cell: str, has_spaces: bool) -> str:
    """Return the fourth line."""
    style = _pick(rng, "three", "three", "three", "dense", "spaces")
    if has_spaces and (cell == " " or style == "spaces"):
        style, cell = "three", "\t"
    if style == "spaces" or cell == " ":
        return (
            "Frame#\tTime\t" + "   ".join(labels)
            if cell != " "
            else " ".join(["Frame#", "Time", *labels])
        )
    gap = cell if style == "dense" else 3 * cell
    return cell.join(["Frame#", "Time", gap.join(labels)]) + ("" if style == "dense" else 2 * cell)


def _trc_position(rng: Rng, position: np.ndarray, cell: str) -> list[str]:
    """Return the cells of a position."""
    if not np.isnan(position[0]):
        return [f"{x:.8f}" for x in position]
    absent = ["nan", "NaN", "0.00000", "-1.#IND"] + ([""] if cell != " " else [])
    return [_pick(rng, *absent)] * 3
