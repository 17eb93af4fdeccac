"""Settled resistances of cords in bent specimens, and the cords' memory of earlier strains."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.errors import CalibrationError
from ..core.response import (
    CORD_OFFSET_MM,
    JIG_RADII_MM,
    SPECIMEN_LENGTH_MM,
    SPECIMEN_THICKNESS_MM,
    bent_strain,
)
from ..sensing.response import relative_change

#: With fewer radii, neither a line and a curve nor an outlier and either can be distinguished.
MIN_RADII = 3
#: Half widths of the plays, strains.
PLAY_HALF_WIDTHS = np.array([0.001, 0.003, 0.009])
#: Number of memory terms: the plays, the last change, and the changes before it.
MEMORY_TERMS = len(PLAY_HALF_WIDTHS) + 2
_HEALING_TIME_S = 60.0  # of earlier changes
_ARRAYS = ("strain", "memory", "radius", "turn", "resistance")


class Memory:
    """Memory of one piece of cord that was at rest for a long time.

    Its terms can be separated from w(eps) in a fit. Hysteresis is the Prandtl-Ishlinskii operator:
    a sum of plays of given width, each of which lags behind the strain by up to its half width.
    Relaxation: any change of strain adds resistance, which heals; the terms are the last change,
    and the remainder of the changes before it.

    References:
        Brokate & Sprekels 1996, chapter 2.
    """

    def __init__(self) -> None:
        self._plays, self._strain = np.zeros(len(PLAY_HALF_WIDTHS)), 0.0
        self._time, self._changes = 0.0, 0.0

    def at(self, strain: float, started: float, read: float) -> Float:
        """Return the memory terms of a reading, after all earlier ones.

        Args:
            strain: Strain of the reading.
            started: Time at which the piece was brought to that strain, s.
            read: Time of the reading, s.

        Returns:
            The terms (MEMORY_TERMS,).
        """
        self._plays = np.clip(self._plays, strain - PLAY_HALF_WIDTHS, strain + PLAY_HALF_WIDTHS)
        change, self._strain = abs(strain - self._strain), strain
        earlier = self._changes * np.exp(-max(read - self._time, 0.0) / _HEALING_TIME_S)
        remainder = self._changes * np.exp(-max(started - self._time, 0.0) / _HEALING_TIME_S)
        self._changes = remainder + change
        self._time = started
        return np.array([*(self._plays - strain), change, earlier])


def hysteresis_half_width(coefficients: Float) -> float:
    """Return half the width of the hysteresis between large strains, of (R - R0)/R0.

    Args:
        coefficients: Coefficients of the memory terms (MEMORY_TERMS,).
    """
    return abs(float(coefficients[: len(PLAY_HALF_WIDTHS)] @ PLAY_HALF_WIDTHS))


@dataclass(frozen=True)
class Geometry:
    """Geometry of a specimen.

    Attributes:
        thickness: Thickness, mm.
        offset: Distance of the outer cords from the faces, mm.

    Raises:
        CalibrationError: A length is not possible.
    """

    thickness: float = SPECIMEN_THICKNESS_MM
    offset: float = CORD_OFFSET_MM

    def __post_init__(self) -> None:
        for name, value in (("thickness", self.thickness), ("offset", self.offset)):
            if not (np.isfinite(value) and 0 < value < 200):
                raise CalibrationError(
                    f"a {name} of {value:g} mm is not possible",
                    code="out-of-range",
                    where="specimen",
                    action="Give the length in mm",
                    field=name,
                )
        if not self.offset < self.thickness / 2:
            raise CalibrationError(
                f"an offset of {self.offset:g} mm is beyond the neutral plane of a specimen"
                f" {self.thickness:g} mm thick",
                code="offset-too-large",
                where="specimen",
                action="Give both lengths in mm",
            )

    def strain(self, radius: float, side: int) -> float:
        """Return the strain of a cord on a jig.

        Args:
            radius: Radius of the jig's surface, mm; NaN for the flat jig.
            side: 1 for the cord away from the jig, -1 for the one next to it, 0 for the neutral
                one.
        """
        if np.isnan(radius) or side == 0:
            return 0.0
        height = self.thickness / 2 + side * (self.thickness / 2 - self.offset)
        return bent_strain(radius, height, self.thickness)


@dataclass(frozen=True)
class BendingSpecimen:
    """A specimen with its jigs; by default that of the paper.

    Attributes:
        length: Length, mm.
        geometry: Thickness, and position of the cords.
        radii: Radii of the jigs' surfaces, mm.
    """

    length: float = SPECIMEN_LENGTH_MM
    geometry: Geometry = Geometry()
    radii: tuple[float, ...] = JIG_RADII_MM


@dataclass(frozen=True)
class Piece:
    """One piece of cord in a specimen.

    Attributes:
        specimen: Name of the specimen.
        place: Position of the cord: "top", "neutral" or "bottom".
        neutral: Whether it is in the neutral plane.
        source: Table or session. Each has its own R0 of the piece, since cords age.
    """

    specimen: str
    place: str
    neutral: bool
    source: str = ""

    @property
    def name(self) -> str:
        """Specimen and position."""
        return f"{self.specimen}/{self.place}"


@dataclass(frozen=True)
class Readings:
    """n settled resistances, in the order in which they were read.

    Attributes:
        pieces: All pieces of cord.
        piece: Index of the piece (n,).
        strain: Strain (n,).
        memory: Memory terms (n, MEMORY_TERMS); zeros where earlier strains are not known.
        radius: Radius of the jig's surface (n,), mm; NaN on the flat jig.
        turn: Round of the protocol (n,), from 0.
        resistance: Resistance (n,), ohm.
        where: Where each was read from (n).

    Raises:
        ValueError: A shape is wrong.
    """

    pieces: tuple[Piece, ...]
    piece: Int
    strain: Float
    memory: Float
    radius: Float
    turn: Int
    resistance: Float
    where: tuple[str, ...]

    def __post_init__(self) -> None:
        n = len(self.where)
        for name in ("piece", *_ARRAYS):
            shape = (n, MEMORY_TERMS) if name == "memory" else (n,)
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must have the shape {shape}")

    @property
    def flat(self) -> Bool:
        """Whether each was read on the flat jig (n,)."""
        return np.isnan(self.radius)

    @property
    def neutral(self) -> Bool:
        """Whether each is of a neutral cord (n,)."""
        return np.array([p.neutral for p in self.pieces], bool)[self.piece]

    @property
    def radii(self) -> Float:
        """Distinct radii of the jigs, increasing, mm."""
        return np.unique(self.radius[~self.flat])

    def only(self, selected: Bool | Int) -> Readings:
        """Return some of the readings, selected by a mask or by indices."""
        where = tuple(np.array(self.where, object)[selected])
        arrays = {n: getattr(self, n)[selected] for n in ("piece", *_ARRAYS)}
        return replace(self, where=where, **arrays)

    def changes(self) -> Float:
        """Return (R - R0)/R0 (n,), where R0 is the mean of the piece's flat readings.

        Raises:
            CalibrationError: A piece has no flat reading.
        """
        rest = np.empty(len(self.pieces))
        for i, piece in enumerate(self.pieces):
            flat = self.resistance[(self.piece == i) & self.flat]
            if not len(flat) and (self.piece == i).any():
                raise CalibrationError(
                    "there is no reading on the flat jig, so the resistance at rest is unknown",
                    code="no-flat-reading",
                    where=f"specimen {piece.specimen!r}, {piece.place}",
                    action="Add a reading with an empty jig_radius",
                    specimen=piece.specimen,
                    cord=piece.place,
                )
            rest[i] = flat.mean() if len(flat) else np.nan
        return relative_change(self.resistance, rest[self.piece])


def join_readings(parts: list[Readings]) -> Readings:
    """Join readings of several tables or sessions; each is a source of its own."""
    pieces = [replace(p, source=str(n)) for n, part in enumerate(parts) for p in part.pieces]
    first = np.cumsum([0, *(len(part.pieces) for part in parts)])
    index = [part.piece + n for part, n in zip(parts, first[:-1], strict=True)]
    return Readings(
        tuple(pieces),
        np.concatenate(index),
        where=tuple(w for part in parts for w in part.where),
        **{n: np.concatenate([getattr(p, n) for p in parts]) for n in _ARRAYS},
    )
