"""What a cord's own stiffness changes: every state solved with the cords as lines in the body.

    python -m benchmarks.cord_line fixtures/devices/bar
    python -m benchmarks.cord_line my-device --modulus 3 --assembly bonded

The design takes cords to follow the body and not to hold it back. Here each device is built up to
its layout, and all its states are solved twice on its own mesh: without cords, and with each cord
as a line with the axial stiffness of its rubber. *Bonded*, every piece of it is stretched with the
body around it, and pulls or pushes there; *held*, it slides, has one tension all along, is
stretched as it is laid, and slack below its own rest length. The line acts on the finite elements
that it passes, so its forces are spread over an element's size.

Told are the cords' signals with their stiffness against those without (the slope of a straight line
through all states, and the largest difference in noises of the read-out), how far the markers move
by it (RMS), and errors of decoders on the held-out states: without the lines, with them and trained
so, and with the decoder of the design on them.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Float, Int
from defsense_fab.core.device.device import ASSEMBLIES, Device
from defsense_fab.core.device.device_file import load_device
from defsense_fab.decoding.decoders import AnyDecoder, fit_decoder
from defsense_fab.store.mesh import load_mesh
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh, shape_derivatives
from defsense_fab.mechanics.elements.threads import count_cores
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions, rest_state
from defsense_fab.mechanics.loading.loads import Loads
from defsense_fab.mechanics.solver.batch import Job
from defsense_fab.mechanics.solver.load_stepping import follow
from defsense_fab.mechanics.solver.newton import System
from defsense_fab.sensing.built_cord import BuiltCord, CordReading, required_prestretch
from defsense_fab.store.layout import load_layout, load_prediction
from defsense_fab.sensing.response import mean_strain
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.load_cases import Loading, jobs, loadings

_PIECE = 0.5  # longest piece of a line, mm


@dataclass(frozen=True)
class Line:
    """A cord's pieces: `nodes` (p, 10) of the tets around them, `along` (p, 10), the derivatives of
    the shape functions along the piece, 1/mm, its `direction` (p, 3) and `length` (p,) mm at rest;
    the cord's Young's modulus times its section, `stiffness` N, and how it is built in."""

    nodes: Int
    along: Float
    direction: Float
    length: Float
    stiffness: float
    prestretch: float | None

    @classmethod
    def of(cls, cord: BuiltCord, locator: PointLocator, stiffness: float) -> Line:
        ends = np.cumsum(np.append(0.0, np.linalg.norm(np.diff(cord.path, axis=0), axis=1)))
        count = int(np.ceil(ends[-1] / _PIECE)) + 1
        fine = np.stack(
            [np.interp(np.linspace(0, ends[-1], count), ends, x) for x in cord.path.T], axis=1
        )
        step = np.diff(fine, axis=0)
        length = np.linalg.norm(step, axis=1)
        direction = step / length[:, None]
        at = locator.find((fine[1:] + fine[:-1]) / 2)
        gradient = shape_derivatives(at.bary) @ locator.mesh.bary_gradient[at.cell]
        along = np.einsum("pna,pa->pn", gradient, direction)
        nodes = locator.mesh.cells[at.cell]
        return cls(nodes, along, direction, length, stiffness, cord.prestretch)

    def stretched(self, u: Float) -> tuple[Float, Float]:
        """Unit directions (p, 3) of the deformed pieces, and their stretch (p,)."""
        now = self.direction + np.einsum("pn,pna->pa", self.along, u[self.nodes])
        stretch = np.linalg.norm(now, axis=1)
        return now / stretch[:, None], stretch

    def strain(self, u: Float) -> Float:
        """The cord's own (p,): of each piece, or the same everywhere."""
        stretch = self.stretched(u)[1]
        if self.prestretch is None:
            return stretch - 1
        own = (1 + self.prestretch) * float(stretch @ self.length) / self.length.sum() - 1
        return np.full(len(stretch), own)

    def tension(self, u: Float) -> Float:
        """(p,) N, below zero where a bonded cord is compressed."""
        strain = self.strain(u)
        return self.stiffness * (strain if self.prestretch is None else np.maximum(strain, 0.0))

    def energy(self, u: Float) -> float:
        """N mm."""
        loose = self.length / (1 + (self.prestretch or 0.0))
        return float(0.5 * (self.tension(u) ** 2 / self.stiffness) @ loose)


class LineLoads(Loads):
    """Loads with lines in the body."""

    def __init__(
        self, mesh: QuadraticMesh, conditions: BoundaryConditions, lines: Sequence[Line]
    ) -> None:
        super().__init__(mesh, conditions)
        self._lines = lines

    def energy(self, conditions: BoundaryConditions, u: Float, frozen: Float) -> float:
        return super().energy(conditions, u, frozen) + sum(x.energy(u) for x in self._lines)

    def forces(self, conditions: BoundaryConditions, u: Float, pressure: Float) -> Float:
        out = super().forces(conditions, u, pressure)
        for x in self._lines:
            pull = (x.tension(u) * x.length)[:, None] * x.stretched(u)[0]
            np.add.at(out, x.nodes, -x.along[:, :, None] * pull[:, None])
        return out

    def blocks(self, conditions: BoundaryConditions, u: Float) -> list[tuple[Int, Float]]:
        """Of a sliding cord without what ties its pieces together, and without what compression
        takes off: both small beside the body, and steps, not equilibria, depend on them."""
        out = super().blocks(conditions, u)
        for x in self._lines:
            direction, stretch = x.stretched(u)
            axial = np.einsum("pa,pb->pab", direction, direction)
            pull = np.maximum(x.tension(u), 0.0) / stretch
            tangent = pull[:, None, None] * (np.eye(3) - axial)
            if x.prestretch is None:
                tangent += x.stiffness * axial
            by = np.einsum("p,pn,pm,pab->pnamb", x.length, x.along, x.along, tangent)
            # Pieces in one tet are one block.
            nodes, first, which = np.unique(x.nodes, axis=0, return_index=True, return_inverse=True)
            merged = np.zeros((len(first), 10, 3, 10, 3))
            np.add.at(merged, which.ravel(), by)
            out += list(zip(nodes, merged.reshape(-1, 30, 30), strict=True))
        return out


def solved(
    mesh: QuadraticMesh,
    material: Material,
    plan: Sequence[Loading],
    todo: Sequence[Job],
    lines: Sequence[Line],
) -> tuple[Float, dict[str, Float]]:
    """Displacements (n, 3) mm at rest and in each state that is reached."""
    unloaded, out = np.zeros_like(mesh.nodes), {}
    for loading, job in zip(plan, todo, strict=True):
        loads = LineLoads(mesh, job.conditions, lines)
        system = System(mesh, material, job.conditions, count_cores(), loads)
        try:
            begun = system.equilibrium(rest_state(job.conditions, len(mesh.nodes)))
            if begun.state is None:
                continue
            unloaded = begun.state.u
            ways = follow(system, begun.state, job.conditions, job.fractions)
        finally:
            system.close()
        for fraction, result in zip(job.fractions, ways, strict=False):
            if result.u is not None and result.problem is None:
                out[loading.state(fraction)] = result.u
    return unloaded, out


def signals(line: Line, cord: BuiltCord, reading: CordReading, u: Sequence[Float]) -> Float:
    """(R - R0)/R0 of the cord in states u, of which the first is rest."""
    loose = line.length / (1 + (line.prestretch or 0.0))
    strains = [line.strain(x) for x in u]
    if line.prestretch is not None:
        strains = [np.maximum(s, 0.0) for s in strains]
    ohm = [float((1 + reading.response(s)) @ loose) + cord.series for s in strains]
    return np.array(ohm) / ohm[0] - 1


@dataclass(frozen=True)
class Recorded:
    """Signals (s, c) and markers' displacements (s, 3 k) mm in the same states, rest first."""

    signals: Float
    markers: Float

    def trained(self, kind: str, taught: Float, noise: Float) -> AnyDecoder:
        return fit_decoder(kind, self.signals[taught], self.markers[taught], noise)

    def error(self, decoder: AnyDecoder, tested: Float, noise: Float) -> float:
        """RMSE (mm) with noise."""
        read = self.signals[tested]
        off = (decoder(read) - self.markers[tested]) ** 2 + decoder.noise_variance(read, noise)
        return float(np.sqrt(off.reshape(len(off), -1, 3).sum(2).mean()))


def built_in(device: Device, cord: BuiltCord, assembly: str, deformed: Float) -> BuiltCord:
    """The cord bonded, or held and stretched as it is laid by as much as the states (s, p, 3) mm of
    its path need."""
    if assembly == "bonded":
        return replace(cord, prestretch=None)
    own = device.fabrication.prestretch
    least = float(mean_strain(cord.path, deformed).min())
    return replace(cord, prestretch=required_prestretch(least) if own is None else own)


def compare(path: Path, options: argparse.Namespace) -> None:
    """The rows of a device."""
    device = load_device(path)
    folder = build(device, "optimize").folder
    layout, reading = load_layout(folder), CordReading.from_device(device)
    mesh = QuadraticMesh.from_linear(load_mesh(folder))
    material, locator = Material.from_spec(device.material), PointLocator(mesh)
    plan, todo, _ = jobs(device, mesh, loadings(device))
    points = locator.find(load_prediction(folder).markers)
    modulus = device.cord.modulus if options.modulus is None else options.modulus
    stiffness = modulus * np.pi / 4 * device.cord.diameter**2
    rest_free, free = solved(mesh, material, plan, todo, [])
    for assembly in options.assembly:
        cords = []
        for record in layout.by_channel():
            moves = locator.displacement(locator.find(record.stretch), np.stack([*free.values()]))
            cords.append(built_in(device, record.built, assembly, record.stretch + moves))
        lines = [Line.of(c, locator, stiffness) for c in cords]
        rest_held, held = solved(mesh, material, plan, todo, lines)
        names = [n for n in free if n in held]
        found = []
        for first, states in ((rest_free, free), (rest_held, held)):
            u = [first, *(states[n] for n in names)]
            at = locator.displacement(points, np.stack(u))
            columns = [signals(x, c, reading, u) for x, c in zip(lines, cords, strict=True)]
            found.append(Recorded(np.stack(columns, 1), (at - at[0]).reshape(len(u), -1)))
        without, stiff = found
        noise = np.array([reading.noise(c) for c in cords])
        held_out = {x.state(f) for x in plan if x.held_out for f in x.fractions}
        tested = np.array([False, *(n in held_out for n in names)])
        if not tested.any():
            print(f"{device.name}: no state is held out; errors are those of the fitted states")
        taught = ~tested
        tested = tested if tested.any() else taught
        kind = layout.prediction.decoder
        plain = without.trained(kind, taught, noise)
        slope = (without.signals * stiff.signals).sum(0) / (without.signals**2).sum(0)
        apart = (np.abs(stiff.signals - without.signals) / noise).max()
        off = np.linalg.norm((stiff.markers - without.markers).reshape(-1, 3), axis=1)
        errors = (
            without.error(plain, tested, noise),
            stiff.error(stiff.trained(kind, taught, noise), tested, noise),
            stiff.error(plain, tested, noise),
        )
        print(f"{device.name:<16} {assembly:<8} {stiffness:7.1f} {slope.min():8.3f}-"
              f"{slope.max():.3f} {apart:8.1f} {np.sqrt((off**2).mean()):8.3f}"
              + "".join(f"{e:10.3f}" for e in errors), flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="+", type=Path)
    parser.add_argument("--modulus", type=float, help="of the cord's rubber, MPa")
    parser.add_argument("--assembly", nargs="*", choices=ASSEMBLIES, default=list(ASSEMBLIES))
    options = parser.parse_args()
    print("device           assembly  cord, N        slope   noises  moved mm   without"
          "      with untrained")  # fmt: skip
    for path in options.folder:
        compare(path, options)


if __name__ == "__main__":
    main()
