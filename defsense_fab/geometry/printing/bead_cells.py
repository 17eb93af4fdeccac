"""Cut beads into short cells, and find where the cells touch.

A cell is a box along its bead. Contacts are found from the boxes: along a bead, between beads of a
layer, and between layers.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Bool, Float, Int
from .gcode import Beads

CELL_LENGTH_MM = 0.4  # about the width of a bead
#: Gap that counts as contact: rounding of G-code and the spread of a soft bead.
CONTACT_TOLERANCE_MM = 0.05
#: Round ends of beads reach beyond the nozzle's path by this share of the width. The end of a
#: half circle of that area (pi / 8 w) is partly inside the neighbor.
END_SHARE = 0.25
_MIN_CONTACT_MM = 0.03  # shorter contacts are corners that touch
_JOINED_MM = 2e-3  # coordinates in G-code have three decimals
_CHAIN_WIDTHS = 2.0  # along a bead before it can touch itself
_LAYER_SHARE = 0.25  # of a height: difference in z within a layer

ALONG, ACROSS, LAYERS = 0, 1, 2


@dataclass(frozen=True)
class Cells:
    """Short pieces of beads.

    Attributes:
        center: Centers (n, 3), mm.
        direction: Unit vectors (n, 3) along the beads.
        length: Lengths (n,), mm.
        width: Widths (n,), mm.
        height: Heights (n,), mm.
        section: Deposited cross-sections (n,), mm^2.
        bead: Indices (n,) of the beads.
        reach_back: Lengths (n,) by which round ends extend the cells backward, mm.
        reach_ahead: The same forward, mm.
        chain: Numbers (n,) of the chains of beads that follow each other without a break.
        arc: Positions (n,) along the chains, mm.
    """

    center: Float
    direction: Float
    length: Float
    width: Float
    height: Float
    section: Float
    bead: Int
    reach_back: Float
    reach_ahead: Float
    chain: Int
    arc: Float

    def __len__(self) -> int:
        return len(self.length)

    def take(self, chosen: Int | Bool) -> Cells:
        """Return some of the cells, by index or mask."""
        return Cells(*(getattr(self, f.name)[chosen] for f in fields(self)))


@dataclass(frozen=True)
class Contacts:
    """Pairs of cells that touch.

    Attributes:
        pair: Indices (m, 2) of cells.
        kind: `ALONG`, `ACROSS` or `LAYERS` (m,).
        area: Areas (m,) of contact, mm^2.
        distance: Distances (m,) that the current crosses, mm.
        at: Places (m, 2) of the contact along both cells, from -1 at the start to 1 at the end.
    """

    pair: Int
    kind: Int
    area: Float
    distance: Float
    at: Float

    def take(self, kept: Int | Bool) -> Contacts:
        """Return some of the contacts, by index or mask."""
        return Contacts(*(getattr(self, f.name)[kept] for f in fields(self)))

    def select(self, chosen: Bool) -> Contacts:
        """Return the contacts between chosen cells (n,), by the cells' indices among the chosen."""
        inner = self.within(chosen)
        return replace(inner, pair=(np.cumsum(chosen) - 1)[inner.pair])

    def within(self, chosen: Bool) -> Contacts:
        """Return the contacts between chosen cells (n,), by the cells' indices among all."""
        return self.take(np.asarray(chosen[self.pair].all(axis=1)))


def cut_into_cells(beads: Beads, chosen: Int) -> tuple[Cells, Int]:
    """Return the cells of some beads, and which cells follow each other along a bead.

    Args:
        beads: Beads of a print.
        chosen: Indices (m,) of beads, in the order of printing.

    Returns:
        The cells (n), and pairs (k, 2) of cells that are joined end to end.
    """
    start, end = beads.start[chosen], beads.end[chosen]
    length = np.linalg.norm(end - start, axis=1)
    count = np.maximum(np.ceil(length / CELL_LENGTH_MM), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(chosen)), count)
    first = np.cumsum(count) - count
    index = np.arange(len(owner)) - first[owner]
    share = (index + 0.5) / count[owner]
    joined = np.zeros(len(chosen), bool)  # to the bead before
    if len(chosen) > 1:
        near = np.linalg.norm(start[1:] - end[:-1], axis=1) < _JOINED_MM
        joined[1:] = near & (beads.tool[chosen[1:]] == beads.tool[chosen[:-1]])
    is_first, is_last = index == 0, index == count[owner] - 1
    follows = ~is_first | joined[owner]
    ends = np.append(joined[1:], False)
    round_end = END_SHARE * beads.width[chosen][owner]
    piece = (length / count)[owner]
    cells = Cells(
        center=start[owner] + share[:, None] * (end - start)[owner],
        direction=((end - start) / length[:, None])[owner],
        length=piece,
        width=beads.width[chosen][owner],
        height=beads.height[chosen][owner],
        section=(beads.volume[chosen] / length)[owner],
        bead=np.asarray(chosen)[owner],
        reach_back=np.where(is_first & ~joined[owner], round_end, 0.0),
        reach_ahead=np.where(is_last & ~ends[owner], round_end, 0.0),
        chain=np.cumsum(~follows) - 1,
        arc=np.cumsum(piece) - piece / 2,
    )
    later = np.flatnonzero(follows)
    return cells, np.stack([later - 1, later], axis=1)


def find_contacts(cells: Cells, joined: Int) -> Contacts:
    """Return the contacts between cells.

    Args:
        cells: Cells of one material.
        joined: Pairs (k, 2) that follow each other along a bead.
    """
    a, b = joined[:, 0], joined[:, 1]
    along = Contacts(
        joined,
        np.full(len(joined), ALONG),
        np.minimum(cells.section[a], cells.section[b]),
        (cells.length[a] + cells.length[b]) / 2,
        np.tile([1.0, -1.0], (len(joined), 1)),
    )
    reach = 0.5 * np.hypot(cells.length + 2 * END_SHARE * cells.width, cells.width).max(initial=0)
    reach = np.hypot(2 * reach + CONTACT_TOLERANCE_MM, cells.height.max(initial=0) * 1.3)
    pair = cKDTree(cells.center).query_pairs(reach, output_type="ndarray").astype(np.int64)
    keys = pair.min(axis=1) * len(cells) + pair.max(axis=1)
    pair = pair[~np.isin(keys, a * len(cells) + b)]
    rise = np.abs(cells.center[pair[:, 0], 2] - cells.center[pair[:, 1], 2])
    half = (cells.height[pair[:, 0]] + cells.height[pair[:, 1]]) / 2
    is_level = rise < _LAYER_SHARE * half
    is_stacked = ~is_level & (rise < (1 + _LAYER_SHARE) * half)
    parts = [along, _contacts_within_layer(cells, pair[is_level])]
    parts.append(_contacts_between_layers(cells, pair[is_stacked], rise[is_stacked]))
    return Contacts(
        *(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Contacts))
    )


def _overlap(cells: Cells, pair: Int) -> tuple[Float, Float, Float]:
    """Return the overlaps (m,) of pairs of boxes along and across the first, mm, and their middle.

    Negative overlaps are gaps. The middle is a place along the first cell, as in `Contacts.at`.
    """
    i, j = pair[:, 0], pair[:, 1]
    t, u = _level(cells.direction[i]), _level(cells.direction[j])
    n = np.stack([-t[:, 1], t[:, 0]], axis=1)
    cosine, sine = np.abs((t * u).sum(axis=1)), np.abs((n * u).sum(axis=1))
    shift = (cells.reach_ahead - cells.reach_back) / 2
    half = (cells.length + cells.reach_ahead + cells.reach_back) / 2
    d = cells.center[j, :2] + shift[j, None] * u - cells.center[i, :2] - shift[i, None] * t
    along, across = (d * t).sum(axis=1), (d * n).sum(axis=1)
    extent_along = half[j] * cosine + cells.width[j] / 2 * sine
    extent_across = half[j] * sine + cells.width[j] / 2 * cosine
    low, high = (
        np.maximum(-half[i], along - extent_along),
        np.minimum(half[i], along + extent_along),
    )
    middle = np.clip((low + high + 2 * shift[i]) / cells.length[i], -1.0, 1.0)
    side = cells.width[i] / 2
    overlap = np.minimum(side, across + extent_across) - np.maximum(-side, across - extent_across)
    return high - low, overlap, middle


def _level(direction: Float) -> Float:
    """Return horizontal unit vectors (n, 2); of a vertical direction, along x."""
    flat = direction[:, :2]
    norm = np.linalg.norm(flat, axis=1, keepdims=True)
    return np.where(norm > 1e-9, flat / np.maximum(norm, 1e-9), np.array([1.0, 0.0]))


def _contacts_within_layer(cells: Cells, pair: Int) -> Contacts:
    """Return contacts at the sides and ends of beads in one layer."""
    along, across, at = _overlap(cells, pair)
    other_along, other_across, other_at = _overlap(cells, pair[:, ::-1])
    gap = -np.minimum(np.minimum(along, across), np.minimum(other_along, other_across))
    i, j = pair[:, 0], pair[:, 1]
    # Close cells of one bead are not side by side.
    apart = _CHAIN_WIDTHS * np.maximum(cells.width[i], cells.width[j])
    is_side = (cells.chain[i] != cells.chain[j]) | (np.abs(cells.arc[i] - cells.arc[j]) > apart)
    # The face of contact lies along the larger overlap. Both frames see it; the smaller is safe.
    face = np.minimum(np.maximum(along, across), np.maximum(other_along, other_across))
    kept = (gap <= CONTACT_TOLERANCE_MM) & (face >= _MIN_CONTACT_MM) & is_side
    pair, face, at = pair[kept], face[kept], np.stack([at, other_at], axis=1)[kept]
    i, j = pair.T
    reach = at * cells.length[pair] / 2
    place = cells.center[pair] + reach[:, :, None] * cells.direction[pair]
    distance = np.linalg.norm(place[:, 0] - place[:, 1], axis=1)
    return Contacts(
        pair,
        np.full(len(pair), ACROSS),
        face * np.minimum(cells.height[i], cells.height[j]),
        np.maximum(distance, 0.25 * np.minimum(cells.width[i], cells.width[j])),
        at,
    )


def _contacts_between_layers(cells: Cells, pair: Int, rise: Float) -> Contacts:
    """Return contacts of beads that lie on each other."""
    along, across, at = _overlap(cells, pair)
    at = np.stack([at, _overlap(cells, pair[:, ::-1])[2]], axis=1)
    kept = (along > _MIN_CONTACT_MM) & (across > _MIN_CONTACT_MM)
    pair, area, rise, at = pair[kept], (along * across)[kept], rise[kept], at[kept]
    # Boxes at an angle overlap less than their extents: limit the sum to the area of each cell.
    limit = (cells.length + cells.reach_back + cells.reach_ahead) * cells.width
    upward = cells.center[pair[:, 0], 2] < cells.center[pair[:, 1], 2]
    lower = np.where(upward, pair[:, 0], pair[:, 1])
    upper = np.where(upward, pair[:, 1], pair[:, 0])
    above = np.bincount(lower, area, len(cells))
    below = np.bincount(upper, area, len(cells))
    scale = np.minimum(limit[lower] / above[lower], limit[upper] / below[upper])
    kind = np.full(len(pair), LAYERS)
    return Contacts(pair, kind, area * np.minimum(scale, 1.0), np.maximum(rise, 0.01), at)
