"""Surfaces from few markers against the fields of built devices that they are samples of.

    python -m benchmarks.surface_truth DEVICE... [--markers 20 40] [--draws 3]

DEVICE is a folder that `defsense simulate` has been run on. Errors are RMS over the surface, by
area, in mm, over all states of a kind and draws of noise; every surface is found from rest, without
a frame before. Kinds of states, and the basis that they are found with:

    trained      states of the design, with all of them
    in-between   parts of full amplitudes, with the states of full amplitude
    unseen       states held out of the design, with those of the design
    mixtures     all mixtures of poses, with the poses by themselves
    new pose     the last pose by itself, with the design's states that have nothing of it

`arap` has the markers as hard constraints, `soft` weights them by their noise; `linear` is a basis
of principal displacements, with coordinates of the states' variance; `basis` are the modes of the
default by themselves. `ratio` is the default's error by the least of the first three. Exact markers
are told to be good to 0.02 mm.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import igl
import numpy as np

from defsense_fab.store.mesh import load_mesh
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.store.fields import Fields, load_fields
from defsense_fab.runtime.surface.live_surface import make_surface
from defsense_fab.runtime.surface.surface_mesh import Attachment, SurfaceBasis, vertex_areas

NOISES = (0.0, 0.5, 1.0)
EXACT = 0.02
METHODS = ("arap", "soft", "linear", "basis", "default")


def device_surface(folder: Path) -> tuple[SurfaceBasis, Fields]:
    """The boundary of the mesh, triangles in four, with all states of a build."""
    fields, mesh = load_fields(folder), load_mesh(folder)
    surface, _ = mesh.boundary().compact()
    vertices, triangles = igl.upsample(surface.vertices, surface.faces.astype(np.int64))
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    states = locator.displacement(locator.find(vertices), fields.displacements)
    fixed = np.abs(states).max(axis=(0, 2)) < 1e-9
    return SurfaceBasis(vertices, triangles.astype(np.int64), states, fixed), fields


def spread(basis: SurfaceBasis, count: int, seed: int = 1) -> np.ndarray:
    """Markers (count, 3) mm far from each other on what moves, between vertices."""
    rng = np.random.default_rng(seed)
    free = basis.triangles[~basis.fixed[basis.triangles].any(axis=1)]
    corners = basis.vertices[free]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(free), 4000, p=area / area.sum())
    points = np.einsum("pk,pkd->pd", rng.dirichlet(np.ones(3), 4000), corners[face])
    chosen, away = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


class Linear:
    """Coordinates of principal displacements, with the states' variance, by least squares."""

    def __init__(self, basis: SurfaceBasis, attachment: Attachment, sd: float) -> None:
        flat = basis.states.reshape(len(basis.states), -1)
        _, values, axes = np.linalg.svd(flat, full_matrices=False)
        kept = values > 1e-4 * values[0]
        self.modes = (axes * values[:, None])[kept].reshape(-1, *basis.vertices.shape)
        self.modes /= np.sqrt(len(flat))
        self.rest, self.attachment = basis.vertices, attachment
        self.at = np.array([attachment.on_surface(mode).ravel() for mode in self.modes]).T / sd
        self.sd = sd

    def __call__(self, markers: np.ndarray) -> np.ndarray:
        off = (markers - self.attachment.on_surface(self.rest)).ravel() / self.sd
        q = np.linalg.solve(self.at.T @ self.at + np.eye(len(self.modes)), self.at.T @ off)
        return self.rest + np.tensordot(q, self.modes, 1)


def kinds(fields: Fields) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Of each kind, the states of the basis and those that are looked for."""
    design = ~fields.held_out
    alone = np.array([len(w) == 1 for w in fields.weights])
    full = np.array([max(w.values()) == 1.0 for w in fields.weights])
    last = list(dict.fromkeys(n for w in fields.weights for n in w))[-1]
    has = np.array([last in w for w in fields.weights])
    return {
        "trained": (design, design),
        "in-between": (design & full, design & ~full),
        "unseen": (design, ~design),
        "mixtures": (alone, ~alone),
        "new pose": (design & ~has, alone & has),
    }


def score(basis: SurfaceBasis, scored: np.ndarray, markers: np.ndarray, noise: float, draws: int):
    """RMS error of each method over all states (s, v, 3) and draws."""
    sd = np.full(len(markers), max(noise, EXACT))
    attachment = Attachment.of(markers, basis.vertices, basis.triangles)
    rigid = make_surface(basis, markers, np.zeros(len(markers)), "arap", frame=np.inf)
    methods = {
        "arap": rigid,
        "soft": make_surface(basis, markers, sd, "arap", frame=np.inf),
        "linear": Linear(basis, attachment, float(sd[0])),
        "basis": make_surface(basis, markers, sd, "basis", frame=np.inf),
        "default": make_surface(basis, markers, sd, frame=np.inf),
    }
    area = vertex_areas(basis.vertices, basis.triangles)
    squares = {name: [] for name in METHODS}
    for k, u in enumerate(scored):
        truth = basis.vertices + u
        for draw in range(draws if noise else 1):
            rng = np.random.default_rng([k, draw])
            seen = attachment.on_surface(truth) + noise * rng.standard_normal(markers.shape)
            for name, method in methods.items():
                if name != "linear":
                    method.reset()
                off = ((method(seen) - truth) ** 2).sum(axis=1)
                squares[name].append(area @ off / area.sum())
    return {name: float(np.sqrt(np.mean(s))) for name, s in squares.items()}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("devices", nargs="+", type=Path)
    parser.add_argument("--markers", nargs="+", type=int, default=[20, 40])
    parser.add_argument("--draws", type=int, default=3)
    options = parser.parse_args()
    print("| device | markers | states | noise, mm | " + " | ".join(METHODS) + " | ratio |")
    print("|---" * (5 + len(METHODS)) + "|")
    for device in options.devices:
        whole, fields = device_surface(device / "build")
        for count in options.markers:
            markers = spread(whole, count)
            for kind, (known, asked) in kinds(fields).items():
                basis = SurfaceBasis(
                    whole.vertices, whole.triangles, whole.states[known], whole.fixed
                )
                for noise in NOISES:
                    rms = score(basis, whole.states[asked], markers, noise, options.draws)
                    ratio = rms["default"] / min(rms[n] for n in ("arap", "soft", "linear"))
                    row = " | ".join(f"{rms[n]:.3f}" for n in METHODS)
                    print(f"| {device.name} | {count} | {kind} | {noise} | {row} | {ratio:.2f} |",
                          flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
