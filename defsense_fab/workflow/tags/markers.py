"""Choose the tags of a device and their places, and write the sheets to print."""

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
from ...core.mesh import Surface
from ...core.progress import Progress, silent
from ...core.storage.files import storage_errors
from ...geometry.bodies.tag_placement import TagPlace, TagRequest, are_spread_out, place_tags
from ...store.layout import LAYOUT, load_layout
from ...store.manifest import MANIFEST, TagSeat, load_manifest
from .options import MARKERS_FOLDER, MarkerOptions

SHEETS = "markers.pdf"
DEFAULT_COUNT = 12  # of tags on the skin
DEFAULT_OPTIONS = MarkerOptions()
#: Sides of tags; the largest that fits is used.
SIZES_MM = (20.0, 15.0, 12.0, 10.0, 8.0, 6.0)
MIN_ANCHOR_TAGS = 3  # for a rigid alignment
MAX_SEAT_DISTANCE_MM = 3.0  # from the skin; a seat farther away is of another body


@dataclass(frozen=True)
class MarkerFiles:
    """Files of markers that were written.

    Attributes:
        markers: The markers.
        folder: Folder of the files.
        notes: What the user should know.
    """

    markers: Markers
    folder: Path
    notes: tuple[str, ...]


def write_markers(
    device: Device, options: MarkerOptions = DEFAULT_OPTIONS, progress: Progress = silent
) -> MarkerFiles:
    """Write `markers.json` and `markers.pdf`.

    If the build of the device has seats, tags are placed in them.

    Args:
        device: The device.
        options: Number, size and places of the tags.
        progress: Receives progress.

    Raises:
        CaptureError: The tags do not fit (`tags-do-not-fit`), or an option is not valid.
        StorageError: Files cannot be written.
    """
    tags = dictionary(options.dictionary)
    paper_size(options.paper)
    _check_options(options, tags)
    seats = () if options.skin else _manifest_seats(device)
    _check_seats(device, options, seats)
    from ...geometry.bodies.body import load_body

    progress("markers", 0.0, "loading the body")
    body = load_body(device.body).surface
    progress("markers", 0.4, "choosing places")
    if seats:
        markers, notes = _markers_in_seats(device, body, tags, seats)
    else:
        markers, notes = _markers_on_skin(device, body, tags, options)
    folder = options.out or device.source / MARKERS_FOLDER
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    progress("markers", 0.7, "drawing")
    _write_sheets(device, body, markers, tags, options.paper, notes, folder / SHEETS)
    write_markers_file(markers, folder / FILE)
    progress("markers", 1.0, "done")
    return MarkerFiles(markers, folder, tuple(notes))


def _check_options(options: MarkerOptions, tags: Dictionary) -> None:
    count, size, side = options.count, options.size, options.side
    if count is not None and not 1 <= count < tags.count:
        raise CaptureError(
            f"{count} tags are not possible",
            code="out-of-range",
            where="count",
            action=f"Give 1 to {tags.count - 1} tags of {tags.name}",
            count=count,
        )
    if size is not None and not 2 <= size <= 200:
        raise CaptureError(
            f"tags of {size:g} mm are not possible",
            code="out-of-range",
            where="size",
            action="Give 2 to 200 mm",
            size=size,
        )
    if side is not None and not 0 < np.linalg.norm(side) < np.inf:
        raise CaptureError(
            f"{','.join(f'{x:g}' for x in side)} is not a direction",
            code="direction-invalid",
            where="side",
            action="Give a direction x,y,z, such as 0,-1,1",
            value=side,
        )


def _check_seats(device: Device, options: MarkerOptions, seats: Sequence[TagSeat]) -> None:
    if seats and (options.count is not None or options.size is not None):
        raise CaptureError(
            f"has seats for {len(seats)} tags of {seats[0].tag:g} mm, which set count and size",
            code="tag-seats-given",
            where=device.name,
            action="Omit count and size, or choose places on the skin (skin)",
            count=len(seats),
        )
    if device.fabrication.marker_seats and not seats and not options.skin:
        raise CaptureError(
            "has marker_seats, whose places its build chooses",
            code="tag-seats-not-built",
            where=device.name,
            action=(
                f"Run 'defsense build {device.source}' first, or choose places on the skin (skin)"
            ),
        )


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
    """Return which points (n, 3), mm, are in the anchor region; none without such a region."""
    name = device.outputs.anchor
    if name is None:
        return np.zeros(len(points), bool)
    return device.regions[name].contains(points)


def _anchor_note(device: Device, markers: Markers) -> list[str]:
    """Return a note if the anchor cannot be aligned by its tags."""
    name = device.outputs.anchor
    if name is None:
        return [
            "There is no [outputs] anchor, so recordings are aligned by all tags in the rest pose."
        ]
    if are_spread_out(markers.centers[markers.anchor], markers.size / 2):
        return []
    return [
        f"The anchor {name} has {int(markers.anchor.sum())} of the tags, but three that are not on"
        " one line are needed, so recordings are aligned by all tags in the rest pose."
    ]


def _manifest_seats(device: Device) -> tuple[TagSeat, ...]:
    folder = build_folder(device)
    return load_manifest(folder, CaptureError).marker_seats if (folder / MANIFEST).is_file() else ()


def _markers_in_seats(
    device: Device, body: Surface, tags: Dictionary, seats: Sequence[TagSeat]
) -> tuple[Markers, list[str]]:
    """Return tags whose pieces, with their white, fill the seats."""
    import igl

    centers = np.array([s.center for s in seats], float)
    distance = np.sqrt(igl.point_mesh_squared_distance(centers, body.vertices, body.faces)[0])
    if np.max(distance) > MAX_SEAT_DISTANCE_MM:
        raise CaptureError(
            f"its build has seats {np.max(distance):.1f} mm from the body, which has changed since",
            code="tag-seats-outdated",
            where=device.name,
            action=f"Run 'defsense build {device.source}'",
            distance=float(np.max(distance)),
        )
    if max(s.marker for s in seats) >= tags.count:
        raise CaptureError(
            f"{tags.name} has too few tags for {len(seats)} seats",
            code="out-of-range",
            where=device.name,
            action="Choose a larger dictionary",
            count=len(seats),
        )
    x_axes = np.array([s.x_axis for s in seats], float)
    normals = np.array([s.normal for s in seats], float)
    piece = seats[0].tag
    markers = Markers(
        device.name,
        tags.name,
        round(piece / piece_size(tags, 1.0), 2),
        np.array([s.marker for s in seats], np.int64),
        centers,
        np.stack([x_axes, np.cross(normals, x_axes), normals], axis=2),
        _on_anchor(device, centers),
    )
    note = (
        f"Seats of {piece:g} mm hold the tag with its white, so its black square is"
        f" {markers.size:g} mm. Cut the pieces to {piece:g} mm."
    )
    return markers, [note, *_anchor_note(device, markers)]


def _markers_on_skin(
    device: Device, body: Surface, tags: Dictionary, options: MarkerOptions
) -> tuple[Markers, list[str]]:
    """Choose places on the skin; if no size suits the anchor, the largest that fits."""
    count = options.count or DEFAULT_COUNT
    side = None if options.side is None else np.array(options.side)
    avoid, joints = _cord_mouths(device, body)
    anchored = max(MIN_ANCHOR_TAGS, round(count / 3)) if device.outputs.anchor else 0
    best: list[TagPlace] = []
    fallback: tuple[float, list[TagPlace]] | None = None
    sizes = SIZES_MM if options.size is None else (options.size,)
    for tag_size in sizes:
        request = TagRequest(
            count,
            tag_size,
            piece_size(tags, tag_size),
            anchored,
            lambda p: _on_anchor(device, p),
            avoid,
            joints,
            side,
        )
        places = place_tags(body, request)
        best = max(best, places, key=len)
        if len(places) < count:
            continue
        fallback = fallback or (tag_size, places)
        anchor_centers = np.array([p.center for p in places if p.anchor]).reshape(-1, 3)
        if not anchored or count < MIN_ANCHOR_TAGS or are_spread_out(anchor_centers, tag_size / 2):
            fallback = tag_size, places
            break
    if fallback is None:
        choices = ["fewer tags (count)"] if best else []
        choices += ["smaller tags (size)"]
        fitting = f"{len(best)} fit" if best else "none fits"
        raise CaptureError(
            f"there is no room for {count} tags of {sizes[-1]:g} mm where the skin is nearly flat;"
            f" {fitting}",
            code="tags-do-not-fit",
            where=device.name,
            action=f"Choose {' or '.join(choices)}",
            fitting=len(best),
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


def _cord_mouths(device: Device, body: Surface) -> tuple[Float, list[Any]]:
    """Return where cords or wires leave the skin (n, 3), mm, and the planes that split the body.

    They are those of the build, or else of the drawing.
    """
    from ...core.curve import sample_path
    from ...geometry.kernels.surface_queries import cast_ray

    folder, sensors = build_folder(device), list(device.sensors)
    if (folder / LAYOUT).is_file():
        sensors = [s.sensor() for s in load_layout(folder, CaptureError).sensors]
    mouths = [] if device.body.bay is None else [device.body.bay.at]
    for path in map(sample_path, sensors):
        for end, inner in ((path[0], path[1]), (path[-1], path[-2])):
            direction = (end - inner) / np.linalg.norm(end - inner)
            to_skin = cast_ray(end, direction, body)
            mouths.append(end + (to_skin[0] if len(to_skin) else 0.0) * direction)
    planes = [s.plane for s in sensors] if device.cord.trace is None else []
    return np.array(mouths, float).reshape(-1, 3), planes
