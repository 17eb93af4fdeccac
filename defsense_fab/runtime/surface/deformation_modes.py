"""Modes of deformation in which rotations and strains are apart, so that states can be mixed.

As rotation-strain coordinates (J. Huang et al., "Interactive shape interpolation through
controllable dynamic deformation", IEEE TVCG 17 (2011)), here on the half edges of a surface: a
state is each vertex' rotation vector, and its edges with that rotation taken out. Mixed linearly,
rotated again and integrated, a simulated state comes back exactly, and turns add up as turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row
from .elastic_net import ElasticNet, rotate_edges
from .surface_mesh import Attachment

# Marker positions as a polynomial of the modes' coordinates: what a fit has to evaluate often.

_LEADING = 3  # modes with terms up to the fifth degree
_MEETING = 4  # modes of which two may meet any other in a term of the third
_RANGE = 1.2  # of the largest coordinate that a state has: how far samples go
_SAMPLES = 2.0  # for each term
_SEED = 3


@dataclass(frozen=True)
class MarkerMap:
    """Terms are products of up to five coordinates, `factors` (t, 5), where k stands for 1;
    `values` (t, m, 3) mm. It is good for coordinates up to `limits` (k,), either way."""

    modes: int
    limits: Float
    factors: Int
    values: Float

    @classmethod
    def of(cls, basis: RotationStrain, attachment: Attachment) -> MarkerMap:
        """Fitted to surfaces at the states and at random coordinates around them."""
        k = basis.modes
        factors = _terms(k)
        limits = _RANGE * np.abs(basis.coordinates).max(axis=0)
        random = np.random.default_rng(_SEED).uniform(
            -1.0, 1.0, (int(_SAMPLES * len(factors)), k)
        )  # fmt: skip
        samples = np.concatenate([np.zeros((1, k)), basis.coordinates, limits * random])
        markers = np.empty((len(samples), *attachment.offset.shape))
        for s, q in enumerate(samples):
            x, rotations, _ = basis.surface(q, basis.net.rest)
            markers[s] = attachment.on_surface(x) + attachment.stand_off(rotations)
        ones = np.concatenate([samples, np.ones((len(samples), 1))], axis=1)
        terms = ones[:, factors].prod(axis=2)
        flat, *_ = np.linalg.lstsq(terms, markers.reshape(len(samples), -1), rcond=1e-12)
        return cls(k, limits, factors, flat.reshape(len(factors), *markers.shape[1:]))

    def at(self, q: Float) -> tuple[Float, Float]:
        """Markers (m, 3) mm, and their derivatives (m, 3, k), at coordinates q (k,)."""
        a = np.append(q, 1.0)[self.factors]
        width = a.shape[1]
        before, after = np.ones((len(a), width + 1)), np.ones((len(a), width + 1))
        before[:, 1:] = np.cumprod(a, axis=1)
        after[:, :-1] = np.cumprod(a[:, ::-1], axis=1)[:, ::-1]
        slopes = np.zeros((len(a), self.modes + 1))
        rows = np.arange(len(a))
        for j in range(width):
            slopes[rows, self.factors[:, j]] += before[:, j] * after[:, j + 1]
        both = np.concatenate([before[:, -1:], slopes[:, :-1]], axis=1)
        found = (both.T @ self.values.reshape(len(self.factors), -1)).reshape(
            self.modes + 1, *self.values.shape[1:]
        )
        return found[0], np.moveaxis(found[1:], 0, 2)


def _terms(k: int) -> Int:
    """(t, 5) coordinates that are multiplied, in rising order, each product once."""
    few = range(min(k, _LEADING))
    found = {
        (),
        *((i,) for i in range(k)),
        *combinations_with_replacement(range(k), 2),
        *(
            tuple(sorted((*pair, i)))
            for pair in combinations_with_replacement(range(min(k, _MEETING)), 2)
            for i in range(k)
        ),
        *combinations_with_replacement(few, 4),
        *combinations_with_replacement(few, 5),
    }
    return np.array([(*term, *(k,) * (5 - len(term))) for term in sorted(found)])


_MODES = 16  # at most
_SMALLEST = 1e-3  # of the largest amplitude


@dataclass(frozen=True)
class RotationStrain:
    """`turns` (k, n, 3) rad and `stretches` (k, h, 3) mm of k modes, whose coordinates have unit
    standard deviation over the simulated states. `coordinates` (s, k) are those of the states."""

    net: ElasticNet
    turns: Float
    stretches: Any  # single precision: reading them is what takes the time
    coordinates: Float

    @classmethod
    def of(cls, net: ElasticNet, states: Float) -> RotationStrain:
        """Of s states with vertices (s, n, 3) mm."""
        turns, stretches = np.empty(states.shape), np.empty((len(states), *net.edges.shape))
        for s, x in enumerate(states):
            rotations = net.rotations(x)
            turns[s] = _rotation_vectors(net.ptr, net.ends, rotations)
            edges = x[net.ends] - x[net.tails]
            turned_back = rotations.reshape(-1, 3, 3)[net.tails]
            stretches[s] = np.einsum("hji,hj->hi", turned_back, edges) - net.edges
        # Both in mm: a turn moves the edges around a vertex.
        lever = np.bincount(
            net.tails, np.abs(net.weights) * (net.edges**2).sum(axis=1), len(net.rest)
        )
        strength = np.sqrt(np.abs(net.weights))
        features = np.concatenate(
            [
                (turns * np.sqrt(lever)[:, None]).reshape(len(states), -1),
                (stretches * strength[:, None]).reshape(len(states), -1),
            ],
            axis=1,
        )
        values, vectors = np.linalg.eigh(features @ features.T)
        values, vectors = values[::-1], vectors[:, ::-1]
        kept = np.flatnonzero(values > _SMALLEST**2 * values[0])[:_MODES]
        mixed = vectors[:, kept] / math.sqrt(len(states))  # of states, at unit coordinates
        return cls(
            net, np.einsum("sk,snd->knd", mixed, turns),
            np.einsum("sk,shd->khd", mixed, stretches).astype(np.float32),
            vectors[:, kept] * math.sqrt(len(states)),
        )  # fmt: skip

    @property
    def modes(self) -> int:
        """Their number k."""
        return len(self.turns)

    def frames(self, q: Float) -> tuple[Float, Float]:
        """Rotations (n, 9) and unrotated edges (h, 3) mm at coordinates q (k,)."""
        turned = (q @ self.turns.reshape(self.modes, -1)).reshape(-1, 3)
        strained = q.astype(np.float32) @ self.stretches.reshape(self.modes, -1)
        return _rotations(turned), self.net.edges + strained.reshape(-1, 3)

    def surface(self, q: Float, before: Float) -> tuple[Float, Float, Float]:
        """Vertices (n, 3) mm, rotations (n, 9), unrotated edges (h, 3) mm at coordinates q (k,);
        `before` (n, 3) is where a surface of which nothing is fixed was."""
        rotations, edges = self.frames(q)
        net, right = self.net, np.zeros((3, len(before)))
        rotate_edges(net.ptr, net.ends, net.weights, edges, rotations, right)
        return net.integrate(right, before), rotations, edges


def _rotation_vectors(ptr: Int, ends: Int, rotations: Float) -> Float:
    """(n, 3) rad of rotations (n, 9), of those half turns apart the ones nearest to neighbours'."""
    vectors = np.empty((len(rotations), 3))
    _logarithms(rotations, vectors)
    _unwind(ptr, ends, vectors)
    return vectors


@compiled()
def _logarithms(rotations: Float, out: Float) -> None:
    for k in range(len(rotations)):
        r = rotations[k]
        # The quaternion by its largest entry, which stays accurate up to half a turn.
        trace = r[0] + r[4] + r[8]
        if trace > 0.0:
            w, x, y, z = 1.0 + trace, r[7] - r[5], r[2] - r[6], r[3] - r[1]
        elif r[0] >= r[4] and r[0] >= r[8]:
            w, x, y, z = r[7] - r[5], 1.0 + r[0] - r[4] - r[8], r[1] + r[3], r[2] + r[6]
        elif r[4] >= r[8]:
            w, x, y, z = r[2] - r[6], r[1] + r[3], 1.0 + r[4] - r[0] - r[8], r[5] + r[7]
        else:
            w, x, y, z = r[3] - r[1], r[2] + r[6], r[5] + r[7], 1.0 + r[8] - r[0] - r[4]
        if w < 0.0:
            w, x, y, z = -w, -x, -y, -z
        sine = math.sqrt(x * x + y * y + z * z)
        scale = 2.0 / w if sine < 1e-12 * w else 2.0 * math.atan2(sine, w) / sine
        out[k, 0], out[k, 1], out[k, 2] = scale * x, scale * y, scale * z


@compiled()
def _unwind(ptr: Int, ends: Int, vectors: Float) -> None:
    """Turns of more than pi: vertex by vertex outwards from the smallest turn, each takes the
    vector nearest to that of the neighbour that it is reached from."""
    n = len(vectors)
    seen, queue = np.zeros(n, np.bool_), np.empty(n, np.int64)
    while not seen.all():
        start, least = -1, np.inf
        for i in range(n):
            size = (vectors[i] ** 2).sum()
            if not seen[i] and size < least:
                start, least = i, size
        queue[0], first, last = start, 0, 1
        seen[start] = True
        while first < last:
            i = queue[first]
            first += 1
            for p in range(ptr[i], ptr[i + 1]):
                j = ends[p]
                if seen[j]:
                    continue
                seen[j] = True
                queue[last] = j
                last += 1
                angle = math.sqrt((vectors[j] ** 2).sum())
                if angle > 1e-9:
                    axis = vectors[j] / angle
                    turns = round(((vectors[i] * axis).sum() - angle) / (2.0 * math.pi))
                    copy_row(axis * (angle + 2.0 * math.pi * turns), vectors[j])


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _rotations(vectors: Float) -> Float:
    """(n, 9) of rotation vectors (n, 3) rad, by Rodrigues' formula."""
    out = np.empty((len(vectors), 9))
    for k in range(len(vectors)):
        x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
        square = x * x + y * y + z * z
        if square < 1e-8:
            s, c = 1.0 - square / 6.0, 0.5 - square / 24.0
        else:
            angle = math.sqrt(square)
            s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
        out[k, 0], out[k, 1], out[k, 2] = (
            1.0 - c * (y * y + z * z),
            c * x * y - s * z,
            c * x * z + s * y,
        )
        out[k, 3], out[k, 4], out[k, 5] = (
            c * x * y + s * z,
            1.0 - c * (x * x + z * z),
            c * y * z - s * x,
        )
        out[k, 6], out[k, 7], out[k, 8] = (
            c * x * z - s * y,
            c * y * z + s * x,
            1.0 - c * (x * x + y * y),
        )
    return out
