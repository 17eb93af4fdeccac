"""Settled resistances of cords in bent specimens, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.errors import CalibrationError
from ..core.response import bent_strain
from ..sensing.response import relative_change

# What a piece of cord remembers of the strains before: terms that a fit can take apart from
# w(eps).
#
# Hysteresis: the Prandtl-Ishlinskii operator, a sum of plays of given width, each as far behind the
# strain as its width lets it be (Brokate & Sprekels 1996, ch. 2). Relaxation: any change of strain
# adds resistance, which heals; what is left of the last change, and of those before it.

#: Half widths of the plays, strains.
PLAYS = np.array([0.001, 0.003, 0.009])
#: The plays, the last change, changes before it.
TERMS = len(PLAYS) + 2
_SLOW = 60.0  # s, by which earlier changes heal


class Memory:
    """Of one piece that was at rest for long."""

    def __init__(self) -> None:
        self._plays, self._strain = np.zeros(len(PLAYS)), 0.0
        self._time, self._changes = 0.0, 0.0

    def at(self, strain: float, begun: float, read: float) -> Float:
        """(TERMS,) for a piece that was brought to this strain at the time `begun`, s, and read at
        `read`."""
        self._plays = np.clip(self._plays, strain - PLAYS, strain + PLAYS)
        change, self._strain = abs(strain - self._strain), strain
        earlier = self._changes * np.exp(-max(read - self._time, 0.0) / _SLOW)
        self._changes = self._changes * np.exp(-max(begun - self._time, 0.0) / _SLOW) + change
        self._time = begun
        return np.array([*(self._plays - strain), change, earlier])


def half_width(coefficients: Float) -> float:
    """Of the hysteresis between large strains, of (R - R0)/R0, for the terms' coefficients
    (TERMS,)."""
    return abs(float(coefficients[: len(PLAYS)] @ PLAYS))


#: Fewer radii tell no line from a curve, and no outlier from either.
LEAST_RADII = 3
_ARRAYS = ("strain", "memory", "radius", "turn", "resistance")


@dataclass(frozen=True)
class Notice:
    """A doubt about readings or their fit: its stable `code`, and a sentence for people."""

    code: str
    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Geometry:
    """Of a specimen: its thickness, and how far below its faces the outer cords lie, mm."""

    thickness: float = 15.0
    offset: float = 2.0

    def __post_init__(self) -> None:
        for name, value in (("thickness", self.thickness), ("offset", self.offset)):
            if not (np.isfinite(value) and 0 < value < 200):
                raise CalibrationError(
                    f"specimen: a {name} of {value:g} mm cannot be; give mm",
                    code="out-of-range",
                    field=name,
                )
        if not self.offset < self.thickness / 2:
            raise CalibrationError(
                f"specimen: an offset of {self.offset:g} mm lies beyond the neutral plane of a"
                f" thickness of {self.thickness:g} mm; give both in mm",
                code="offset-too-large",
            )

    def strain(self, radius: float, side: int) -> float:
        """On a jig of this surface radius, mm, or 0 where that is NaN: `side` 1 is the cord away
        from the jig, -1 the one next to it, 0 the neutral one."""
        if np.isnan(radius) or side == 0:
            return 0.0
        height = self.thickness / 2 + side * (self.thickness / 2 - self.offset)
        return bent_strain(radius, height, self.thickness)


@dataclass(frozen=True)
class Piece:
    """One piece of cord: where it lies in which specimen. Each `source`, a table or session, has
    its own R0 for it: cords age."""

    specimen: str
    place: str
    neutral: bool
    source: str = ""

    @property
    def name(self) -> str:
        return f"{self.specimen}/{self.place}"


@dataclass(frozen=True)
class Readings:
    """n settled resistances, in the order in which they were taken: the `piece` (n,) of `pieces`,
    its `strain` (n,) and `memory` (n, TERMS) of those before, zeros if they are not known, the
    jig's surface `radius` (n,) mm or NaN on the flat one, the `turn` (n,) of the protocol (rounds,
    from 0), the `resistance` (n,) ohm; `where` each was read from."""

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
            shape = (n, TERMS) if name == "memory" else (n,)
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must have the shape {shape}")

    @property
    def flat(self) -> Bool:
        """Which were read on the flat jig (n,)."""
        return np.isnan(self.radius)

    @property
    def neutral(self) -> Bool:
        """Which belong to neutral cords (n,)."""
        return np.array([p.neutral for p in self.pieces], bool)[self.piece]

    @property
    def radii(self) -> Float:
        """Different radii, rising, mm."""
        return np.unique(self.radius[~self.flat])

    def only(self, keep: Bool | Int) -> Readings:
        """Some of the readings."""
        where = tuple(np.array(self.where, object)[keep])
        arrays = {n: getattr(self, n)[keep] for n in ("piece", *_ARRAYS)}
        return replace(self, where=where, **arrays)

    def changes(self) -> Float:
        """(R - R0)/R0 (n,), R0 being the mean of the piece's flat readings.

        Raises CalibrationError for a piece without a flat reading.
        """
        rest = np.empty(len(self.pieces))
        for i, piece in enumerate(self.pieces):
            own = self.resistance[(self.piece == i) & self.flat]
            if not len(own) and (self.piece == i).any():
                raise CalibrationError(
                    f"specimen {piece.specimen!r}, {piece.place}: there is no reading on the flat"
                    " jig, so its resistance at rest is unknown; add one (an empty jig_radius)",
                    code="no-flat-reading",
                    specimen=piece.specimen,
                    cord=piece.place,
                )
            rest[i] = own.mean() if len(own) else np.nan
        return relative_change(self.resistance, rest[self.piece])


def joined(parts: list[Readings]) -> Readings:
    """Readings of several tables or sessions as one."""
    pieces = [replace(p, source=str(n)) for n, part in enumerate(parts) for p in part.pieces]
    first = np.cumsum([0, *(len(part.pieces) for part in parts)])
    index = [part.piece + n for part, n in zip(parts, first[:-1], strict=True)]
    return Readings(
        tuple(pieces),
        np.concatenate(index),
        where=tuple(w for part in parts for w in part.where),
        **{n: np.concatenate([getattr(p, n) for p in parts]) for n in _ARRAYS},
    )
