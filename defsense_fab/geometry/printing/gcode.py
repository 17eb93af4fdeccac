"""Read the beads that a G-code file deposits.

The reader follows PrusaSlicer, OrcaSlicer, Bambu Studio and Cura. Widths follow from the extruded
volume, not from comments, so that edited or scaled flows are seen.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import FabricationError
from .gcode_arcs import split_arc

#: Kinds of beads; `Beads.kind` holds indices of this tuple.
KINDS = ("object", "skirt", "support", "tower", "custom")
DEFAULT_FILAMENT_MM = 1.75
#: Numbers above it are no extruders: Bambu's firmware uses T255 and T1000 for other commands.
MAX_TOOL = 63
INCH_MM = 25.4
_MIN_LENGTH_MM = 1e-6
_MIN_HEIGHT_MM = 0.01  # thinner beads are ironing or rounding
_CHECKED_SLICERS = ("PrusaSlicer 2.5",)

_WORD = re.compile(r"([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))(?=[\sA-Za-z]|$)")
_COMMAND = re.compile(r"(?:N\d+\s*)?[GMT]\d", re.IGNORECASE)
_MACRO = re.compile(r"[A-Z_][A-Z0-9_]*(\s|$)|T[xc?]", re.IGNORECASE)
_KIND_COMMENT = re.compile(r";\s*(?:TYPE:|FEATURE:)\s*(.*)")
_HEIGHT_COMMENT = re.compile(r";\s*(?:HEIGHT:|LAYER_HEIGHT:)\s*([\d.]+)")
_DIAMETERS = re.compile(r";\s*filament_diameter\s*[=:]\s*([\d.,\s]+)")
_VOLUMETRIC = re.compile(r";\s*use_volumetric_e\s*=\s*1")
_SLICER = re.compile(r"(PrusaSlicer|SuperSlicer|OrcaSlicer|BambuStudio|Cura_SteamEngine)[ -]?(\S*)")
_KLIPPER_TOOL = re.compile(r"ACTIVATE_EXTRUDER\s+EXTRUDER=extruder(\d*)", re.IGNORECASE)


@dataclass(frozen=True)
class Beads:
    """Beads that a printer deposits, one per straight move.

    Attributes:
        start: Starts (n, 3) of the center lines, mm, in the print's frame. The center line is half
            a height below the nozzle.
        end: Ends (n, 3) of the center lines, mm.
        width: Widths (n,), mm, of the rounded rectangle with the deposited cross-section.
        height: Heights (n,), mm.
        volume: Deposited volumes (n,), mm^3.
        tool: Numbers (n,) of the extruders, from 0.
        kind: Indices (n,) into `KINDS`.
        line: Numbers (n,) of the lines in the file, from 1.
        source: The file.
        slicer: Name and version of the slicer, or an empty text.
        warnings: What was assumed because the file does not state it.
    """

    start: Float
    end: Float
    width: Float
    height: Float
    volume: Float
    tool: Int
    kind: Int
    line: Int
    source: str = ""
    slicer: str = ""
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.width)

    @property
    def is_object(self) -> Bool:
        """Whether each bead (n,) belongs to the object, not to its skirt, support or tower."""
        return np.asarray(self.kind == 0)

    @property
    def length(self) -> Float:
        """Lengths (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))


def find_shift(beads: Beads, low: Sequence[float], high: Sequence[float]) -> Float:
    """Return the translation (3,) in mm from a model's frame to the print's frame.

    Slicers move objects to the middle of the bed. Heights are kept: z of the translation is 0.

    Args:
        beads: Beads of the print, of one object.
        low: Lowest corner (3,) of the bounding box of the model, mm.
        high: Highest corner (3,), mm.
    """
    ends = np.concatenate([beads.start[beads.is_object], beads.end[beads.is_object]])
    if not len(ends):
        return np.zeros(3)
    shift = (ends.min(axis=0) + ends.max(axis=0)) / 2 - (np.array(low) + np.array(high)) / 2
    return np.array([shift[0], shift[1], 0.0])


def read_beads(path: Path, filament_mm: float | Sequence[float] | None = None) -> Beads:
    """Return the beads that a G-code file deposits.

    Args:
        path: G-code file (text).
        filament_mm: Diameter of the filament, mm, or one per extruder; by default as the file
            states it, or 1.75 mm.

    Raises:
        FabricationError: The file is not G-code, has an invalid line, or deposits nothing.
    """
    content = path.read_bytes()
    if content.startswith(b"GCDE"):
        raise FabricationError(
            "is binary G-code",
            code="gcode-binary",
            where=path,
            action="Turn off binary G-code in the slicer's printer settings and export again",
        )
    reader = _Reader(path)
    for number, raw in enumerate(content.split(b"\n"), 1):
        if b"\0" in raw:
            raise _not_gcode(path, number)
        reader.read(raw.decode("utf-8", "replace").strip(), number)
    if not reader.move_count:
        raise _not_gcode(path, reader.first_unknown or 1)
    if not reader.rows:
        raise FabricationError(
            "deposits no material",
            code="gcode-without-extrusion",
            where=f"{path}:{reader.first_move}",
            action="Slice the model again",
        )
    return _to_beads(reader, filament_mm)


def _not_gcode(path: Path, number: int) -> FabricationError:
    return FabricationError(
        "is not G-code",
        code="not-gcode",
        where=f"{path}:{number}",
        action="Export the sliced model as G-code",
        line=number,
    )


def _invalid_line(path: Path, number: int, text: str) -> FabricationError:
    return FabricationError(
        f"cannot read {text!r} in this move",
        code="gcode-line-invalid",
        where=f"{path}:{number}",
        action="Export the file from the slicer again",
        line=number,
    )


@dataclass
class _Reader:
    """State of the printer while the lines of a file are read."""

    path: Path
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    extruded: float = 0.0
    is_relative: bool = False
    is_relative_e: bool = False
    unit: float = 1.0
    tool: int = 0
    kind: int = 4
    height: float = np.nan
    has_kinds: bool = False
    move_count: int = 0
    first_move: int = 0
    first_unknown: int = 0
    slicer: str = ""
    diameters: list[float] = field(default_factory=list)
    is_volumetric: bool = False
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def read(self, text: str, number: int) -> None:
        """Apply one line."""
        if not text:
            return
        if text[0] == ";":
            self._read_comment(text)
            return
        code = text.split(";", 1)[0].strip()
        if code[:3] in ("G1 ", "G0 ") and (words := _parse_plain(code)) is not None:
            self._move(1, words, number)
            return
        if not _COMMAND.match(code):
            self._read_other(code, number)
            return
        name, value, words = self._parse(code, number)
        if name == "T":
            if value <= MAX_TOOL:
                self.tool = value
        elif name == "M":
            if value in (82, 83):
                self.is_relative_e = value == 83
        elif value in (0, 1, 2, 3):
            self._move(value, words, number)
        elif value in (90, 91):
            self.is_relative = value == 91
        elif value in (20, 21):
            self.unit = INCH_MM if value == 20 else 1.0
        elif value == 92:
            self._set_position(words)
        elif value == 28:
            axes = [i for i, axis in enumerate("XYZ") if re.search(axis, code[3:], re.IGNORECASE)]
            for i in axes or range(3):
                self.position[i] = self.offset[i] = 0.0

    def _parse(self, code: str, number: int) -> tuple[str, int, dict[str, float]]:
        """Return letter and number of a command, and its parameters."""
        pairs = _WORD.findall(code)
        if pairs and pairs[0][0] in "Nn":
            code, pairs = code.split("*", 1)[0], _WORD.findall(code.split("*", 1)[0])[1:]
        name = pairs[0][0].upper() if pairs else ""
        # G1.5 and G53.1 are other commands than G1 and G53.
        value = int(pairs[0][1]) if pairs and pairs[0][1].isdigit() else -1
        words = {letter.upper(): float(text) for letter, text in pairs[1:]}
        if name == "G" and value in (0, 1, 2, 3):
            rest = _WORD.sub("", code).strip()
            if rest:
                raise _invalid_line(self.path, number, rest)
        return name, value, words

    def _read_comment(self, text: str) -> None:
        if match := _KIND_COMMENT.match(text):
            self.kind, self.has_kinds = _classify(match[1]), True
        elif match := _HEIGHT_COMMENT.match(text):
            self.height = float(match[1])
        elif match := _DIAMETERS.match(text):
            self.diameters = [float(v) for v in match[1].replace(" ", "").split(",") if v]
        elif _VOLUMETRIC.match(text):
            self.is_volumetric = True
        elif not self.slicer and (match := _SLICER.search(text)):
            self.slicer = f"{match[1]} {match[2]}".strip()

    def _read_other(self, code: str, number: int) -> None:
        if match := _KLIPPER_TOOL.match(code):
            self.tool = int(match[1] or 0)
        elif not self.first_unknown and not _MACRO.fullmatch(code.split(" ", 1)[0]):
            self.first_unknown = number

    def _set_position(self, words: dict[str, float]) -> None:
        if "E" in words:
            self.extruded = words["E"] * self.unit
        for i, axis in enumerate("XYZ"):
            if axis in words:
                self.offset[i] = self.position[i] - words[axis] * self.unit

    def _move(self, command: int, words: dict[str, float], number: int) -> None:
        self.move_count += 1
        self.first_move = self.first_move or number
        start, target, unit = list(self.position), list(self.position), self.unit
        for i, axis in enumerate("XYZ"):
            if axis in words:
                base = self.position[i] if self.is_relative else self.offset[i]
                target[i] = base + words[axis] * unit
        extrusion = 0.0
        if "E" in words:
            value = words["E"] * unit
            if self.is_relative or self.is_relative_e:
                extrusion = value
                self.extruded += value
            else:
                extrusion, self.extruded = value - self.extruded, value
        self.position = target
        if extrusion <= 0:
            return
        points = [start, target]
        if command in (2, 3):
            arc = {k: v * unit for k, v in words.items() if k in "IJR"}
            points = split_arc(start, target, arc, command == 2)
        lengths = [math.dist(p, q) for p, q in pairwise(points)]
        total = sum(lengths)
        if total < _MIN_LENGTH_MM:
            return  # the filament is pushed back after a retraction
        for (p, q), length in zip(pairwise(points), lengths, strict=True):
            share = extrusion * length / total
            if length >= _MIN_LENGTH_MM:
                self.rows.append((*p, *q, share, self.height, self.tool, self.kind, number))


def _parse_plain(code: str) -> dict[str, float] | None:
    """Return the parameters of a move as slicers write it, or None for another form."""
    try:
        words = {word[0]: float(word[1:]) for word in code[3:].split()}
    except ValueError:
        return None
    return words if all("A" <= letter <= "Z" for letter in words) else None


def _classify(text: str) -> int:
    """Return the index in `KINDS` of a slicer's name for a kind of extrusion."""
    name = text.strip().lower().replace("_", "-")
    if "skirt" in name or "brim" in name:
        return 1
    if "support" in name or name == "raft":
        return 2
    if "tower" in name or name.startswith(("wipe", "prime", "flush")):
        return 3
    return 4 if name == "custom" else 0


def _to_beads(reader: _Reader, filament_mm: float | Sequence[float] | None) -> Beads:
    """Return the rows of a reader as beads."""
    rows = np.array(reader.rows, float)
    infinite = ~np.isfinite(rows[:, :7]).all(axis=1)
    if infinite.any():
        number = int(rows[infinite.argmax(), 10])
        raise _invalid_line(reader.path, number, "a number that is not finite")
    tool, kind = rows[:, 8].astype(np.int64), rows[:, 9].astype(np.int64)
    warnings = []
    if not reader.slicer.startswith(_CHECKED_SLICERS):
        name = reader.slicer or "an unknown slicer"
        warnings.append(
            f"{reader.path}: G-code of {name} was not checked, {_CHECKED_SLICERS[0]} was."
        )
    if not reader.has_kinds:
        kind = np.zeros_like(kind)
        warnings.append(
            f"{reader.path}: kinds of extrusion are not stated. Skirt and tower count as object."
        )
    if filament_mm is not None:
        diameters = np.atleast_1d(np.asarray(filament_mm, float))
    elif reader.diameters:
        diameters = np.array(reader.diameters)
    else:
        diameters = np.array([DEFAULT_FILAMENT_MM])
        if not reader.is_volumetric:
            warnings.append(
                f"{reader.path}: the filament's diameter is not stated; "
                f"{DEFAULT_FILAMENT_MM} mm is assumed."
            )
    area = np.pi / 4 * diameters[np.minimum(tool, len(diameters) - 1)] ** 2
    volume = rows[:, 6] * (1.0 if reader.is_volumetric else area)
    height = rows[:, 7].copy()
    if np.isnan(height).any():
        unknown = np.isnan(height)
        height[unknown] = _heights_from_layers(rows[:, 5], kind == 0)[unknown]
    length = np.linalg.norm(rows[:, 3:6] - rows[:, :3], axis=1)
    section = volume / length
    # Rounded rectangle: section = height * (width - height) + pi / 4 height^2.
    width = np.maximum(section / height + height * (1 - np.pi / 4), section / height)
    thread = width < height  # a bead that bridges is a round thread
    width[thread] = np.minimum(np.sqrt(4 / np.pi * section), section / height * 4 / np.pi)[thread]
    down = np.stack([np.zeros(len(rows)), np.zeros(len(rows)), height / 2], axis=1)
    return Beads(
        start=rows[:, :3] - down,
        end=rows[:, 3:6] - down,
        width=width,
        height=height,
        volume=volume,
        tool=tool,
        kind=kind,
        line=rows[:, 10].astype(np.int64),
        source=str(reader.path),
        slicer=reader.slicer,
        warnings=tuple(warnings),
    )


def _heights_from_layers(z: Float, is_object: Bool) -> Float:
    """Return the heights (n,) of beads as distances of their layers, mm."""
    layers = np.unique(np.round(z[is_object] if is_object.any() else z, 4))
    below = np.searchsorted(layers, np.round(z, 4), side="left") - 1
    lower = np.where(below >= 0, layers[np.maximum(below, 0)], 0.0)
    return np.asarray(np.maximum(z - lower, _MIN_HEIGHT_MM))
