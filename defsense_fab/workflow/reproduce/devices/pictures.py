"""Pictures of an experiment: the routing of each layout, and in each pose the true surface beside
the one that is read, coloured by its error."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float
from ....core.device.build_folder import build_folder
from ....core.device.device import Device
from ....core.mesh import Surface
from ....core.progress import Progress
from ....core.storage.files import digest
from ....geometry.bodies.orientation import viewing_axes
from ....store.body import load_surface
from ....store.layout import LAYOUT, load_layout
from ..experiments.experiment import Experiment
from ..results.kept import once
from ..results.picture_files import in_rows, write_pictures
from .sessions import traits_of, unit_session
from .shown_frames import ShownFrame, shown_frames

FOLDER = "pictures"
_WIDTH, _HEIGHT = 560.0, 420.0
_TOP = 99.5  # percentile of the errors at which their scale ends
_TRUE = "#7d8b95"


def device_pictures(
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

    found: dict[str, Any] = once(out / "pictures.json", key, make)
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
        mechanics = traits_of(experiment, device).mechanics
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
    return {"all": in_rows(rows, names, _WIDTH), **files}
