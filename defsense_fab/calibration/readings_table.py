"""Readings from a plain table: for people who measure with a multimeter.

Columns `specimen, jig_radius, channel, resistance`: a name; mm of the jig's surface, empty when
flat; `top`, `neutral` or `bottom`, the bottom lying on the jig; ohm. Optional: `round`, a number
(rows that repeat one another count as rounds without it), and `face`, `a` or `b`: which side of the
specimen lies on the jig, where it is turned over (top and bottom are then those of side a). Others
are left alone.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..core.errors import CalibrationError
from ..core.response import JIG_RADII_MM
from ..core.storage.files import unreadable_code
from .readings import TERMS, Geometry, Notice, Piece, Readings

_NEEDED = ("specimen", "jig_radius", "channel", "resistance")
_SIDES = {"top": 1, "neutral": 0, "bottom": -1}
#: What multimeters show for a circuit that is open.
_OPEN = {"ol", "o.l", "o.l.", "0l", "0.l", "open", "inf", "1."}
_NEAR = 0.01  # mm


def read_table(
    path: Path, geometry: Geometry, radii: Sequence[float] | None = None
) -> tuple[Readings, list[Notice]]:
    """Readings and warnings; `radii` mm are those of the jigs there are (the paper's nine).

    Raises CalibrationError with file, line and column for what cannot be read.
    """
    rows, names = _rows(path)
    jigs = tuple(JIG_RADII_MM if radii is None else radii)
    warnings = []
    ignored = [n for n in names if n not in (*_NEEDED, "round", "face")]
    if ignored:
        text = f"{path.name}: not used: the columns {', '.join(ignored)}"
        warnings.append(Notice("columns-unused", text))
    pieces: list[Piece] = []
    seen: Counter[tuple[object, ...]] = Counter()
    out: list[tuple[int, float, float, int, float, str]] = []
    for line, row in rows:
        where = f"{path.name}:{line}"
        place = row["channel"].lower()
        if place not in _SIDES:
            _fail(
                where,
                "channel",
                f"{row['channel']!r} is none of top, neutral, bottom",
                "unknown-cord",
            )
        if not row["specimen"]:
            _fail(where, "specimen", "is empty; give the specimen a name", "empty-cell")
        piece = Piece(row["specimen"], place, place == "neutral")
        if piece not in pieces:
            pieces.append(piece)
        radius = _radius(where, row["jig_radius"], jigs, geometry)
        face = (row.get("face") or "a").lower()
        if face not in ("a", "b"):
            _fail(where, "face", f"{row['face']!r} is neither a nor b", "unknown-face")
        side = _SIDES[place] * (1 if face == "a" else -1)
        key = (piece, radius if radius == radius else "flat", face)
        turn = seen[key]
        if row.get("round"):
            if not row["round"].isdigit():
                _fail(
                    where, "round", f"{row['round']!r} is no whole number from 0 on", "not-a-count"
                )
            turn = int(row["round"])
        seen[key] += 1
        ohm = _resistance(where, row["resistance"])
        out.append((pieces.index(piece), geometry.strain(radius, side), radius, turn, ohm, where))
    if not out:
        raise CalibrationError(f"{path}: the table has no rows under its header", code="no-rows")
    piece_of, strain, radius_of, turns, ohms, places = zip(*out, strict=True)
    readings = Readings(
        tuple(pieces),
        np.array(piece_of, int),
        np.array(strain, float),
        np.zeros((len(strain), TERMS)),  # rows of a table need not be in order
        np.array(radius_of, float),
        np.array(turns, int),
        np.array(ohms, float),
        tuple(places),
    )
    return readings, warnings


def _rows(path: Path) -> tuple[list[tuple[int, dict[str, str]]], list[str]]:
    """Lines and what stands in them by column; decimal commas where columns are parted by
    semicolons or tabs."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CalibrationError(
            f"{path}: cannot be read: {error.strerror}", code=unreadable_code(error), path=path
        ) from None
    except UnicodeDecodeError:
        raise CalibrationError(
            f"{path}: is not a text in UTF-8; save the table as CSV", code="not-utf8", path=path
        ) from None
    first = next((t for t in text.splitlines() if t.strip() and t.lstrip()[0] != "#"), "")
    mark = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text), delimiter=mark, skipinitialspace=True)
    names: list[str] = []
    out = []
    for cells in reader:
        cells = [c.strip() for c in cells]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not names:
            names = [c.lower() for c in cells]
            missing = [n for n in _NEEDED if n not in names]
            if missing:
                raise CalibrationError(
                    f"{path.name}:{reader.line_num}: the columns {', '.join(missing)} are missing;"
                    f" there are {', '.join(filter(None, names)) or 'none'}; the header must name"
                    f" {', '.join(_NEEDED)}",
                    code="missing-column",
                    columns=missing,
                )
            twice = [n for n, count in Counter(names).items() if n and count > 1]
            if twice:
                raise CalibrationError(
                    f"{path.name}:{reader.line_num}: the column {twice[0]} stands there twice",
                    code="duplicate-column",
                    column=twice[0],
                )
            continue
        if len(cells) < len(names):
            cells += [""] * (len(names) - len(cells))
        if any(cells[len(names) :]):
            raise CalibrationError(
                f"{path.name}:{reader.line_num}: {len(cells)} cells under {len(names)} columns;"
                " decimal commas need columns parted by semicolons",
                code="too-many-cells",
                line=reader.line_num,
            )
        if mark != ",":
            cells = [
                c.replace(",", ".") if n in ("jig_radius", "resistance") else c
                for n, c in zip(names, cells, strict=False)
            ]
        out.append((reader.line_num, dict(zip(names, cells, strict=False))))
    if not names:
        raise CalibrationError(
            f"{path}: is empty; its first line must be {','.join(_NEEDED)}", code="empty-file"
        )
    return out, names


def _fail(where: str, column: str, problem: str, code: str, **data: object) -> NoReturn:
    raise CalibrationError(
        f"{where}: {column}: {problem}", code=code, place=where, column=column, **data
    )


def _number(where: str, column: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        _fail(
            where, column, f"{text!r} is no number (no units, a point for decimals)", "not-a-number"
        )


def _resistance(where: str, text: str) -> float:
    if text.lower() in _OPEN:
        _fail(
            where,
            "resistance",
            f"{text!r} stands for an open circuit: the cord or its joints are broken; mend it and"
            " measure again, or leave the row out",
            "open-circuit",
        )
    if not text:
        _fail(where, "resistance", "is empty; give ohm, or leave the row out", "empty-cell")
    ohm = _number(where, "resistance", text)
    if not np.isfinite(ohm) or ohm <= 0:
        state = "shorted" if ohm == 0 else "open" if ohm > 0 else "not measured"
        _fail(
            where,
            "resistance",
            f"{text} ohm cannot be: the cord or its joints are {state}; mend it and measure again,"
            " or leave the row out",
            "impossible-resistance",
            state=state,
        )
    return ohm


def _radius(where: str, text: str, jigs: Sequence[float], geometry: Geometry) -> float:
    """The jig's radius, NaN for the flat one. Raises CalibrationError for what is no jig."""
    if not text or text.lower() == "flat":
        return float("nan")
    radius = _number(where, "jig_radius", text)
    near = min(jigs, key=lambda r: abs(r - radius))
    if abs(near - radius) <= _NEAR:
        return float(near)
    guess, unit_guess = "", None
    for factor, unit in ((10, "cm"), (1000, "m"), (25.4, "inches"), (0.5, "its diameter")):
        if any(abs(radius * factor - r) <= max(_NEAR, 2e-3 * r) for r in jigs):
            unit_guess = unit
            guess = f" Is that {unit}? Give mm of the radius."
            break
    middle = geometry.thickness / 2
    if not guess and any(abs(radius - middle - r) <= _NEAR for r in jigs):
        guess = (
            f" Is that the radius of the neutral plane? Give the jig's surface, {middle:g} mm less."
        )
        unit_guess = "neutral plane"
    _fail(
        where,
        "jig_radius",
        f"{text} mm is none of the jigs {', '.join(f'{r:g}' for r in jigs)}.{guess} Jigs of your"
        " own are named with --radii",
        "unknown-jig",
        guess=unit_guess,
    )
