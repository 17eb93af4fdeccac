"""Pictures of an experiment: the routing of each layout, and in each pose the true surface beside
the one that is read, coloured by its error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.device.build_folder import build_folder
from ....core.device.device import Device
from ....core.mesh import Surface
from ....core.progress import Progress
from ....core.storage.files import digest
from ....geometry.bodies.orientation import viewing_axes
from ....runtime.controls.pose_amplitudes import RADIUS_90
from ....runtime.live.live_device import LiveDevice, live_device
from ....runtime.surface.live_surface import LiveSurface, make_surface
from ....runtime.surface.surface_mesh import SurfaceBasis
from ....store.body import load_surface
from ....store.layout import LAYOUT, load_layout
from ....twin.devices.device_fields import MechanicsTraits, solve_fields
from ..experiments.experiment import Experiment
from ..results.result_files import compute_once
from ..results.result_files import combine_pictures, write_pictures
from .movement import recording_of, true_weights
from .sessions import twin_traits, unit_model, unit_session

# Moments of a test in which the surface is shown: as it truly was, and as it is read.

_UNKNOWN = 1.0  # mm, standard deviation of a marker of which no interval is known


@dataclass(frozen=True)
class ShownFrame:
    """A moment in a `pose`, its `weight` (1: its full amplitude): the skin's vertices as they
    `truly` were and as they are `read` (v, 3) mm, and by how much the latter miss, `error` (v,)
    mm."""

    pose: str
    weight: float
    truly: Float
    read: Float
    error: Float


def shown_frames(
    device: Device, unit: int, mechanics: MechanicsTraits, share: float
) -> tuple[Float, Int, list[ShownFrame]]:
    """Vertices at rest (v, 3) mm and triangles (f, 3) of the device's skin, and for each pose the
    moment in the last `share` of a unit's session in which it was furthest, and others least."""
    session, live = unit_session(device, unit), live_device(unit_model(device, unit), device.source)
    assert live.rest is not None
    fields = solve_fields(device, mechanics)
    r = recording_of(device, session)
    tested = r.time[round((1 - share) * len(r.time)) :]
    decoded = live.model.decode(r.sample_time, r.signals, tested)
    weights = true_weights(session, tested)
    skin, reader = fields.displacements(live.rest.vertices), _reader(live)
    known = np.isfinite(decoded.points).all(axis=(1, 2))
    out = []
    for k, name in enumerate(fields.poses):
        clear = np.abs(weights[:, k]) - np.abs(np.delete(weights, k, 1)).sum(1)
        at = int(np.where(known, clear, -np.inf).argmax())
        moved = np.tensordot(fields.space(weights[at : at + 1])[0], skin, axes=1)
        truly = live.rest.vertices + moved
        reader.reset()
        deviation = np.nan_to_num(decoded.radius[at], nan=_UNKNOWN * RADIUS_90) / RADIUS_90
        read = reader(decoded.points[at], deviation)
        error = np.linalg.norm(read - truly, axis=1)
        out.append(ShownFrame(name, float(weights[at, k]), truly, read, error))
    return live.rest.vertices, np.asarray(live.rest.faces, np.int64), out


def _reader(live: LiveDevice) -> LiveSurface:
    """From markers to the surface, as `defsense run` shows it."""
    assert live.rest is not None
    assert live.states is not None
    fixed = np.abs(live.states).max(axis=(0, 2)) < 1e-9
    basis = SurfaceBasis(
        live.rest.vertices, np.asarray(live.rest.faces, np.int64), live.states, fixed
    )
    sd = np.full(len(live.model.ids), _UNKNOWN)
    return make_surface(basis, live.model.rest_points, sd, frame=np.inf)


FOLDER = "pictures"
_WIDTH, _HEIGHT = 560.0, 420.0
_TOP = 99.5  # percentile of the errors at which their scale ends
_TRUE = "#7d8b95"


def draw_device_pictures(
    experiment: Experiment, devices: Mapping[str, Device], out: Path, progress: Progress
) -> dict[str, Any]:
    """PNGs as data URIs, also written to `out/pictures`: `routing` by layout; `poses`, each with
    its name, and by layout how far it was taken, the RMS error (mm) of the surface and a picture;
    the `scale` of their colours. They are kept until layouts or units change."""
    first = [unit_session(d, 1).with_suffix(".test.json") for d in devices.values()]
    key = digest(*(build_folder(d) / LAYOUT for d in devices.values()), *first)

    def make() -> dict[str, Any]:
        found = _made(experiment, devices, progress)
        write_pictures(out / FOLDER, _files(found))
        return found

    found: dict[str, Any] = compute_once(out / "pictures.json", key, make)
    return found


def _made(
    experiment: Experiment, devices: Mapping[str, Device], progress: Progress
) -> dict[str, Any]:
    from ....report.pictures.poses import color_bar
    from ....report.pictures.sheet import Sheet

    plan, routing, frames = experiment.session, {}, {}
    for k, (name, device) in enumerate(devices.items()):
        progress("pictures", k / (2 * len(devices)), name)
        routing[name] = _routing(device)
        mechanics = twin_traits(experiment, device).mechanics
        frames[name] = shown_frames(device, 1, mechanics, plan.share)
    errors = np.concatenate([f.error for _, _, shown in frames.values() for f in shown])
    largest = float(np.percentile(errors, _TOP))
    scale = color_bar.scale(
        color_bar.ERROR, "error of the surface, mm", largest, beyond=errors.max() > largest
    )
    poses: list[dict[str, Any]] = []
    for k, pose in enumerate(p.name for p in next(iter(devices.values())).poses):
        progress("pictures", 0.5 + k / (2 * len(errors)), pose)
        by = {}
        for name, (rest, faces, shown) in frames.items():
            frame = next(f for f in shown if f.pose == pose)
            by[name] = {
                "weight": frame.weight,
                "rms": float(np.sqrt((frame.error**2).mean())),
                "largest": float(frame.error.max()),
                "moved": float(np.linalg.norm(frame.truly - rest, axis=1).max()),
                "picture": _surface(frame, rest, faces, scale),
            }
        poses.append({"name": pose, "layouts": by})
    sheet = Sheet(_WIDTH, color_bar.HEIGHT)
    color_bar.draw(sheet, scale, 30, 0, _WIDTH - 60)
    return {"routing": routing, "poses": poses, "scale": sheet.uri()}


def _routing(device: Device) -> str:
    """The body with its cords."""
    from ....report.pictures import body_views, routing, views

    folder = build_folder(device)
    surface, layout = load_surface(folder), load_layout(folder)
    cords = [c.points for c in layout.by_channel()]
    frame = viewing_axes(surface)
    with routing.scene(surface, cords, [], device.cord.diameter / 2) as scene:
        seen = [body_views.Seen(scene, v) for v in (views.three_quarter(frame), views.front(frame))]
        return body_views.picture(seen, width=_WIDTH, height=_HEIGHT, least=1.0)


def _surface(frame: ShownFrame, rest: Float, faces: Any, scale: Any) -> str:
    """The surface that is read, in the colours of its error, within the true one."""
    from ....report.pictures import body_views, views
    from ....report.pictures.scene import Scene, poly

    mesh = poly(Surface(frame.read, faces))
    mesh.point_data["error"] = frame.error
    with Scene() as scene:
        scene.outline(Surface(frame.truly, faces), _TRUE, 0.35)
        scene.colored(mesh, "error", scale.colors, scale.top)
        view = views.three_quarter(viewing_axes(Surface(rest, faces)))
        return body_views.picture(
            [body_views.Seen(scene, view)], width=_WIDTH, height=_HEIGHT, least=1.0
        )


def _files(found: Mapping[str, Any]) -> dict[str, str]:
    """The same by names of files; `all`: a column a layout, a row for the routing and each pose."""
    names = list(found["routing"])
    rows = [("", list(found["routing"].values()))]
    files = {f"routing-{n}": uri for n, uri in found["routing"].items()}
    for pose in found["poses"]:
        told = pose["layouts"]
        rows.append((pose["name"], [told[n]["picture"] for n in names]))
        files |= {f"{pose['name']}-{n}": told[n]["picture"] for n in names}
    return {"all": combine_pictures(rows, names, _WIDTH), **files}
