"""Pictures of an experiment: the cords of each layout, and surface errors in each pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.mesh import Surface
from ...core.progress import Progress
from ...core.storage.files import digest
from ...geometry.bodies.orientation import viewing_axes
from ...runtime.controls.pose_amplitudes import RADIUS_90
from ...runtime.surface.live_surface import LiveSurface, make_surface
from ...runtime.surface.surface_mesh import SurfaceBasis
from ...store.layout import LAYOUT
from ...twin.devices.device_fields import MechanicsTraits, solve_fields
from ..run.live_device import LiveDevice, live_device
from .experiment import Experiment
from .result_files import compute_once, write_pictures
from .sessions import twin_traits
from .unit import Unit

FOLDER = "pictures"
UNKNOWN_SIGMA_MM = 1.0  # of a marker without an interval
MAX_FIXED_MM = 1e-9  # displacement of vertices that count as fixed
WIDTH_PX, HEIGHT_PX = 560.0, 420.0
SCALE_PERCENTILE = 99.5  # of the errors, at which their color scale ends
OUTLINE_COLOR = "#7d8b95"  # of the true surface


@dataclass(frozen=True)
class ShownFrame:
    """A frame of a test in which the surface is shown.

    Attributes:
        pose: The pose that it shows.
        weight: Level of the pose; 1 is its full amplitude.
        true: True vertices of the skin (v, 3) mm.
        predicted: Vertices (v, 3) mm as the device reports them.
        error: Distances between the two (v,) mm.
    """

    pose: str
    weight: float
    true: Float
    predicted: Float
    error: Float


def draw_device_pictures(
    experiment: Experiment, units: Mapping[str, Unit], out: Path, progress: Progress
) -> dict[str, Any]:
    """Draw the pictures of an experiment. They are kept until layouts or units change.

    Args:
        experiment: The experiment.
        units: The first unit of each layout.
        out: Folder of the experiment's results; pictures are also written to `out/pictures`.
        progress: Called with the progress.

    Returns:
        PNGs as data URIs: `routing` by layout; `poses`, each with its name, and by layout its
        level, the RMS error of the surface in mm and a picture; and the `scale` of their colors.
    """
    key = digest(
        *(u.build.folder / LAYOUT for u in units.values()),
        *(u.file(".test.json") for u in units.values()),
    )

    def make() -> dict[str, Any]:
        pictures = _draw(experiment, units, progress)
        files = {f"routing-{name}": uri for name, uri in pictures["routing"].items()}
        for pose in pictures["poses"]:
            for name, shown in pose["layouts"].items():
                files[f"{pose['name']}-{name}"] = shown["picture"]
        write_pictures(out / FOLDER, files)
        return pictures

    pictures: dict[str, Any] = compute_once(out / "pictures.json", key, make)
    return pictures


def _draw(experiment: Experiment, units: Mapping[str, Unit], progress: Progress) -> dict[str, Any]:
    from ...report.pictures import color_bar
    from ...report.pictures.sheet import Sheet

    plan, routing, frames = experiment.session, {}, {}
    for k, (name, unit) in enumerate(units.items()):
        progress("pictures", k / (2 * len(units)), name)
        routing[name] = _draw_routing(unit)
        mechanics = twin_traits(experiment, unit.device).mechanics
        frames[name] = _choose_frames(unit, mechanics, plan.share)
    errors = np.concatenate([f.error for _, _, shown in frames.values() for f in shown])
    largest = float(np.percentile(errors, SCALE_PERCENTILE))
    scale = color_bar.scale(
        color_bar.ERROR, "error of the surface, mm", largest, beyond=errors.max() > largest
    )
    poses: list[dict[str, Any]] = []
    for k, pose in enumerate(p.name for p in next(iter(units.values())).device.poses):
        progress("pictures", 0.5 + k / (2 * len(errors)), pose)
        by_layout = {}
        for name, (rest, faces, shown) in frames.items():
            frame = next(f for f in shown if f.pose == pose)
            by_layout[name] = {
                "weight": frame.weight,
                "rms": float(np.sqrt((frame.error**2).mean())),
                "largest": float(frame.error.max()),
                "moved": float(np.linalg.norm(frame.true - rest, axis=1).max()),
                "picture": _draw_surface(frame, rest, faces, scale),
            }
        poses.append({"name": pose, "layouts": by_layout})
    sheet = Sheet(WIDTH_PX, color_bar.HEIGHT)
    color_bar.draw(sheet, scale, 30, 0, WIDTH_PX - 60)
    return {"routing": routing, "poses": poses, "scale": sheet.uri()}


def _choose_frames(
    unit: Unit, mechanics: MechanicsTraits, share: float
) -> tuple[Float, Int, list[ShownFrame]]:
    """Choose for each pose the frame in which it is largest and others are smallest.

    Args:
        unit: The unit.
        mechanics: Mechanics of the twin.
        share: Share of the session that is tested, at its end.

    Returns:
        Vertices at rest (v, 3) mm and triangles (f, 3) of the skin, and one frame per pose.
    """
    live, recording = live_device(unit.model_file, unit.device.source), unit.recording
    assert live.rest is not None
    fields = solve_fields(unit.device, mechanics)
    tested = recording.time[round((1 - share) * len(recording.time)) :]
    decoded = live.model.decode(recording.sample_time, recording.signals, tested)
    weights = unit.true_weights(tested)
    skin, predict_surface = fields.displacements(live.rest.vertices), _make_surface(live)
    is_decoded = np.isfinite(decoded.points).all(axis=(1, 2))
    frames = []
    for k, name in enumerate(fields.poses):
        purity = np.abs(weights[:, k]) - np.abs(np.delete(weights, k, 1)).sum(1)
        best = int(np.where(is_decoded, purity, -np.inf).argmax())
        displacements = np.tensordot(fields.space(weights[best : best + 1])[0], skin, axes=1)
        true = live.rest.vertices + displacements
        predict_surface.reset()
        sigma = np.nan_to_num(decoded.radius[best], nan=UNKNOWN_SIGMA_MM * RADIUS_90) / RADIUS_90
        predicted = predict_surface(decoded.points[best], sigma)
        error = np.linalg.norm(predicted - true, axis=1)
        frames.append(ShownFrame(name, float(weights[best, k]), true, predicted, error))
    return live.rest.vertices, np.asarray(live.rest.faces, np.int64), frames


def _make_surface(live: LiveDevice) -> LiveSurface:
    """Return the surface that follows markers, as `defsense run` shows it."""
    assert live.rest is not None
    assert live.states is not None
    is_fixed = np.abs(live.states).max(axis=(0, 2)) < MAX_FIXED_MM
    faces = np.asarray(live.rest.faces, np.int64)
    basis = SurfaceBasis(live.rest.vertices, faces, live.states, is_fixed)
    sigma = np.full(len(live.model.ids), UNKNOWN_SIGMA_MM)
    return make_surface(basis, live.model.rest_points, sigma, frame=np.inf)


def _draw_routing(unit: Unit) -> str:
    """Draw the body with its cords."""
    from ...report.pictures import body_views, views

    surface = unit.build.surface
    cords = [c.points for c in unit.build.layout.by_channel()]
    frame, radius = viewing_axes(surface), unit.device.cord.diameter / 2
    with body_views.routing_scene(surface, cords, [], radius) as scene:
        directions = views.three_quarter(frame), views.front(frame)
        panels = [body_views.SceneView(scene, v) for v in directions]
        return body_views.picture(panels, width=WIDTH_PX, height=HEIGHT_PX, min_width_share=1.0)


def _draw_surface(frame: ShownFrame, rest: Float, faces: Any, scale: Any) -> str:
    """Draw the reported surface in the colors of its error, within the true surface."""
    from ...report.pictures import body_views, views
    from ...report.pictures.scene import Scene, poly

    mesh = poly(Surface(frame.predicted, faces))
    mesh.point_data["error"] = frame.error
    with Scene() as scene:
        scene.outline(Surface(frame.true, faces), OUTLINE_COLOR, 0.35)
        scene.colored(mesh, "error", scale.colors, scale.top)
        view = views.three_quarter(viewing_axes(Surface(rest, faces)))
        return body_views.picture(
            [body_views.SceneView(scene, view)],
            width=WIDTH_PX,
            height=HEIGHT_PX,
            min_width_share=1.0,
        )
