"""Measure the time per surface frame, next to libigl's as-rigid-as-possible solver.

    OMP_NUM_THREADS=1 python -m benchmarks.live_surface [arap] [motion] [frames]

A bar of 150 x 30 x 30 mm is held at one end, bent and twisted. It has 40 markers, and about 1,000,
10,000 and 50,000 vertices; one thread. Times are minimum and median in ms: on a busy machine the
minimum is the time of the program.

    arap    one round with hard markers at vertices against one of `arap_solve` (spokes), and the
            distance of both from the converged shape after 20 rounds from rest
    motion  60 frames per second, the tip at up to 236 mm/s and 19 mm/s: the RMS difference between
            one frame by the default, or two rounds of as-rigid-as-possible, and their limits (500
            rounds); in mm, relative to the displacement, and to the movement in a frame
    frames  whole frames of the default and of as-rigid-as-possible with two rounds, as the live
            loop calls them: with a cage from 15,000 vertices on
"""

from __future__ import annotations

import argparse
import time
from functools import partial

import igl
import numpy as np

from defsense_fab.runtime.surface.elastic_net import ElasticNet
from defsense_fab.runtime.surface.live_surface import make_surface
from defsense_fab.runtime.surface.surface_mesh import Attachment, SurfaceBasis
from defsense_fab.runtime.surface.surface_solvers import ArapSolver, TimeBudget

LENGTH, WIDTH, MARKERS = 150.0, 30.0, 40
CELLS = {1_000: 34, 10_000: 107, 50_000: 239}  # along the bar
POSES = [(0.5, 0), (0.25, 0), (-0.5, 0), (-0.25, 0), (0, 0.7), (0, 0.35), (0.5, 0.7), (-0.5, 0.7)]


def bar(cells: int):
    """Return vertices and triangles of the surface of the bar, and which vertices are held."""
    across = max(2, cells // 5)
    counts = np.array([cells, across, across])
    points, faces, first = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            i, j = np.meshgrid(np.arange(counts[u] + 1), np.arange(counts[v] + 1), indexing="ij")
            grid = np.zeros((i.size, 3), np.int64)
            grid[:, axis], grid[:, u], grid[:, v] = side * counts[axis], i.ravel(), j.ravel()
            a = (np.arange(counts[u])[:, None] * (counts[v] + 1) + np.arange(counts[v])).ravel()
            b, c, d = a + counts[v] + 1, a + counts[v] + 2, a + 1
            quads = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
            faces.append(first + (quads if side else quads[:, ::-1]))
            points.append(grid)
            first += len(grid)
    used, index = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    vertices = used / counts * [LENGTH, WIDTH, WIDTH] - [0, WIDTH / 2, WIDTH / 2]
    return vertices, index.reshape(-1)[np.concatenate(faces)], used[:, 0] == 0


def bent(x, bend, twist):
    """Return the vertices bent by constant curvature and uniform twist; angles (rad) at the tip."""
    turn = twist * x[:, 0] / LENGTH
    y = np.cos(turn) * x[:, 1] - np.sin(turn) * x[:, 2]
    z = np.sin(turn) * x[:, 1] + np.cos(turn) * x[:, 2]
    if abs(bend) < 1e-9:
        return np.stack([x[:, 0], y, z], axis=1)
    r, angle = LENGTH / bend, bend * x[:, 0] / LENGTH
    return np.stack([(r - z) * np.sin(angle), y, r - (r - z) * np.cos(angle)], axis=1)


def spread(points, count):
    chosen, away = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def timed(call, least=40):
    times_ms = []
    for _ in range(least):
        started_at = time.perf_counter()
        call()
        times_ms.append(1e3 * (time.perf_counter() - started_at))
    return min(times_ms), float(np.median(times_ms))


def rms(a, b):
    return float(np.sqrt(((a - b) ** 2).sum(axis=1).mean()))


def rigid(vertices, triangles, held, markers, still=0.0, most=2):
    net = ElasticNet.of(vertices, triangles, held)
    attachment = Attachment.of(markers, net.rest, net.triangles)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    return ArapSolver(net, attachment, size, still, most), net


def arap():
    print(
        "| vertices | this, ms | libigl, ms | times | set-up, s | libigl's, s | off after 20, mm |"
        " libigl's, mm |"
    )
    print("|---" * 8 + "|")
    for cells in CELLS.values():
        vertices, triangles, held = bar(cells)
        base, free = np.flatnonzero(held), np.flatnonzero(~held)
        which = free[spread(vertices[free], MARKERS)]
        places, hard = bent(vertices, 0.5, 0.7)[which], np.zeros(MARKERS)
        started_at = time.perf_counter()
        solver, net = rigid(vertices, triangles, held, vertices[which])
        ours_setup = time.perf_counter() - started_at
        both = np.concatenate([base, which]).astype(np.int32)
        targets = np.concatenate([vertices[base], places])
        data = igl.ARAPData()
        data.energy = igl.ARAP_ENERGY_TYPE_SPOKES
        started_at = time.perf_counter()
        igl.arap_precomputation(vertices, triangles, 3, both, data)
        theirs_setup = time.perf_counter() - started_at

        def libigl(rounds, data=data, targets=targets, rest=vertices):
            data.max_iter = rounds
            return igl.arap_solve(targets, data, rest.copy())

        def frame(solver=solver, places=places, hard=hard):
            solver.solve(places, hard, TimeBudget(None))

        solver.max_rounds = 1
        ours = timed(frame)
        one, eleven = (timed(partial(libigl, rounds), 9) for rounds in (1, 11))
        theirs = [(b - a) / 10 for a, b in zip(one, eleven, strict=True)]
        solver.max_rounds = 20
        solver.reset()
        after = solver.solve(places, hard, TimeBudget(None))[0].copy()
        their_shape = libigl(20)[net.order]
        solver.max_rounds = 3000
        exact, _ = solver.solve(places, hard, TimeBudget(None))
        print(f"| {len(vertices):,} | {ours[0]:.2f} ({ours[1]:.2f}) | {theirs[0]:.2f}"
              f" ({theirs[1]:.2f}) | {theirs[0] / ours[0]:.1f} | {ours_setup:.2f} |"
              f" {theirs_setup:.2f} | {rms(after, exact):.3f} | {rms(their_shape, exact):.3f} |",
              flush=True)  # fmt: skip


def motion():
    print("| vertices | mode | tip, mm/s | off, mm | of displacement | of a frame's movement |")
    print("|---" * 6 + "|")
    for mode, size in (("default", 10_000), ("arap", 1_000), ("arap", 10_000)):
        vertices, triangles, held = bar(CELLS[size])
        free = np.flatnonzero(~held)
        markers = vertices[free[spread(vertices[free], MARKERS)]]
        states = np.array([bent(vertices, *p) - vertices for p in POSES])
        basis = SurfaceBasis(vertices, triangles, states, held)
        live, converged = (
            make_surface(basis, markers, np.full(MARKERS, 0.1), mode, np.inf) for _ in range(2)
        )
        if mode == "arap":
            live._solver.max_rounds, converged._solver.max_rounds = 2, 500
        for hertz in (1.0, 0.08):  # of swings to and fro, by 0.5 rad and 0.7 rad
            live.reset()
            off, moved, step = [], [], []
            for k in range(40):
                now, later = (np.sin(2 * np.pi * hertz * (k + i) / 60) for i in (0, 1))
                x = live(bent(markers, 0.5 * now, 0.7 * now), budget=[0.0, None][mode == "arap"])
                if k % 13 == 0 and k:
                    known = converged(bent(markers, 0.5 * now, 0.7 * now))
                    off.append(rms(x, known))
                    moved.append(rms(known, vertices))
                    step.append(rms(bent(vertices, 0.5 * later, 0.7 * later),
                                    bent(vertices, 0.5 * now, 0.7 * now)))  # fmt: skip
            speed = 2 * np.pi * hertz * 0.25 * LENGTH
            print(f"| {len(vertices):,} | {mode} | {speed:.0f} | {np.mean(off):.3f} |"
                  f" {np.mean(off) / np.mean(moved):.2%} | {np.mean(off) / np.mean(step):.1%} |",
                  flush=True)  # fmt: skip


def frames():
    print(
        "| vertices | mode | one step, ms | as many as it wants, ms | off, mm | set-up, s | how |"
    )
    print("|---" * 7 + "|")
    for cells in CELLS.values():
        vertices, triangles, held = bar(cells)
        free = np.flatnonzero(~held)
        markers = vertices[free[spread(vertices[free], MARKERS)]]
        states = np.array([bent(vertices, *p) - vertices for p in POSES])
        basis = SurfaceBasis(vertices, triangles, states, held)
        for mode in ("default", "arap"):
            started_at = time.perf_counter()
            surface = make_surface(basis, markers, np.full(MARKERS, 0.1), mode)
            setup = time.perf_counter() - started_at
            if mode == "arap":
                surface._solver.max_rounds = 2
            phases = iter(np.sin(np.arange(1000) * 0.05))

            def frame(budget, surface=surface, markers=markers, phases=phases):
                p = next(phases)
                return surface(bent(markers, 0.4 * p, 0.5 * p), budget=budget)

            frame(None)
            once = timed(lambda: frame(0.0))
            whole = timed(lambda: frame(None))
            off = rms(surface(bent(markers, 0.3, 0.4)), bent(vertices, 0.3, 0.4))
            print(f"| {len(vertices):,} | {mode} | {once[0]:.2f} ({once[1]:.2f}) | {whole[0]:.2f}"
                  f" ({whole[1]:.2f}) | {off:.3f} | {setup:.1f} | {surface.description} |",
                  flush=True)  # fmt: skip


def main() -> None:
    parts = {"arap": arap, "motion": motion, "frames": frames}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", help=f"any of {', '.join(parts)}; default: all")
    for name in parser.parse_args().parts or parts:
        parts[name]()
        print()


if __name__ == "__main__":
    main()
