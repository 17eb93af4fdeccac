"""How far the surface that is read lies from the true one, in every state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..decoding.decoders import fit_decoder
from ..decoding.expected_errors import choose_unseen_states
from ..store.build import Build
from ..store.fields import Fields

#: Of the errors in the states that are shown, per cent: the end of their scale.
_TOP = 99.5


@dataclass(frozen=True)
class SurfaceErrors:
    """Of s states without rest: their `names`, how much of each pose they have, which are
    `held_out` (s,) of the design; surface vertices at `rest` (v, 3) mm, `faces` (f, 3), their
    displacements `moved` (s, v, 3) mm, their largest principal `strain` (s, v), by which vectors
    the decoder misses them without noise, `missed` (s, v, 3) mm, and by how much, `error` (s, v)
    mm; the states that are `shown` in reports, the `highest` error of a scale that is the same for
    all, mm, and the `fields` that all is made of."""

    names: tuple[str, ...]
    weights: tuple[Mapping[str, float], ...]
    held_out: Bool
    rest: Float
    faces: Int
    moved: Float
    strain: Float
    missed: Float
    error: Float
    shown: tuple[int, ...]
    highest: float
    fields: Fields

    def mean(self, state: int) -> float:
        """RMSE (mm) over the vertices."""
        return float(np.sqrt((self.error[state] ** 2).mean()))


def surface_errors(build: Build) -> SurfaceErrors:
    """Return the errors of the surface that a build's layout reads in every simulated state.

    Raises:
        StorageError: The build has no layout or no simulated poses.
    """
    found = build.fields
    boundary = build.mesh.boundary()
    used = np.unique(boundary.faces)
    index = np.zeros(len(boundary.vertices), int)
    index[used] = np.arange(len(used))
    rest, faces = boundary.vertices[used], index[boundary.faces]
    signals, prediction = build.prediction.signals, build.layout.prediction
    moved = np.concatenate([np.zeros((1, *rest.shape)), found.displacements[:, used]])
    seen = ~np.append(False, found.held_out)
    flat = moved.reshape(len(moved), -1)
    decoder = fit_decoder(prediction.decoder, signals[seen], flat[seen], np.array(prediction.noise))
    missed = (decoder(signals).reshape(moved.shape) - moved)[1:]
    error = np.linalg.norm(missed, axis=2)
    shown = _fullest(found.weights, found.held_out)
    held_out = np.flatnonzero(found.held_out)
    if len(held_out):
        shown.append(int(held_out[(error[held_out] ** 2).mean(axis=1).argmax()]))
    return SurfaceErrors(
        found.names,
        found.weights,
        found.held_out,
        rest,
        faces,
        moved[1:],
        found.strains[:, used],
        missed,
        error,
        tuple(shown),
        float(np.percentile(error[shown], _TOP)),
        found,
    )


def state_words(weights: Mapping[str, float]) -> str:
    """How much of each pose a state has, for readers: "bend + twist 50 %"."""
    return " + ".join(n if w == 1 else f"{n} {100 * w:g} %" for n, w in weights.items() if w)


def _fullest(weights: Sequence[Mapping[str, float]], held_out: Bool) -> list[int]:
    """Of each path of loading among states that are not held out, the one furthest along."""
    seen = np.flatnonzero(~held_out)
    paths = choose_unseen_states(
        ({}, *(w for w, held in zip(weights, held_out, strict=True) if not held)),
        np.zeros(len(seen) + 1, bool),
    ).paths
    return sorted(int(seen[int(k[at.argmax()]) - 1]) for k, at in paths)
