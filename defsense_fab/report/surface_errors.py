"""Compute the error of the read surface in every simulated state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.errors import StorageError
from ..decoding.decoders import fit_decoder
from ..decoding.expected_errors import choose_unseen_states
from ..store.build import Build
from ..store.fields import Fields

#: Percentile of the errors in the shown states at the end of their scale.
_TOP_ERROR_PERCENTILE = 99.5


@dataclass(frozen=True)
class SurfaceErrors:
    """Errors of the read surface in s states; rest is not included.

    Attributes:
        names: Names of the states.
        weights: Share of each pose in each state.
        held_out: Whether the layout was optimized without each state (s,).
        rest: Vertices (v, 3) of the surface at rest, mm.
        faces: Triangles (f, 3).
        moved: Displacements (s, v, 3), mm.
        strain: Largest principal strain (s, v).
        missed: Error vectors (s, v, 3) of the decoder without noise, mm.
        error: Lengths (s, v) of the error vectors, mm.
        shown: Indices of the states that reports show.
        highest: End of the color scale of all states, mm.
        fields: Simulated fields.
    """

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
        """Return the RMSE of a state over the vertices, mm."""
        return float(np.sqrt((self.error[state] ** 2).mean()))

    def travel(self, state: int) -> float:
        """Return the largest movement of the vertices in a state, mm."""
        return float(np.linalg.norm(self.moved[state], axis=1).max())


def surface_errors(build: Build) -> SurfaceErrors:
    """Return the errors of the surface that a build's layout reads in every simulated state.

    Raises:
        StorageError: The build has no layout or no simulated poses, or the poses were simulated
            again after the layout was found.
    """
    fields = build.fields
    boundary = build.mesh.boundary()
    used = np.unique(boundary.faces)
    index = np.zeros(len(boundary.vertices), int)
    index[used] = np.arange(len(used))
    rest, faces = boundary.vertices[used], index[boundary.faces]
    signals, prediction = build.prediction.signals, build.layout.prediction
    moved = np.concatenate([np.zeros((1, *rest.shape)), fields.displacements[:, used]])
    if len(signals) != len(moved):
        raise StorageError(
            "the layout belongs to earlier states of the poses",
            code="build-outdated",
            action="Optimize the cords again",
        )
    is_trained = ~np.append(False, fields.held_out)
    flat_moved = moved.reshape(len(moved), -1)
    decoder = fit_decoder(
        prediction.decoder, signals[is_trained], flat_moved[is_trained], np.array(prediction.noise)
    )
    missed = (decoder(signals).reshape(moved.shape) - moved)[1:]
    error = np.linalg.norm(missed, axis=2)
    shown = _fullest(fields.weights, fields.held_out)
    held_out = np.flatnonzero(fields.held_out)
    if len(held_out):
        # Poses may have other names now than in the layout.
        names, with_noise = build.prediction.states[1:], build.layout.prediction.held_out
        shown.append(int(max(held_out, key=lambda k: with_noise[names[k]])))
    return SurfaceErrors(
        fields.names,
        fields.weights,
        fields.held_out,
        rest,
        faces,
        moved[1:],
        fields.strains[:, used],
        missed,
        error,
        tuple(shown),
        float(np.percentile(error[shown], _TOP_ERROR_PERCENTILE)),
        fields,
    )


def state_words(weights: Mapping[str, float]) -> str:
    """Describe the poses of a state, as in "bend + twist 50 %"."""
    return " + ".join(n if w == 1 else f"{n} {100 * w:g} %" for n, w in weights.items() if w)


def _fullest(weights: Sequence[Mapping[str, float]], held_out: Bool) -> list[int]:
    """Return the state furthest along each path of loading, among states that are not held out."""
    trained = np.flatnonzero(~held_out)
    paths = choose_unseen_states(
        ({}, *(w for w, held in zip(weights, held_out, strict=True) if not held)),
        np.zeros(len(trained) + 1, bool),
    ).paths
    return sorted(int(trained[int(k[at.argmax()]) - 1]) for k, at in paths)
