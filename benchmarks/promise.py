"""Check predicted errors of built devices on random states, solved with another mesh and material.

    python -m benchmarks.promise fixtures/devices/bar fixtures/devices/blob
    python -m benchmarks.promise my-device --states 50 --devices 30 --seed 0 --edge 0.75
    python -m benchmarks.promise my-device --edge 1 --law device

Each device is built up to its layout. Then its training states and random states are solved with
edges of `--edge` times the length, and with a Mooney-Rivlin material of the same small-strain
moduli (a third of mu / 2 in c01). A random state has one to three compatible poses, each at 0.2 to
1.2 of its amplitude.

Built devices differ from the design: cords are shifted by up to 0.3 mm, gauge factors are 5 % off,
and signals have noise. Held cords are 0.7 mm too long or too short (standard deviation); of bonded
cords up to half of the slope below zero strain is missing. Each device is trained on its own
readings of its training states. Its RMSE on random and on held-out states is compared with the
predicted band, on at least as many frames as the band is based on.

`inside` are random states within the designed amplitudes, `beyond` the others. `in band` are the
shares of devices whose error is within the band: on held-out states, and on random states inside.
With `--edge 1 --law device` everything is solved as in the design: remaining differences are due to
how devices are built, and the others to mesh and material.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Float
from defsense_fab.core.device.device import Device
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.states import are_opposite, can_mix
from defsense_fab.decoding.decoders import fit_decoder
from defsense_fab.geometry.bodies.meshing.region_conforming import conform_to_regions
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.mechanics.elements.material import Material, split
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.solver.batch import solve_all
from defsense_fab.sensing.built_cord import CordReading
from defsense_fab.store.body import load_surface
from defsense_fab.store.layout import LayoutRecord, load_layout, load_prediction
from defsense_fab.store.mesh import load_mesh_record
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.load_cases import Loading, list_loadings, prepare_jobs

_READINGS = 40  # of each state by each device, at least


def law(device: Device) -> Material:
    """Return a Mooney-Rivlin material with the small-strain moduli of the device."""
    e, nu = device.material.young_modulus, device.material.poisson_ratio
    mu, kappa = e / (2 * (1 + nu)), e / (3 * (1 - 2 * nu))
    return split(kappa, mu / 3, c01=mu / 6, model="mooney-rivlin")


def random_states(device: Device, count: int, rng: np.random.Generator) -> list[Loading]:
    """Return mixtures of one to three compatible poses, each at 0.2 to 1.2."""
    out: list[Loading] = []
    while len(out) < count:
        chosen: list[int] = []
        for k in rng.permutation(len(device.poses))[: rng.integers(1, 4)]:
            pose = device.poses[k]
            others = [device.poses[i] for i in chosen]
            if all(can_mix(pose, o) and not are_opposite(pose, o) for o in others):
                chosen.append(int(k))
        weights = {device.poses[k].name: float(rng.uniform(0.2, 1.2)) for k in chosen}
        out.append(Loading(weights, (1.0,), True, optional=True))
    return out


def measured(
    device: Device, layout: LayoutRecord, folder: Path, options: argparse.Namespace
) -> tuple[Float, list[Loading | None]]:
    """Return the RMSE (mm) of built devices (d, states) on solved states, and the states.

    The states are random loadings; a state that the device holds out is None.
    """
    rng = np.random.default_rng(options.seed)
    surface = load_surface(folder)
    edge = load_mesh_record(folder).edge_length
    assert edge is not None
    mesh = tetrahedralize(surface, options.edge * edge).mesh
    fine = QuadraticMesh.from_linear(conform_to_regions(mesh, list(device.regions.values())))
    drawn = random_states(device, options.states, rng)
    plan, todo, _ = prepare_jobs(device, fine, [*list_loadings(device), *drawn])
    fields, test = [np.zeros_like(fine.nodes)], [False]
    states_held_out: list[Loading | None] = []
    is_device_law = options.law == "device"
    material = Material.from_spec(device.material) if is_device_law else law(device)
    for loading, results in zip(plan, solve_all(fine, material, todo), strict=True):
        for result in results:
            if result.u is not None and result.problem is None:
                fields.append(result.u)
                test.append(loading.held_out)
                if loading.held_out:
                    states_held_out.append(loading if any(loading is x for x in drawn) else None)
    u, tested = np.stack(fields), np.array(test)
    locator = PointLocator(fine)
    points = load_prediction(folder).markers
    markers = locator.displacement(locator.find(points), u)
    flat = markers.reshape(len(u), -1)
    reading, normal = CordReading.from_device(device), rng.normal
    # No shorter a test than that which the band is of: noise would widen what it finds.
    readings = max(
        _READINGS, int(np.ceil(layout.band.frames / max(states_held_out.count(None), 1)))
    )
    errors = []
    for _ in range(options.devices):
        columns, sigma = [], []
        for record in layout.by_channel():
            cord = replace(record.built, path=record.stretch + rng.uniform(-0.3, 0.3, 3))
            if cord.prestretch is not None:
                loose = cord.length / (1 + cord.prestretch) + normal(0, 0.7)
                cord = replace(cord, prestretch=max(cord.length / loose - 1, 0.0))
            moved = cord.path + locator.displacement(locator.find(cord.path), u[1:])
            below = 1.0 if cord.prestretch is not None else 1 - rng.triangular(0.0, 0.25, 0.5)
            read_as = reading.scale_gauge_factor(1 + normal(0, 0.05), below)
            columns.append(np.append(0.0, read_as.signals(cord, moved)))
            sigma.append(read_as.noise(cord))
        S, noise = np.stack(columns, axis=1), np.array(sigma)
        decoder = fit_decoder(layout.prediction.decoder, S[~tested], flat[~tested], noise)
        square = np.zeros(int(tested.sum()))
        for _ in range(readings):
            read = S[tested] + noise * normal(0, 1, S[tested].shape)
            difference = (decoder(read) - flat[tested]).reshape(len(read), -1, 3)
            square += (difference**2).sum(2).mean(1) / readings
        errors.append(np.sqrt(square))
    return np.array(errors), states_held_out


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="+", type=Path)
    parser.add_argument("--states", type=int, default=50)
    parser.add_argument("--devices", type=int, default=30)
    parser.add_argument("--edge", type=float, default=0.75)
    parser.add_argument("--law", choices=("mooney-rivlin", "device"), default="mooney-rivlin")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(
        "device            decoder    promised (90 %)     held out  random  inside  beyond  singles"
        " mixtures    in band"
    )
    for path in options.folder:
        device = load_device(path)
        folder = build(device, "optimize").folder
        layout = load_layout(folder)
        errors, states = measured(device, layout, folder, options)
        is_device_law = np.array([s is None for s in states])
        inside = np.array([s is not None and max(s.weights.values()) <= 1 for s in states])
        single = np.array([s is not None and len(s.weights) == 1 for s in states])

        def rms(which: np.ndarray, errors: Float = errors) -> Float:
            """Return the RMSE of each device on some states."""
            return np.sqrt((errors[:, which] ** 2).mean(axis=1)) if which.any() else np.array([])

        band = layout.band
        beyond, mixed = ~is_device_law & ~inside, ~is_device_law & ~single
        found = [
            rms(which) for which in (is_device_law, ~is_device_law, inside, beyond, single, mixed)
        ]
        built = found[2]
        shares = [
            f"{((x >= band.low) & (x <= band.high)).mean():.0%}" if len(x) else "-"
            for x in found[:3:2]
        ]
        note = "   over" if len(built) and np.median(built) > band.high else ""
        prediction_text = f"{band.median:.2f} ({band.low:.2f}-{band.high:.2f})"
        print(f"{device.name:<17} {layout.prediction.decoder:<10} {prediction_text:<20}"
              + "".join(f"{np.median(x):8.2f}" if len(x) else f"{'-':>8}" for x in found)
              + f"{' / '.join(shares):>14}{note}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
