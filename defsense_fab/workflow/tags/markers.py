"""The tags of a device: which, where they go, and the sheets to print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.tags.print_sheets import draw_tags, open_pdf, paper_size, piece_size
from ...capture.tags.tag_patterns import Dictionary, dictionary
from ...core.arrays import Bool, Float
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import FILE, Markers, write_markers_file
from ...core.markers import read_markers as read_markers
from ...core.mesh import Surface
from ...core.progress import Progress, silent
from ...core.storage.files import storage_errors
from ...geometry.bodies.tag_placement import TagPlace, TagRequest, are_spread_out, place_tags
from ...store.layout import LAYOUT, load_layout
from ...store.manifest import MANIFEST, TagSeat, load_manifest

FOLDER, SHEETS = "markers", "markers.pdf"
COUNT, DICTIONARY = 12, "4X4_50"
#: Sides of tags, mm, the largest that fits is taken.
SIZES = (20.0, 15.0, 12.0, 10.0, 8.0, 6.0)
_ALIGNED = 3  # tags that a rigid alignment needs at least
_FAR = 3.0  # mm from the skin: a seat there is one of another body


@dataclass(frozen=True)
class MarkerFiles:
    """What was written to `folder`, and what the user should know about it."""

    markers: Markers
    folder: Path
    notes: tuple[str, ...]


def write_markers(
    device: Device,
    folder: Path | None = None,
    *,
    count: int | None = None,
    size: float | None = None,
    family: str = DICTIONARY,
    paper: str = "a4",
    skin: bool = False,
    side: Float | None = None,
    progress: Progress = silent,
) -> MarkerFiles:
    """Write `markers.json` and `markers.pdf` to `folder` (the device's `markers`): tags in the
    seats that its build has cut, or else (and with `skin`) `count` tags (12) of `size` mm, by
    default the largest of SIZES with which they fit and three of the anchor are not on one line;
    only where cameras see them from the direction `side` (3,), where one is given.

    Raises CaptureError where tags do not fit, StorageError where files cannot be written.
    """
    tags = dictionary(family)
    paper_size(paper)
    if count is not None and not 1 <= count < tags.count:
        raise CaptureError(f"--count {count}: give 1 to {tags.count - 1} tags of {tags.name}")
    if size is not None and not 2 <= size <= 200:
        raise CaptureError(f"--size {size:g}: give mm, from 2 to 200")
    seats = () if skin else _manifest_seats(device)
    if seats and (count is not None or size is not None):
        raise CaptureError(
            f"{device.name} has seats for {len(seats)} tags of {seats[0].tag:g} mm: leave out"
            " --count and --size, or add --skin to choose places beside the seats"
        )
    if device.fabrication.marker_seats and not seats and not skin:
        raise CaptureError(
            f"{device.name} asks for marker_seats, whose places its build chooses: run 'defsense"
            f" build {device.source}' first, or add --skin to choose places without seats"
        )
    from ...geometry.bodies.body import load_body

    progress("markers", 0.0, "loading the body")
    body = load_body(device.body).surface
    progress("markers", 0.4, "choosing places")
    if seats:
        markers, notes = _seated(device, body, tags, seats)
    else:
        markers, notes = _chosen(device, body, tags, count or COUNT, size, side)
    out = device.source / FOLDER if folder is None else folder
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    progress("markers", 0.7, "drawing")
    _write_sheets(device, body, markers, tags, paper, notes, out / SHEETS)
    write_markers_file(markers, out / FILE)
    progress("markers", 1.0, "done")
    return MarkerFiles(markers, out, tuple(notes))


def _write_sheets(
    device: Device,
    body: Surface,
    markers: Markers,
    tags: Dictionary,
    paper: str,
    notes: list[str],
    path: Path,
) -> None:
    from .marker_pages import draw_places

    with open_pdf(path, f"{device.name}: camera tags") as canvas:
        draw_tags(canvas, tags, markers.ids.tolist(), markers.size, paper, device.name)
        draw_places(canvas, body, markers, paper, notes, device.outputs.anchor)


def _on_anchor(device: Device, points: Float) -> Bool:
    """Which points (n, 3) mm lie in the anchor region; none where there is no such region."""
    name = device.outputs.anchor
    if name is None:
        return np.zeros(len(points), bool)
    return device.regions[name].contains(points)


def _anchor_note(device: Device, markers: Markers) -> list[str]:
    """Where the anchor cannot be aligned by its tags."""
    name = device.outputs.anchor
    if name is None:
        return ["no [outputs] anchor: recordings are aligned by all tags in the rest pose"]
    if are_spread_out(markers.centers[markers.anchor], markers.size / 2):
        return []
    return [
        f"the anchor {name} carries {int(markers.anchor.sum())} of the tags, and three that are not"
        " on one line are needed: recordings are aligned by all tags in the rest pose"
    ]


def _manifest_seats(device: Device) -> tuple[TagSeat, ...]:
    folder = build_folder(device)
    return load_manifest(folder, CaptureError).marker_seats if (folder / MANIFEST).is_file() else ()


def _seated(
    device: Device, body: Surface, tags: Dictionary, seats: Sequence[TagSeat]
) -> tuple[Markers, list[str]]:
    """Tags whose pieces, white included, fill the seats."""
    import igl

    centers = np.array([s.center for s in seats], float)
    off = np.sqrt(igl.point_mesh_squared_distance(centers, body.vertices, body.faces)[0])
    if np.max(off) > _FAR:
        raise CaptureError(
            f"{device.name}: its build has seats {np.max(off):.1f} mm off the body: the body has"
            f" changed since; run 'defsense build {device.source}'"
        )
    if max(s.marker for s in seats) >= tags.count:
        raise CaptureError(f"{len(seats)} seats: {tags.name} has too few tags; take a larger one")
    x = np.array([s.x_axis for s in seats], float)
    z = np.array([s.normal for s in seats], float)
    piece = seats[0].tag
    markers = Markers(
        device.name,
        tags.name,
        round(piece / piece_size(tags, 1.0), 2),
        np.array([s.marker for s in seats], np.int64),
        centers,
        np.stack([x, np.cross(z, x), z], axis=2),
        _on_anchor(device, centers),
    )
    note = (
        f"seats of {piece:g} mm hold the tag with its white: its black square is"
        f" {markers.size:g} mm; cut the pieces to {piece:g} mm"
    )
    return markers, [note, *_anchor_note(device, markers)]


def _chosen(
    device: Device,
    body: Surface,
    tags: Dictionary,
    count: int,
    size: float | None,
    side: Float | None,
) -> tuple[Markers, list[str]]:
    """Places on the skin. Where no size does for the anchor, the largest for the number."""
    avoid, joints = _cords(device, body)
    anchored = max(_ALIGNED, round(count / 3)) if device.outputs.anchor else 0
    best: list[TagPlace] = []
    fallback: tuple[float, list[TagPlace]] | None = None
    sizes = SIZES if size is None else (size,)
    for tried in sizes:
        found = place_tags(
            body,
            TagRequest(
                count, tried, piece_size(tags, tried), anchored,
                lambda p: _on_anchor(device, p), avoid, joints, side,
            ),
        )  # fmt: skip
        best = max(best, found, key=len)
        if len(found) < count:
            continue
        fallback = fallback or (tried, found)
        on = np.array([p.center for p in found if p.anchor]).reshape(-1, 3)
        if not anchored or count < _ALIGNED or are_spread_out(on, tried / 2):
            fallback = tried, found
            break
    if fallback is None:
        ways = ["fewer (--count)"] if best else []
        ways += ["smaller ones (--size)"]
        fit = f"{len(best)} fit" if best else "not one fits"
        raise CaptureError(
            f"{device.name}: no room for {count} tags of {sizes[-1]:g} mm where the skin is nearly"
            f" flat, {fit}; ask for {' or '.join(ways)}"
        )
    chosen, places = fallback
    markers = Markers(
        device.name,
        tags.name,
        chosen,
        np.arange(1, count + 1),
        np.array([p.center for p in places]),
        np.array([p.axes for p in places]),
        np.array([p.anchor for p in places]),
    )
    return markers, _anchor_note(device, markers)


def _cords(device: Device, body: Surface) -> tuple[Float, list[Any]]:
    """Where cords or their wires come out of the skin (n, 3) mm, and the planes in which the body
    is split for them: as built, or else as drawn."""
    from ...core.curve import sample_path
    from ...geometry.kernels.surface_queries import cast_ray

    folder, sensors = build_folder(device), list(device.sensors)
    if (folder / LAYOUT).is_file():
        sensors = [s.sensor() for s in load_layout(folder, CaptureError).sensors]
    mouths = [] if device.body.bay is None else [device.body.bay.at]
    for path in map(sample_path, sensors):
        for end, before in ((path[0], path[1]), (path[-1], path[-2])):
            out = (end - before) / np.linalg.norm(end - before)
            to_skin = cast_ray(end, out, body)
            mouths.append(end + (to_skin[0] if len(to_skin) else 0.0) * out)
    return np.array(mouths, float).reshape(-1, 3), [s.plane for s in sensors]
