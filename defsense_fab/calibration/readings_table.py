"""Read readings from a plain table, for people who measure with a multimeter.

The columns are `specimen` (a name), `jig_radius` (radius of the jig's surface, mm, empty when
flat), `channel` (`top`, `neutral` or `bottom`; the bottom is next to the jig) and `resistance`
(ohm). Optional are `round`, a number (without it, repeated rows count as rounds), and `face`, `a`
or `b`: the side of the specimen that is next to the jig, where it is turned over. Top and bottom
are then those of side a. Other columns are ignored.
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
from ..core.progress import Notice
from ..core.response import JIG_RADII_MM
from ..core.storage.files import unreadable_code
from .readings import MEMORY_TERMS, Geometry, Piece, Readings

_REQUIRED_COLUMNS = ("specimen", "jig_radius", "channel", "resistance")
_DECIMAL_COLUMNS = ("jig_radius", "resistance")
_SIDES = {"top": 1, "neutral": 0, "bottom": -1}
#: Displays of multimeters for an open circuit.
_OPEN = {"ol", "o.l", "o.l.", "0l", "0.l", "open", "inf", "1."}
_RADIUS_TOLERANCE_MM = 0.01
_REPAIR_ACTION = "Repair the cord and measure again, or delete the row"
_OHM_ACTION = "Give ohm, or delete the row"


def read_table(
    path: Path, geometry: Geometry, radii: Sequence[float] = JIG_RADII_MM
) -> tuple[Readings, list[Notice]]:
    """Read a table of readings.

    Args:
        path: CSV file, separated by commas, semicolons or tabs.
        geometry: Geometry of the specimens.
        radii: Radii of the available jigs, mm; by default the paper's nine.

    Returns:
        The readings, and notices about columns that are ignored.

    Raises:
        CalibrationError: A cell is invalid; the error names file, line and column.
    """
    rows, names = _read_rows(path)
    notices = []
    ignored = [n for n in names if n not in (*_REQUIRED_COLUMNS, "round", "face")]
    if ignored:
        text = f"{path.name}: ignored columns: {', '.join(ignored)}"
        notices.append(Notice("columns-unused", text))
    pieces: list[Piece] = []
    repetitions: Counter[tuple[object, ...]] = Counter()
    out: list[tuple[int, float, float, int, float, str]] = []
    for line, row in rows:
        where = f"{path.name}:{line}"
        place = _read_place(where, row)
        piece = Piece(row["specimen"], place, place == "neutral")
        if piece not in pieces:
            pieces.append(piece)
        radius = _read_radius(where, row["jig_radius"], radii, geometry)
        face = _read_face(where, row)
        side = _SIDES[place] * (1 if face == "a" else -1)
        key = (piece, "flat" if np.isnan(radius) else radius, face)
        turn = _read_round(where, row, repetitions[key])
        repetitions[key] += 1
        ohm = _read_resistance(where, row["resistance"])
        out.append((pieces.index(piece), geometry.strain(radius, side), radius, turn, ohm, where))
    if not out:
        raise CalibrationError(
            "the table has no rows below its header",
            code="no-rows",
            where=path,
            action="Add one row per reading",
        )
    piece_of, strain, radius_of, turns, ohms, places = zip(*out, strict=True)
    readings = Readings(
        tuple(pieces),
        np.array(piece_of, int),
        np.array(strain, float),
        np.zeros((len(strain), MEMORY_TERMS)),  # rows of a table need not be in order
        np.array(radius_of, float),
        np.array(turns, int),
        np.array(ohms, float),
        tuple(places),
    )
    return readings, notices


def _read_rows(path: Path) -> tuple[list[tuple[int, dict[str, str]]], list[str]]:
    """Return line numbers with their cells by column, and the columns' names.

    Decimal commas are accepted where columns are separated by semicolons or tabs.
    """
    text = _read_text(path)
    first = next((t for t in text.splitlines() if t.strip() and t.lstrip()[0] != "#"), "")
    separator = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    names: list[str] = []
    out = []
    for cells in reader:
        cells = [c.strip() for c in cells]
        if not any(cells) or cells[0].startswith("#"):
            continue
        where = f"{path.name}:{reader.line_num}"
        if not names:
            names = [c.lower() for c in cells]
            _check_header(where, names)
            continue
        if len(cells) < len(names):
            cells += [""] * (len(names) - len(cells))
        if any(cells[len(names) :]):
            raise CalibrationError(
                f"there are {len(cells)} cells in {len(names)} columns",
                code="too-many-cells",
                where=where,
                action="Separate columns by semicolons if numbers have decimal commas",
                line=reader.line_num,
            )
        if separator != ",":
            cells = [
                c.replace(",", ".") if n in _DECIMAL_COLUMNS else c
                for n, c in zip(names, cells, strict=False)
            ]
        out.append((reader.line_num, dict(zip(names, cells, strict=False))))
    if not names:
        raise CalibrationError(
            "is empty",
            code="file-empty",
            where=path,
            action=f"Start with the header {','.join(_REQUIRED_COLUMNS)}",
        )
    return out, names


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CalibrationError(
            f"cannot be read: {error.strerror}",
            code=unreadable_code(error),
            where=path,
            action="Check the path and its permissions",
            path=path,
        ) from None
    except UnicodeDecodeError:
        raise CalibrationError(
            "is not a text in UTF-8",
            code="not-utf8",
            where=path,
            action="Save the table as CSV in UTF-8",
            path=path,
        ) from None


def _check_header(where: str, names: list[str]) -> None:
    missing = [n for n in _REQUIRED_COLUMNS if n not in names]
    if missing:
        given = ", ".join(filter(None, names)) or "none"
        raise CalibrationError(
            f"the columns {', '.join(missing)} are missing; the header has {given}",
            code="column-missing",
            where=where,
            action=f"Name the columns {', '.join(_REQUIRED_COLUMNS)}",
            columns=missing,
        )
    repeated = [n for n, count in Counter(names).items() if n and count > 1]
    if repeated:
        raise CalibrationError(
            f"the column {repeated[0]} appears twice",
            code="column-repeated",
            where=where,
            action="Rename or delete one of them",
            column=repeated[0],
        )


def _fail(
    where: str, column: str, problem: str, code: str, action: str, **data: object
) -> NoReturn:
    raise CalibrationError(
        problem,
        code=code,
        where=f"{where}: {column}",
        action=action,
        place=where,
        column=column,
        **data,
    )


def _read_place(where: str, row: dict[str, str]) -> str:
    place = row["channel"].lower()
    if place not in _SIDES:
        _fail(
            where,
            "channel",
            f"{row['channel']!r} is not a position of a cord",
            "unknown-cord",
            "Give top, neutral or bottom",
        )
    if not row["specimen"]:
        _fail(where, "specimen", "is empty", "empty-cell", "Give the specimen a name")
    return place


def _read_face(where: str, row: dict[str, str]) -> str:
    face = (row.get("face") or "a").lower()
    if face not in ("a", "b"):
        _fail(where, "face", f"{row['face']!r} is not a face", "unknown-face", "Give a or b")
    return face


def _read_round(where: str, row: dict[str, str], default: int) -> int:
    if not row.get("round"):
        return default
    if not row["round"].isdigit():
        _fail(
            where,
            "round",
            f"{row['round']!r} is not a whole number",
            "not-a-count",
            "Number the rounds from 0 or 1",
        )
    return int(row["round"])


def _read_number(where: str, column: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        _fail(
            where,
            column,
            f"{text!r} is not a number",
            "not-a-number",
            "Give a number without a unit, with a point for decimals",
        )


def _read_resistance(where: str, text: str) -> float:
    if text.lower() in _OPEN:
        _fail(
            where,
            "resistance",
            f"{text!r} means an open circuit: the cord or its joints are broken",
            "open-circuit",
            _REPAIR_ACTION,
        )
    if not text:
        _fail(where, "resistance", "is empty", "empty-cell", _OHM_ACTION)
    ohm = _read_number(where, "resistance", text)
    if not np.isfinite(ohm) or ohm <= 0:
        state = "shorted" if ohm == 0 else "open" if ohm > 0 else "not measured"
        _fail(
            where,
            "resistance",
            f"{text} ohm means that the cord or its joints are {state}",
            "impossible-resistance",
            _REPAIR_ACTION,
            state=state,
        )
    return ohm


def _read_radius(where: str, text: str, jigs: Sequence[float], geometry: Geometry) -> float:
    """Return the radius of a jig, NaN for the flat one."""
    if not text or text.lower() == "flat":
        return float("nan")
    radius = _read_number(where, "jig_radius", text)
    closest = min(jigs, key=lambda r: abs(r - radius))
    if abs(closest - radius) <= _RADIUS_TOLERANCE_MM:
        return float(closest)
    available = ", ".join(f"{r:g}" for r in jigs)
    guess, action = None, "Give the radius of a jig, or pass the radii of custom jigs"
    for factor, unit in ((10, "cm"), (1000, "m"), (25.4, "inches"), (0.5, "its diameter")):
        if any(abs(radius * factor - r) <= max(_RADIUS_TOLERANCE_MM, 2e-3 * r) for r in jigs):
            guess, action = unit, f"This seems to be {unit}: give the radius in mm"
            break
    middle = geometry.thickness / 2
    if not guess and any(abs(radius - middle - r) <= _RADIUS_TOLERANCE_MM for r in jigs):
        guess = "neutral plane"
        action = (
            "This seems to be the radius of the neutral plane: give that of the jig's surface,"
            f" which is {middle:g} mm smaller"
        )
    _fail(
        where,
        "jig_radius",
        f"{text} mm is not one of the jigs {available}",
        "unknown-jig",
        action,
        guess=guess,
    )
