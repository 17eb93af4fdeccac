"""Readings of ideal specimens, as arrays and as tables."""

import numpy as np

from defsense_fab.calibration.readings import MEMORY_TERMS, Geometry, Piece, Readings
from defsense_fab.core.response import JIG_RADII_MM

GEOMETRY = Geometry()


def make_readings(
    response,
    seed=0,
    noise=0.001,
    rounds=1,
    specimens=("150", "200"),
    both=False,
    spread=0.0,
    radii=JIG_RADII_MM,
    drift=0.0,
):
    """Simulate the readings of cords.

    Args:
        response: Response as a function of strain.
        seed: Seed of the noise and the pieces.
        noise: Standard deviation of a reading.
        rounds: Number of rounds.
        specimens: Names of the specimens.
        both: Whether specimens are turned over for half of the readings.
        spread: Standard deviation of the pieces' gains.
        radii: Radii of the jigs, mm.
        drift: Relative increase of all cords of a specimen per reading.
    """
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


def write_table(path, readings, change=lambda row: row):
    """Write readings as CSV; `change` edits each row, a dict of texts, before it is written."""
    names = ("specimen", "jig_radius", "channel", "resistance")
    lines = [",".join(names)]
    for i in range(len(readings.where)):
        piece = readings.pieces[readings.piece[i]]
        radius = "" if np.isnan(readings.radius[i]) else f"{readings.radius[i]:g}"
        cells = (piece.specimen, radius, piece.place, f"{readings.resistance[i]:.2f}")
        lines.append(",".join(change(dict(zip(names, cells, strict=True))).values()))
    path.write_text("\n".join(lines) + "\n")
    return path
