"""Read readings from a plain table, for people who measure with a multimeter.

The columns are `specimen` (a name), `jig_radius` (radius of the jig's surface, mm, empty when
flat), `channel` (`top`, `neutral` or `bottom`; the bottom is next to the jig) and `resistance`
(ohm). Optional are `round`, a number (without it, repeated rows count as rounds), and `face`, `a`
or `b`: the side of the specimen that is next to the jig, where it is turned over. Top and bottom
are then those of side a. Other columns are ignored.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..core.errors import CalibrationError
from ..core.progress import Notice
from ..core.response import JIG_RADII_MM
from ..core.storage.delimited_text import DelimitedTable, read_delimited
from .readings import MEMORY_TERMS, Geometry, Piece, Readings

_REQUIRED_COLUMNS = ("specimen", "jig_radius", "channel", "resistance")
_SIDES = {"top": 1, "neutral": 0, "bottom": -1}
#: Displays of multimeters for an open circuit.
_OPEN = {"ol", "o.l", "o.l.", "0l", "0.l", "open", "inf", "1."}
_RADIUS_TOLERANCE_MM = 0.01
_REPAIR_ACTION = "Repair it and measure again, or delete the row"
_OHM_ACTION = "Give ohm, or delete the row"


def read_table(
    path: Path, geometry: Geometry, radii: Sequence[float] = JIG_RADII_MM
) -> tuple[Readings, list[Notice]]:
    """Read a table of readings.

    Args:
        path: Table in text; see `core.storage.delimited_text` for its forms.
        geometry: Geometry of the specimens.
        radii: Radii of the available jigs, mm; by default the paper's nine.

    Returns:
        The readings, and notices about columns that are ignored.

    Raises:
        CalibrationError: A cell is invalid; the error names file, line and column.
    """
    table = read_delimited(path, CalibrationError, path.name)
    table.rename([name.lower() for name in table.names])
    _check_header(table)
    notices = []
    ignored = [n for n in table.names if n not in (*_REQUIRED_COLUMNS, "round", "face", "")]
    if ignored:
        text = f"{path.name}: ignored columns: {', '.join(ignored)}"
        notices.append(Notice("columns-unused", text))
    pieces: list[Piece] = []
    repetitions: Counter[tuple[object, ...]] = Counter()
    out: list[tuple[int, float, float, int, float, str]] = []
    for line, cells in table.rows():
        row = dict(zip_longest(table.names, cells, fillvalue=""))
        where = table.place(line)
        place = _read_place(where, row)
        piece = Piece(row["specimen"], place, place == "neutral")
        if piece not in pieces:
            pieces.append(piece)
        radius = _read_radius(table, line, row["jig_radius"], radii, geometry)
        face = _read_face(where, row)
        side = _SIDES[place] * (1 if face == "a" else -1)
        key = (piece, "flat" if np.isnan(radius) else radius, face)
        turn = _read_round(where, row, repetitions[key])
        repetitions[key] += 1
        ohm = read_resistance(table, line, row["resistance"])
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


def _check_header(table: DelimitedTable) -> None:
    missing = [n for n in _REQUIRED_COLUMNS if n not in table.names]
    if missing:
        given = ", ".join(filter(None, table.names)) or "none"
        raise CalibrationError(
            f"the columns {', '.join(missing)} are missing; the header has {given}",
            code="column-missing",
            where=table.place(table.header_line),
            action=f"Name the columns {', '.join(_REQUIRED_COLUMNS)}",
            columns=missing,
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


def read_resistance(table: DelimitedTable, line: int, text: str) -> float:
    """Return the resistance in a cell of the column `resistance`, ohm.

    Args:
        table: The table.
        line: Line of the cell.
        text: Text of the cell.

    Raises:
        CalibrationError: The cell is empty, no number, or means an open or shorted circuit.
    """
    where = table.place(line)
    if text.lower() in _OPEN:
        _fail(
            where,
            "resistance",
            f"{text!r} means an open circuit: the conductor or its contacts are broken",
            "open-circuit",
            _REPAIR_ACTION,
        )
    if not text:
        _fail(where, "resistance", "is empty", "empty-cell", _OHM_ACTION)
    ohm = table.number(text, line, "resistance")
    if not np.isfinite(ohm) or ohm <= 0:
        state = "shorted" if ohm == 0 else "open" if ohm > 0 else "not measured"
        _fail(
            where,
            "resistance",
            f"{text} ohm means that the conductor or its contacts are {state}",
            "impossible-resistance",
            _REPAIR_ACTION,
            state=state,
        )
    return ohm


def _read_radius(
    table: DelimitedTable, line: int, text: str, jigs: Sequence[float], geometry: Geometry
) -> float:
    """Return the radius of a jig, NaN for the flat one."""
    if not text or text.lower() == "flat":
        return float("nan")
    radius = table.number(text, line, "jig_radius")
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
        table.place(line),
        "jig_radius",
        f"{text} mm is not one of the jigs {available}",
        "unknown-jig",
        action,
        guess=guess,
    )
