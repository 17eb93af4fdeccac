"""Stage 4: the cords' paths, and what they are predicted to sense."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import igl
import numpy as np

from ...core.arrays import Bool, Float
from ...core.device import DECODERS, Device, Sensor
from ...core.errors import DeviceError, LayoutError
from ...core.files import write_json
from ...core.mesh import Surface
from ...core.prediction import Prediction
from ...decoding.decoders import fit_decoder
from ...decoding.features import KINDS
from ...decoding.folds import cross_validated
from ...decoding.ridge import measure
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...optimize.limits.verification import LayoutCheck, verify
from ...optimize.problem.cord_parameters import sample_path
from ...optimize.problem.problem import Limits, Problem
from ...optimize.refinement.refine import Optimised, optimise, part
from ...optimize.studies.risks import risks
from ...optimize.studies.tolerance_monte_carlo import Tolerances, tolerance_band
from ...sensing.response import response_of
from ...sensing.signal import strain_range
from ..artifacts.layout import read_sensor, write_sensor
from .stage_body import load_surface
from .stage_mesh import load_mesh
from .stage_simulate import load_fields
from .stages import Report, read_json

SEED = 1
#: Markers may lie this far outside, mm: tags have a thickness, meshes a deviation.
_OFF_BODY = 1.0


def limits(device: Device) -> Limits:
    channel, wall = device.channel_diameter, device.fabrication.wall
    shortest, longest = (n - 2 * device.fabrication.lead for n in device.cord.lengths)
    return Limits(
        wall,
        device.cord.min_bend_radius,
        channel + wall,
        channel,
        shortest=max(shortest, 0.0),
        longest=longest,
    )


def markers(device: Device, surface: Surface, locator: PointLocator) -> tuple[Float, Float]:
    """Marker positions (k, 3) mm in the rest frame and weights (k,) that sum to one."""
    spec = device.outputs.markers
    if isinstance(spec, np.ndarray):
        square = igl.point_mesh_squared_distance(spec, surface.vertices, surface.faces)[0]
        outside = np.where(locator.find(spec).depth < 0, np.sqrt(np.asarray(square)), 0.0)
        if outside.max() > _OFF_BODY:
            k = int(outside.argmax())
            raise DeviceError(
                f"device.toml: outputs.markers: point {k + 1} at {spec[k].tolist()} lies"
                f" {outside[k]:.2g} mm off the body; move it onto the surface"
            )
        return spec, np.full(len(spec), 1 / len(spec))
    dense = 4000 if spec == "surface" else max(4000, 4 * spec)
    points = surface.scatter(dense, np.random.default_rng(SEED))
    if spec == "surface":
        return points, np.full(dense, 1 / dense)
    return _spread(points, spec), np.full(spec, 1 / spec)


def _spread(points: Float, count: int) -> Float:
    """Farthest-point sampling: `count` of the points, evenly spread."""
    chosen = [int(np.linalg.norm(points - points.mean(0), axis=1).argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return points[chosen]


@dataclass(frozen=True)
class Task:
    """Every state of the device, `names` (n,) with rest first, and which are `held` out (n,): the
    layout is to be designed on the others. Marker positions `points` (k, 3) mm."""

    everything: Problem
    design: Problem
    names: list[str]
    held: Bool
    points: Float

    def decoded_by(self, kind: str) -> Task:
        """The same for another decoder."""
        both = self.everything.decoded_by(kind), self.design.decoded_by(kind)
        return replace(self, everything=both[0], design=both[1])


def load_task(device: Device, folder: Path) -> Task:
    """What there is to optimise, from the files of the earlier stages."""
    surface = load_surface(folder)
    locator = PointLocator(QuadraticMesh.from_linear(load_mesh(folder)))
    names, held, fields = load_fields(folder)
    points, weights = markers(device, surface, locator)
    moved = locator.displacement(locator.find(points), fields)
    everything = Problem(
        surface,
        locator,
        fields,
        np.concatenate([np.zeros((1, *points.shape)), moved]),
        weights,
        response_of(device.cord.response),
        device.cord.noise,
        limits(device),
        DECODERS[0] if device.decoder == "auto" else device.decoder,
    )
    seen = np.flatnonzero(~np.array(held, bool))
    design = replace(
        everything, fields=fields[seen], markers=everything.markers[np.append(0, seen + 1)]
    )
    return Task(everything, design, ["rest", *names], np.array([False, *held]), points)


def run(device: Device, folder: Path, report: Report) -> None:
    task = load_task(device, folder)
    surface = task.everything.surface
    rng = np.random.default_rng(SEED)
    kinds = DECODERS if device.decoder == "auto" else (device.decoder,)
    tried: dict[str, tuple[float, Optimised]] = {}
    for n, kind in enumerate(kinds):
        task = task.decoded_by(kind)
        like = next((k for k in tried if KINDS[k] is KINDS[kind]), None)  # designed alike
        show = partial(part, report, n / len(kinds), (n + 1) / len(kinds))
        found = (
            tried[like][1]
            if like
            else optimise(
                task.design, device.sensors, rng, show, extra=device.propose, planes=device.planes
            )
        )
        tried[kind] = (unseen_error(task.design, found.sensors), found)
    chosen = min(tried, key=lambda k: tried[k][0])
    task, found = task.decoded_by(chosen), tried[chosen][1]
    problem = task.design
    initial, _ = predict(task.everything, _paths(found.initial), task.names, task.held)
    final, extra = predict(task.everything, _paths(found.sensors), task.names, task.held)
    check = verify(found.sensors, surface, problem.limits)
    if check.problems:
        raise LayoutError(f"the optimised layout fails its check: {check.problems[0]}")
    sensors = _sensors(device, found.sensors, check, task.everything)
    write_json(
        folder / "layout.json",
        {
            "schema": 1,
            "device": device.name,
            "mesh": read_json(folder / "mesh.json")["hash"],
            "limits": {
                "wall": problem.limits.wall,
                "min_radius": problem.limits.min_radius,
                "clearance": problem.limits.clearance,
            },
            "sensors": sensors,
            "min_clearance": check.min_clearance,
            "warnings": [*risks(problem, found.sensors), *_uncalibrated(device, sensors)],
            "prediction": final.to_json(),
            "cross_validated": {kind: error for kind, (error, _) in tried.items()},
            "band": {**asdict(tolerance_band(problem, found.sensors, rng)), **asdict(Tolerances())},
            "initial": initial.to_json(),
            "drawn": [sample_path(s).tolist() for s in found.initial],
            "proposed": device.propose > 0,
            "starts": list(found.starts),
            "seed": SEED,
        },
    )
    write_json(folder / "prediction.json", {"markers": task.points.tolist(), **extra})


def _paths(sensors: Sequence[Sensor]) -> list[Float]:
    return [sample_path(s) for s in sensors]


def unseen_error(problem: Problem, sensors: Sequence[Sensor]) -> float:
    """Expected RMSE (mm) of decoders on runs of states that they were not trained on."""
    signals = np.stack([problem.signals(path) for path in _paths(sensors)], axis=1)
    return cross_validated(
        lambda seen, told: fit_decoder(problem.decoder, seen, told, problem.noise),
        signals,
        problem.outputs,
        problem.noise,
    )


def predict(
    problem: Problem, paths: Sequence[Float], names: Sequence[str], held: Bool
) -> tuple[Prediction, dict[str, Any]]:
    """Fit on the states not held out and score all, for cords along `paths`, each (p, 3) mm; also
    the decoder and marker errors."""
    signals = np.stack([problem.signals(path) for path in paths], axis=1)
    n, k = problem.markers.shape[:2]
    flat = problem.markers.reshape(n, -1)
    seen_by = ~held
    decoder = fit_decoder(problem.decoder, signals[seen_by], flat[seen_by], problem.noise)
    guess = decoder(signals).reshape(n, k, 3)
    noisy = decoder.noise_variance(signals, problem.noise).reshape(n, k, 3).sum(2)
    variance = noisy @ problem.marker_weights
    seen = measure(guess[seen_by], problem.markers[seen_by], problem.marker_weights)
    every = measure(guess, problem.markers, problem.marker_weights)
    expected = np.sqrt(every.per_state**2 + variance)
    rmse = dict(zip(names, expected.tolist(), strict=True))
    only = replace(problem, markers=problem.markers[seen_by])
    prediction = Prediction(
        decoder=problem.decoder,
        noise=problem.noise,
        rmse=float(np.sqrt((expected[seen_by] ** 2).mean())),
        rmse_noise_free=seen.rmse,
        peak=seen.peak,
        average_peak=seen.average_peak,
        floor=only.floor(len(paths)),
        per_state={m: rmse[m] for m, h in zip(names, held, strict=True) if not h},
        held_out={m: rmse[m] for m, h in zip(names, held, strict=True) if h},
    )
    extra = {
        **decoder.to_json(),
        "states": list(names),
        "signals": signals.tolist(),
        "errors": np.linalg.norm(guess - problem.markers, axis=2).tolist(),
    }
    return prediction, extra


def _sensors(
    device: Device, sensors: Sequence[Sensor], check: LayoutCheck, problem: Problem
) -> list[dict[str, Any]]:
    out = []
    for channel, (s, c) in enumerate(zip(sensors, check.cords, strict=True)):
        path = sample_path(s)
        least, most = strain_range(path, problem.deform(path))
        out.append(
            {
                **write_sensor(s),
                "channel": channel,
                "points": path.tolist(),
                "length": c.length,
                "min_radius": min(c.min_radius, 1e6),
                "min_wall": c.min_wall,
                "inlets": list(c.inlets),
                "cord_diameter": device.cord.diameter,
                "peak_strain": most,
                "least_strain": least,
            }
        )
    return out


def _uncalibrated(device: Device, sensors: Sequence[Mapping[str, Any]]) -> list[str]:
    """Warnings: cords that leave the strains in which their response was measured."""
    low, high = device.cord.response.strain_range
    out = []
    for s in sensors:
        least, most = s["least_strain"], s["peak_strain"]
        if least < low or most > high:
            out.append(
                f"cord {s['name']!r}: strains of {least:.1%} to {most:.1%} leave the calibrated"
                f" range of {low:.1%} to {high:.1%}; beyond it the response is continued along its"
                " tangent: measure on tighter jigs, or trust the prediction less"
            )
    return out


def load_sensors(folder: Path) -> list[Sensor]:
    """The optimised cords of `layout.json`."""
    return [read_sensor(s) for s in read_json(folder / "layout.json")["sensors"]]
