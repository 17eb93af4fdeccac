"""Measure how fast layouts are found and how good they are, against peers and baselines.

    python -m benchmarks.layouts                       # all parts, about 10 minutes on 2 cores
    python -m benchmarks.layouts objective growth

The device is the bar of `fixtures/devices/bar` with its finite-element fields, three cords, 13
states, and about 120 samples per cord. Times are medians after a warm-up. JAX is optional
(`pip install jax`).
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from benchmarks import joint
from defsense_fab.core.curve import Hermite, Plane, catmull_rom, sample_path
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.device.device_file import load_device
from defsense_fab.decoding.ridge import fit_ridge
from defsense_fab.optimization.limits.constraints import Constraints
from defsense_fab.optimization.limits.thin_parts import ThinParts
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.prediction.design_task import DesignTask, load_task
from defsense_fab.optimization.prediction.predict import predict
from defsense_fab.optimization.problem.cord_kinematics import place_cord
from defsense_fab.optimization.problem.cord_parameters import CordParameters
from defsense_fab.optimization.problem.cord_signals import SignalModel
from defsense_fab.optimization.problem.objective import Objective
from defsense_fab.optimization.problem.problem import Problem
from defsense_fab.optimization.refinement.descent import descend
from defsense_fab.optimization.refinement.refine import layout_error, optimize_layout
from defsense_fab.optimization.search import baselines
from defsense_fab.optimization.search.candidate_families import waves_through_body
from defsense_fab.optimization.search.candidates import build_pool
from defsense_fab.optimization.search.starting_layouts import (
    LayoutSearch,
    candidate_choices,
    select_starts,
)
from defsense_fab.sensing.built_cord import BuiltCord
from defsense_fab.workflow.build.build import build

BAR = Path("fixtures/devices/bar")


def quiet(*_: object) -> None:
    pass


def bar() -> DesignTask:
    """Return the design problem of the bar; cords sense on their whole length, as in the peers."""
    device = load_device(BAR)
    task = load_task(device, build(device, "simulate").results)
    plain = SignalModel(task.reading.response)
    return replace(
        task,
        everything=replace(task.everything, sense=plain),
        design=replace(task.design, sense=plain),
    )


def median(work: Callable[[], object], repeat: int = 200) -> float:
    """Return the median time, s."""
    work()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def three(problem: Problem) -> list[CordParameters]:
    return [CordParameters(s) for s in baselines.manual_layout(problem, 3)]


def objective(problem: Problem) -> None:
    """Compare value and gradient with finite differences and JAX."""
    print("objective and gradient, 3 cords, 13 states")
    cords = three(problem)
    ours = Objective(problem, cords)
    x = np.random.default_rng(0).normal(0, 0.5, sum(c.size for c in cords))
    value, gradient = ours(x)
    fast = median(lambda: ours(x))
    print(f"  ours                {1e3 * fast:7.3f} ms")
    limits = Constraints(problem.surface, problem.depth, problem.limits, cords)
    model, bounds = median(lambda: ours.model(x)), median(lambda: limits(x))
    print(f"  (a descent's step: model {1e3 * model:.2f} ms, limits {1e3 * bounds:.2f} ms)")

    def differences() -> np.ndarray:
        eye = 1e-5 * np.eye(len(x))
        return np.array([(ours.value(x + e) - ours.value(x - e)) / 2e-5 for e in eye])

    slow = median(differences, 5)
    error = np.abs(differences() - gradient).max() / np.abs(gradient).max()
    print(f"  finite differences  {1e3 * slow:7.3f} ms, {slow / fast:5.1f}x; apart {error:.1e}")
    try:
        import jax
    except ImportError:
        print("  JAX is not installed")
        return
    jax.config.update("jax_enable_x64", True)
    peer = jax.jit(jax.value_and_grad(_jax_objective(problem, cords, ours, x)))
    theirs = median(lambda: jax.block_until_ready(peer(x)))
    v, g = peer(x)
    apart = max(abs(v - value) / value, np.abs(g - gradient).max() / np.abs(gradient).max())
    print(
        f"  JAX {jax.__version__}, points located beforehand"
        f" {1e3 * theirs:7.3f} ms, {theirs / fast:5.1f}x; apart {apart:.1e}"
    )


def _jax_objective(problem, cords, ours, x):  # type: ignore[no-untyped-def]
    """Return the objective in JAX; the tetrahedra of the samples at x are looked up before."""
    import jax.numpy as jnp
    from jax.scipy.spatial.transform import Rotation

    mesh = problem.locator.mesh
    pieces = []
    for c, part in zip(cords, ours.split(x), strict=True):
        at = problem.locator.find(place_cord(c, part).points)
        corner = mesh.nodes[mesh.cells[at.cell, 0]]
        local = jnp.asarray(problem.fields[:, mesh.cells[at.cell]])  # (s, p, 10, 3)
        pieces.append((corner, mesh.bary_gradient[at.cell], local))
    edges = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
    O = jnp.asarray(problem.outputs)  # noqa: E741
    noise = problem.features(len(cords)).uncertainty(problem.noise)

    def run(x):  # type: ignore[no-untyped-def]
        columns = []
        first = 0
        for c, (corner, by_bary, local) in zip(cords, pieces, strict=True):
            part = x[first : first + c.size]
            first += c.size
            rows = 2 * len(c.rows)
            stack = jnp.asarray(c.stack).at[c.rows].add(part[:rows].reshape(-1, 2))
            axes = jnp.asarray(c.sensor.plane.axes)
            for k in range(3):
                turn = Rotation.from_rotvec(part[rows + 2 + k] / c.reach * jnp.eye(3)[k])
                axes = axes @ turn.as_matrix()
            pivot = c.pivot + part[rows : rows + 2] @ c.moves
            points = pivot + (c.basis @ stack - c.center) @ axes[:, :2].T
            bary = jnp.einsum("pbj,pj->pb", by_bary, points - corner)
            bary = bary.at[:, 0].add(1.0)
            shape = jnp.concatenate(
                [bary * (2 * bary - 1), 4 * bary[:, edges[:, 0]] * bary[:, edges[:, 1]]], axis=1
            )
            displaced = points + jnp.einsum("pn,spnj->spj", shape, local)
            length = jnp.linalg.norm(jnp.diff(displaced, axis=1), axis=2).sum(1)
            rest = jnp.linalg.norm(jnp.diff(points, axis=0), axis=1).sum()
            columns.append(problem.sense.response.linear_slope * (length / rest - 1))
        S = jnp.concatenate([jnp.zeros((1, len(cords))), jnp.stack(columns, axis=1)])
        S = S - S.mean(0)
        normal = S.T @ S + len(S) * noise**2 * jnp.eye(len(cords))
        right = S.T @ O
        return ((O**2).sum() - (right * jnp.linalg.solve(normal, right)).sum()) / len(S)

    return run


def refinement(problem: Problem) -> None:
    """Compare one descent with peers, and measure the whole search."""
    print("refinement of one selected layout, error and worst violation reached")
    slivers = ThinParts(problem)
    rng, search = np.random.default_rng(0), LayoutSearch(extra=3, starts=1, candidates=6000)
    cords = candidate_choices(problem, (), search, rng)
    (start,) = select_starts(problem, cords, search, slivers, rng, quiet)
    print(f"  start                         {layout_error(problem, start):.3f} mm")
    descend(problem, start, 2, 1e-3, slivers, quiet)

    def show(name: str, layout: tuple, seconds: float, ours: float) -> None:
        broken = len(verify(layout, problem.surface, problem.limits).violations)
        print(
            f"  {name:<29} {layout_error(problem, layout):.3f} mm, {broken} limits broken,"
            f" {seconds:7.2f} s, {seconds / ours:6.1f}x"
        )

    begin = time.perf_counter()
    best = descend(problem, start, 40, 2e-4, slivers, quiet)
    ours = time.perf_counter() - begin
    show("ours, 40 iterations", best, ours, ours)
    begin = time.perf_counter()
    layout = joint.refine(problem, start, 100)
    show("joint Gauss-Newton, 100 steps", layout, time.perf_counter() - begin, ours)
    free = [CordParameters(s) for s in start]
    objective = Objective(problem, free)
    limits = Constraints(problem.surface, problem.depth, problem.limits, free)
    zero = np.zeros(sum(c.size for c in free))
    for method, options in (("COBYLA", {"maxiter": 3000, "rhobeg": 1.0}),):
        begin = time.perf_counter()
        result = minimize(
            lambda x: np.log(objective.value(x)),
            zero,
            method=method,
            constraints={"type": "ineq", "fun": lambda x: limits(x)[0]},
            options=options,
        )
        layout = tuple(
            place_cord(c, x).sensor() for c, x in zip(free, objective.split(result.x), strict=True)
        )
        show(f"scipy {method}, {result.nfev} values", layout, time.perf_counter() - begin, ours)
    print("the whole search: proposal, selection, refinement; 8 seeds")
    times, errors = [], []
    for seed in range(8):
        fresh_problem = replace(problem)
        begin = time.perf_counter()
        result = optimize_layout(
            fresh_problem, (), np.random.default_rng(seed), quiet, LayoutSearch(extra=3)
        )
        times.append(time.perf_counter() - begin)
        errors.append(result.rmse)
    print(
        f"  {statistics.median(times):.2f} s (median), worst {max(times):.2f} s; error"
        f" {min(errors):.3f} to {max(errors):.3f} mm"
    )


def candidates(problem: Problem) -> None:
    """Compare the signals of thousands of candidates in one batch with a loop over them."""
    rng = np.random.default_rng(0)
    pool = build_pool(
        problem, [lambda r=r: waves_through_body(problem, 5000, r) for r in rng.spawn(4)]
    )
    paths = pool.paths[:5000]
    fast = median(lambda: problem.signals(paths), 5)
    some = paths[:100]

    def loop() -> None:
        for path in some:
            displaced = path + problem.locator.displacement(
                problem.locator.find(path), problem.fields
            )
            step = np.linalg.norm(np.diff(displaced, axis=1), axis=2).sum(1)
            step / np.linalg.norm(np.diff(path, axis=0), axis=1).sum() - 1

    slow = median(loop, 3) * len(paths) / len(some)
    print(f"signals of {len(paths)} candidates in {len(problem.fields)} states")
    print(f"  one batch {fast:.3f} s; a loop {slow:.3f} s, {slow / fast:.1f}x")


def table(task: DesignTask) -> None:
    """Compare manual, visual and full layouts, with and without noise in the prediction."""
    print("predicted RMSE, mm (held out), bar, three cords")
    for noise in (0.0, 0.002):
        problem = replace(task.design, noise=noise)
        scored = replace(task, reading=replace(task.reading, relative=noise, contact=0.0))
        rows = {"manual": [baselines.manual_layout(problem, 3)]}
        rngs = [np.random.default_rng(s) for s in range(5)]
        rows["visual"] = [
            baselines.visual_layout(problem, 3, np.random.default_rng(s)) for s in range(21)
        ]
        rows["full"] = [
            optimize_layout(problem, (), r, quiet, LayoutSearch(extra=3)).sensors for r in rngs
        ]
        best = 0.0
        for name in ("full", "visual", "manual"):
            result = [
                predict(scored, [BuiltCord(sample_path(s), 0.0, None) for s in x]).prediction
                for x in rows[name]
            ]
            rmse = statistics.median(f.rmse for f in result)
            held = statistics.median(
                float(np.sqrt(np.mean(np.square(list(f.held_out.values()))))) for f in result
            )
            best = best or rmse
            print(
                f"  noise {noise:.1%} {name:<7} {rmse:7.3f} ({held:.2f})  {rmse / best:5.1f}x,"
                f" median of {len(result)}"
            )


def noise(task: DesignTask) -> None:
    """Find the best decoder at each noise, on analytic mixtures, by errors on unseen mixtures."""
    from tests.conftest import structured_bar
    from tests.optimization import exact

    print("analytic bar, three cords designed on mixtures for each decoder and noise;")
    print("RMSE (mm) on unseen mixtures, noise included")
    surface = task.design.surface
    mesh = structured_bar([0, -15, -15], [150, 15, 15], [30, 6, 6])
    for sigma in (0.0, 1e-4, 3e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 4e-2):
        errors = {}
        for decoder in ("affine", "quadratic"):
            design, unseen = (
                exact.problem(surface, mesh, states, decoder=decoder, noise=sigma)
                for states in (exact.MIXTURES, exact.UNSEEN)
            )
            layout = optimize_layout(
                design, (), np.random.default_rng(0), quiet, LayoutSearch(extra=3)
            ).sensors
            S, T = (
                np.stack([p.signals(sample_path(s)) for s in layout], axis=1)
                for p in (design, unseen)
            )
            text, truth = (p.markers.reshape(len(p.markers), -1) for p in (design, unseen))
            result = fit_ridge(design.features(3), S, text, sigma)
            square = ((result(T) - truth) ** 2 + result.noise_variance(T, sigma))[1:].sum(1)
            errors[decoder] = float(np.sqrt(square.mean() / len(exact.MARKERS)))
        wins = min(errors, key=lambda k: errors[k])
        print(
            f"  noise {sigma:7.4f}  " + "  ".join(f"{k} {v:.3f}" for k, v in errors.items()), wins
        )


def growth(problem: Problem) -> None:
    """Measure the time of value and gradient, and of the whole search, for growing problems."""
    print("value and gradient (ms) and the whole search (s) by number of cords")
    for count in (1, 2, 3, 4, 6, 8):
        cords = [CordParameters(s) for s in baselines.manual_layout(problem, min(count, 3))]
        cords = [cords[i % len(cords)] for i in range(count)]
        f = Objective(problem, cords)
        x = np.random.default_rng(0).normal(0, 0.5, sum(c.size for c in cords))
        begin = time.perf_counter()
        optimize_layout(
            problem, (), np.random.default_rng(0), quiet, LayoutSearch(extra=count, starts=4)
        )
        whole = time.perf_counter() - begin
        print(f"  {count} cords: {1e3 * median(lambda f=f, x=x: f(x), 50):7.3f} ms, {whole:6.2f} s")
    print("value and gradient (ms) by number of states")
    for times in (1, 2, 4, 8):
        many = np.concatenate([problem.fields * s for s in np.linspace(1, 0.6, times)])
        marks = np.concatenate(
            [problem.markers[:1], *(problem.markers[1:] * s for s in np.linspace(1, 0.6, times))]
        )
        p = replace(problem, fields=many, markers=marks)
        f = Objective(p, three(p))
        x = np.zeros(sum(c.size for c in f.cords))
        print(f"  {len(many) + 1:3d} states: {1e3 * median(lambda f=f, x=x: f(x), 50):7.3f} ms")
    print("value and gradient (ms) by tets")
    from tests.conftest import structured_bar
    from tests.optimization import exact

    for k in (1, 2, 3):
        mesh = structured_bar([0, -15, -15], [150, 15, 15], [15 * k, 3 * k, 3 * k])
        p = exact.problem(problem.surface, mesh, exact.RAMPS)
        f = Objective(p, three(p))
        x = np.zeros(sum(c.size for c in f.cords))
        print(f"  {len(mesh.tets):6d} tets: {1e3 * median(lambda f=f, x=x: f(x), 50):7.3f} ms")


def large_layouts() -> None:
    """Print the cost of layouts of up to 40 cords and 60 states, in a body 300 mm wide."""
    from tests.conftest import box_surface, structured_bar
    from tests.optimization import exact

    low, high = [0, -150, -15], [150, 150, 15]
    mesh, surface = structured_bar(low, high, (15, 30, 3)), box_surface(low, high)
    print(f"value and gradient, and a descent of 10 iterations, {len(mesh.tets)} tets")
    times: dict[str, list[tuple[int, float, float]]] = {"cords": [], "states": []}
    for cords, states in ((5, 60), (10, 60), (20, 60), (40, 15), (40, 30), (40, 60)):
        loads = [
            (bend, twist) for bend in np.linspace(-1, 1, states // 3) for twist in (0.2, 0.6, 1.0)
        ]
        problem = exact.problem(surface, mesh, loads, noise=0.002)
        layout = _straight_cords(cords)
        f = Objective(problem, [CordParameters(s) for s in layout])
        x = np.zeros(sum(c.size for c in f.cords))
        value = median(lambda f=f, x=x: f(x), 10)
        started = time.process_time()
        descend(problem, layout, 10, 1e-6, ThinParts(problem), quiet)
        used = time.process_time() - started
        print(
            f"  {cords} cords, {states} states: {1e3 * value:.1f} ms, {used:.1f} CPU s", flush=True
        )
        if states == 60:
            times["cords"].append((cords, value, used))
        if cords == 40:
            times["states"].append((states, value, used))
    for name, rows in times.items():
        count, *costs = np.log(np.array(rows)).T
        orders = [np.polyfit(count, cost, 1)[0] for cost in costs]
        print(f"  orders in the number of {name}: value {orders[0]:.2f}, descent {orders[1]:.2f}")


def _straight_cords(count: int) -> tuple[Sensor, ...]:
    """Return cords along a body 300 mm wide, at three heights in turn."""
    points = np.array([[x, 0.0] for x in (2, 10, 36, 62, 88, 114, 140, 148)])
    curve, free = Hermite(points, catmull_rom(points)), frozenset({"path", "plane"})
    up, along = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    return tuple(
        Sensor(
            f"cord {i}",
            Plane.from_normal(np.array([0, y, 4.0 * (i % 3 - 1)]), up, along),
            curve,
            free,
        )
        for i, y in enumerate(np.linspace(-140, 140, count))
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = ("objective", "refinement", "candidates", "table", "noise", "growth")
    parser.add_argument("part", nargs="*", help=f"of {', '.join(parts)}; all if none is named")
    options = parser.parse_args()
    task = bar()
    for name in options.part or parts:
        if name not in parts:
            parser.error(f"no part {name!r}; there are {', '.join(parts)}")
        globals()[name](task if name in ("table", "noise") else task.design)


if __name__ == "__main__":
    main()
