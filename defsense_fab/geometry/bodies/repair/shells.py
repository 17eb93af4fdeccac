"""The closed shells that a surface consists of: which is a body, a cavity in one, or debris."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from .crossings import Inside
from .findings import number, place

#: Pieces and cavities of less than this part of the volume are debris.
DEBRIS = 1e-3
_MOST = 200  # shells of which it is asked what holds them; the largest
_FLAT = 1e-9  # of the cube of the size: the volume of what encloses none


@dataclass(frozen=True)
class Shell:
    """Closed triangles (m, 3) of the common vertices, turned outward; `volume` mm^3 within;
    `turned` tells that they had been inward; `low` and `high` corners, (3,) mm."""

    faces: Int
    volume: float
    turned: bool
    low: Float
    high: Float

    @property
    def middle(self) -> Float:
        """Of its bounding box, (3,) mm."""
        return (self.low + self.high) / 2


def shells_of(vertices: Float, faces: Int, size: float) -> list[Shell]:
    """The shells that enclose something, the largest first."""
    label = np.asarray(igl.facet_components(np.ascontiguousarray(faces))[1])
    order = np.argsort(label, kind="stable")
    found = []
    for own in np.split(order, np.nonzero(np.diff(label[order]))[0] + 1):
        mine = faces[np.sort(own)]
        corners = vertices[mine]
        a, b, c = (corners[:, i] - corners[0, 0] for i in range(3))
        volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
        if abs(volume) < _FLAT * size**3 and len(own) < len(faces):
            continue
        turned = volume < 0
        found.append(
            Shell(
                np.ascontiguousarray(mine[:, ::-1]) if turned else mine,
                abs(volume),
                turned,
                corners.min((0, 1)),
                corners.max((0, 1)),
            )
        )
    return sorted(found, key=lambda s: -s.volume)


def nested(vertices: Float, shells: list[Shell], apart: Int) -> list[int | None]:
    """For each shell the number of the smallest one that holds it, or None. Those of `apart`, pairs
    (k, 2) of shells that cross, do not hold each other."""
    crossed = {(int(a), int(b)) for a, b in apart} | {(int(b), int(a)) for a, b in apart}
    trees: dict[int, Inside] = {}
    holder: list[int | None] = [None] * len(shells)
    for i, inner in enumerate(shells[:_MOST]):
        for j in range(i - 1, -1, -1):
            outer = shells[j]
            if (
                (i, j) in crossed
                or (outer.low > inner.low).any()
                or (outer.high < inner.high).any()
            ):
                continue
            if j not in trees:
                trees[j] = Inside(vertices, outer.faces)
            if trees[j](vertices[inner.faces[:3, 0]]).all():
                holder[i] = j
                break
    return holder


def without_cavities(
    shells: list[Shell], holder: list[int | None], where: str, fill: bool
) -> tuple[list[Shell], list[str]]:
    """The shells that no other holds: what is within is solid. Raises BodyError for cavities that
    are no debris, unless they are to be filled."""
    kept = [s for s, h in zip(shells, holder, strict=True) if h is None]
    whole = sum(s.volume for s in kept)
    cavities, solid = [], 0
    for s, h in zip(shells, holder, strict=True):
        if h is None:
            continue
        if holder[h] is None and s.turned != shells[h].turned:
            cavities.append(s)
        else:
            solid += 1
    done: list[str] = []
    if cavities:
        told = _list(cavities)
        large = [c for c in cavities if c.volume >= DEBRIS * whole]
        if large and not fill:
            raise BodyError(
                refused_cavities(where, told),
                code="closed-cavity",
                volume=cavities[0].volume,
                at=cavities[0].middle.tolist(),
                count=len(cavities),
            )
        done.append(f"filled {told}")
    if solid:
        done.append(f"removed {number(solid, 'shell')} inside of the solid")
    return kept, done


def refused_cavities(where: str, told: str) -> str:
    """What is said of cavities, which are `told`, that are not to be filled."""
    return (
        f"{where}: {told} inside of the body cannot be made: powder or resin stays within, and no"
        " mould reaches it. Write fill_cavities = true under [body] in device.toml to fill it, or"
        " open or remove it in the program that made the body"
    )


def cavity_text(volume: float, middle: Float) -> str:
    """A cavity as it is told."""
    return f"a closed cavity of {volume:.3g} mm3 around {place(middle)}"


def _list(cavities: list[Shell]) -> str:
    first = cavity_text(cavities[0].volume, cavities[0].middle)
    rest = len(cavities) - 1
    return first if not rest else f"{first} and {rest} smaller"


def one_piece(pieces: list[Shell], where: str) -> tuple[list[Shell], list[str]]:
    """The one piece that is no debris. Raises BodyError where there are several."""
    whole = sum(p.volume for p in pieces)
    big = [p for p in pieces if p.volume >= DEBRIS * whole]
    small = [p for p in pieces if p.volume < DEBRIS * whole]
    if len(big) > 1:
        told = "; ".join(f"{p.volume:.3g} mm3 around {place(p.middle)}" for p in big[:5])
        more = f" and {len(big) - 5} more" if len(big) > 5 else ""
        raise BodyError(
            f"{where}: is made of {len(big)} separate pieces: {told}{more}; unite them or keep one",
            code="separate-pieces",
            count=len(big),
            volumes=[p.volume for p in big],
            places=[p.middle.tolist() for p in big],
        )
    if not small:
        return big, []
    volume = sum(p.volume for p in small)
    return big, [
        f"dropped {number(len(small), 'small piece')} apart from the body, {volume:.2g} mm3"
        f" together, the largest near {place(small[0].middle)}"
    ]
