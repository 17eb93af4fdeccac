"""Readings of ideal specimens, as arrays and as tables."""

import numpy as np

from defsense_fab.calibration.readings import MEMORY_TERMS, Geometry, Piece, Readings
from defsense_fab.core.response import JIG_RADII_MM

GEOMETRY = Geometry()


def readings(
    response, seed=0, noise=0.001, rounds=1, specimens=("150", "200"), both=False, spread=0.0,
    radii=JIG_RADII_MM, drift=0.0,
):  # fmt: skip
    """Of cords with this response (a function of strain), turned over for half of the readings if
    `both`; `drift` is what all cords of a specimen gain per reading."""
    rng = np.random.default_rng(seed)
    pieces, rows = [], []
    for specimen in specimens:
        for place, side in (("top", 1), ("neutral", 0), ("bottom", -1)):
            pieces.append(Piece(specimen, place, side == 0))
            gain, rest = 1 + spread * rng.normal(), rng.uniform(1500, 3000)
            count = 0
            for turn in range(rounds):
                for face in (1, -1) if both else (1,):
                    for radius in (np.nan, *radii):
                        e = GEOMETRY.strain(radius, side * face)
                        change = gain * response(e) + noise * rng.normal()
                        ohm = rest * (1 + change) * (1 + drift * count)
                        rows.append((len(pieces) - 1, e, np.zeros(MEMORY_TERMS), radius, turn, ohm))
                        count += 1
    piece, strain, memory, radius, turn, ohm = (np.array(c) for c in zip(*rows, strict=True))
    where = tuple(f"row {i}" for i in range(len(rows)))
    return Readings(tuple(pieces), piece, strain, memory, radius, turn, ohm, where)


def table(path, r, change=lambda row: row):
    """A CSV of readings; `change` edits a row (a dict of texts) before it is written."""
    names = ("specimen", "jig_radius", "channel", "resistance")
    lines = [",".join(names)]
    for i in range(len(r.where)):
        piece = r.pieces[r.piece[i]]
        radius = "" if np.isnan(r.radius[i]) else f"{r.radius[i]:g}"
        row = dict(zip(names, (piece.specimen, radius, piece.place, f"{r.resistance[i]:.2f}"),
                       strict=True))  # fmt: skip
        lines.append(",".join(change(row).values()))
    path.write_text("\n".join(lines) + "\n")
    return path
