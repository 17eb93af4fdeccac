"""Modes of deformation with separate rotations and strains, and the markers as functions of them.

A state is each vertex' rotation vector, and its half edges with that rotation removed. Mixed
linearly, rotated again and integrated, simulated states are reproduced exactly, and rotations add
up as rotations. `MarkerMap` approximates the resulting marker positions by polynomials, which a fit
can evaluate often.

References:
    J. Huang et al., "Interactive shape interpolation through controllable dynamic deformation",
    IEEE TVCG 17 (2011).
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

_QUINTIC_MODES = 3  # leading modes with terms up to the fifth degree
_CUBIC_MODES = 4  # modes of which two may be combined with any other in a cubic term
_SAMPLE_RANGE = 1.2  # of the largest coordinate of a state
_SAMPLES_PER_TERM = 2.0
_SEED = 3


@dataclass(frozen=True)
class MarkerMap:
    """Marker positions as a polynomial of the modes' coordinates.

    Attributes:
        modes: Number of modes k.
        limits: Largest coordinates for which it is valid, in both directions (k,).
        factors: Terms as products of up to five coordinates (t, 5); the index k stands for 1.
        values: Coefficients of the terms (t, m, 3), mm.
    """

    modes: int
    limits: Float
    factors: Int
    values: Float

    @classmethod
    def of(cls, basis: RotationStrain, attachment: Attachment) -> MarkerMap:
        """Fit the polynomial to surfaces at the states and at random coordinates around them."""
        k = basis.modes
        factors = _terms(k)
        limits = _SAMPLE_RANGE * np.abs(basis.coordinates).max(axis=0)
        random = np.random.default_rng(_SEED).uniform(
            -1.0, 1.0, (int(_SAMPLES_PER_TERM * len(factors)), k)
        )
        samples = np.concatenate([np.zeros((1, k)), basis.coordinates, limits * random])
        markers = np.empty((len(samples), *attachment.offset.shape))
        for s, q in enumerate(samples):
            x, rotations, _ = basis.surface(q, basis.net.rest)
            markers[s] = attachment.on_surface(x) + attachment.stand_off(rotations)
        ones = np.concatenate([samples, np.ones((len(samples), 1))], axis=1)
        terms = ones[:, factors].prod(axis=2)
        flat, *_ = np.linalg.lstsq(terms, markers.reshape(len(samples), -1), rcond=1e-12)
        return cls(k, limits, factors, flat.reshape(len(factors), *markers.shape[1:]))

    def evaluate(self, q: Float) -> tuple[Float, Float]:
        """Return markers (m, 3), mm, and their derivatives (m, 3, k) at coordinates q (k,)."""
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
        markers = (both.T @ self.values.reshape(len(self.factors), -1)).reshape(
            self.modes + 1, *self.values.shape[1:]
        )
        return markers[0], np.moveaxis(markers[1:], 0, 2)


def _terms(k: int) -> Int:
    """Return the coordinates of each product (t, 5), sorted, each product once."""
    leading = range(min(k, _QUINTIC_MODES))
    terms = {
        (),
        *((i,) for i in range(k)),
        *combinations_with_replacement(range(k), 2),
        *(
            tuple(sorted((*pair, i)))
            for pair in combinations_with_replacement(range(min(k, _CUBIC_MODES)), 2)
            for i in range(k)
        ),
        *combinations_with_replacement(leading, 4),
        *combinations_with_replacement(leading, 5),
    }
    return np.array([(*term, *(k,) * (5 - len(term))) for term in sorted(terms)])


_MAX_MODES = 16
_MIN_AMPLITUDE = 1e-3  # of the largest


@dataclass(frozen=True)
class RotationStrain:
    """Modes in rotation-strain coordinates.

    Attributes:
        net: Half edges of the surface.
        turns: Rotation vectors of the k modes (k, n, 3), rad.
        stretches: Their changes of unrotated edges (k, h, 3), mm, in single precision: reading them
            takes most of the time.
        coordinates: Coordinates of the simulated states (s, k), with unit standard deviation.
    """

    net: ElasticNet
    turns: Float
    stretches: Any
    coordinates: Float

    @classmethod
    def of(cls, net: ElasticNet, states: Float) -> RotationStrain:
        """Compute the modes of s states with vertices (s, n, 3), mm."""
        turns, stretches = np.empty(states.shape), np.empty((len(states), *net.edges.shape))
        for s, x in enumerate(states):
            rotations = net.rotations(x)
            turns[s] = _rotation_vectors(net.ptr, net.ends, rotations)
            edges = x[net.ends] - x[net.tails]
            turned_back = rotations.reshape(-1, 3, 3)[net.tails]
            stretches[s] = np.einsum("hji,hj->hi", turned_back, edges) - net.edges
        # Both in mm: a rotation moves the edges around a vertex.
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
        modes = np.flatnonzero(values > _MIN_AMPLITUDE**2 * values[0])[:_MAX_MODES]
        mixed = vectors[:, modes] / math.sqrt(len(states))  # of the states, at unit coordinates
        return cls(
            net,
            np.einsum("sk,snd->knd", mixed, turns),
            np.einsum("sk,shd->khd", mixed, stretches).astype(np.float32),
            vectors[:, modes] * math.sqrt(len(states)),
        )

    @property
    def modes(self) -> int:
        """Number of modes k."""
        return len(self.turns)

    def frames(self, q: Float) -> tuple[Float, Float]:
        """Return rotations (n, 9) and unrotated edges (h, 3), mm, at coordinates q (k,)."""
        turned = (q @ self.turns.reshape(self.modes, -1)).reshape(-1, 3)
        strained = q.astype(np.float32) @ self.stretches.reshape(self.modes, -1)
        return _rotations(turned), self.net.edges + strained.reshape(-1, 3)

    def surface(self, q: Float, before: Float) -> tuple[Float, Float, Float]:
        """Return vertices (n, 3), mm, rotations (n, 9) and unrotated edges (h, 3), mm.

        Args:
            q: Coordinates (k,).
            before: Former vertices (n, 3), mm, near which a surface without fixed vertices stays.
        """
        rotations, edges = self.frames(q)
        net, right = self.net, np.zeros((3, len(before)))
        rotate_edges(net.ptr, net.ends, net.weights, edges, rotations, right)
        return net.integrate(right, before), rotations, edges


def _rotation_vectors(ptr: Int, ends: Int, rotations: Float) -> Float:
    """Return rotation vectors (n, 3), rad, consistent between neighbors, of rotations (n, 9)."""
    vectors = np.empty((len(rotations), 3))
    _logarithms(rotations, vectors)
    _unwind(ptr, ends, vectors)
    return vectors


@compiled()
def _logarithms(rotations: Float, out: Float) -> None:
    for k in range(len(rotations)):
        r = rotations[k]
        # The quaternion by its largest entry is accurate up to half a turn.
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
    """Extend rotation vectors beyond pi.

    Vertex by vertex outwards from the smallest rotation, each takes the vector nearest to that of
    the neighbor that it is reached from.
    """
    n = len(vectors)
    visited, queue = np.zeros(n, np.bool_), np.empty(n, np.int64)
    while not visited.all():
        start, smallest = -1, np.inf
        for i in range(n):
            size = (vectors[i] ** 2).sum()
            if not visited[i] and size < smallest:
                start, smallest = i, size
        queue[0], first, last = start, 0, 1
        visited[start] = True
        while first < last:
            i = queue[first]
            first += 1
            for p in range(ptr[i], ptr[i + 1]):
                j = ends[p]
                if visited[j]:
                    continue
                visited[j] = True
                queue[last] = j
                last += 1
                angle = math.sqrt((vectors[j] ** 2).sum())
                if angle > 1e-9:
                    axis = vectors[j] / angle
                    turns = round(((vectors[i] * axis).sum() - angle) / (2.0 * math.pi))
                    copy_row(axis * (angle + 2.0 * math.pi * turns), vectors[j])


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _rotations(vectors: Float) -> Float:
    """Return rotations (n, 9) of rotation vectors (n, 3), rad, by Rodrigues' formula."""
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
