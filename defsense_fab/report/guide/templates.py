"""Compute templates at 1:1 in mm, without a page: straight cords, and the faces of joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane, arc_lengths, resample
from ...core.device.device import Device
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import plane_section
from ...store.layout import LayoutRecord
from ...store.manifest import END_NAMES, CutCord, JointStretch, Manifest
from .instructions import cord_label, format_resistance
from .plan import late_end, sliding_wires
from .steps import Joint

_GLUELESS_MARGIN_MM = 1.5  # next to a groove that must stay free of glue
_RING_POINTS = 33
_OUTLINE_DEPTH_MM = 0.05  # below the face, where its outline is taken
_MIN_POINT_DISTANCE_MM = 1e-6  # nearer points are the same


@dataclass(frozen=True)
class CordLine:
    """The line of a cord.

    Attributes:
        cord: Record of the cord.
        points: Points (p, 3) of its channel from mouth to mouth, mm.
    """

    cord: CutCord
    points: Float

    def way_out(self, end: int) -> Float:
        """Return the unit direction (3,) in which the cord leaves the body at an end."""
        p = self.points
        direction = p[0] - p[3] if end == 0 else p[-1] - p[-4]
        return np.asarray(direction / np.linalg.norm(direction))

    def ferrule(self, end: int, length: float) -> Float:
        """Return the middle (3,) of an end's ferrule, mm.

        A ferrule is at the bottom of its pocket, or outside the mouth of a free end.
        """
        record = self.cord.ends[end]
        depth = record.pocket - length / 2 if record.joint == "pocket" else -record.lead
        return np.asarray(record.at - depth * self.way_out(end))

    def along(self, start: float, stop: float, points_per_mm: float = 1.0) -> Float:
        """Return points (q, 3) of the line between two distances from its first mouth, mm."""
        return _between(self.points, start, stop, points_per_mm)

    def ends_in(self, stretch: JointStretch) -> list[int]:
        """Return the ends of the cord that belong to a stretch."""
        last = len(self.cord.stretches) - 1
        return [end for end, k in ((0, 0), (1, last)) if self.cord.stretches[k] is stretch]


def cord_line(layout: LayoutRecord, cord: CutCord) -> CordLine:
    """Return the line of a cord in its layout."""
    points = next(s.points for s in layout.sensors if s.name == cord.sensor)
    line = np.concatenate([cord.ends[0].at[None], points, cord.ends[1].at[None]])
    distances = np.linalg.norm(np.diff(line, axis=0), axis=1)
    is_new = np.concatenate([[True], distances > _MIN_POINT_DISTANCE_MM])
    return CordLine(cord, np.asarray(line[is_new]))


def glueless_lines(
    device: Device, layout: LayoutRecord, manifest: Manifest, joint: Joint
) -> list[Float]:
    """Return the lines (p, 3) mm that bound where no glue may be on the face of a joint.

    They are on both sides of the grooves of held cords and of wires that must slide, and around the
    spots of `JoinStep`. Bonded cords are glued into their grooves.
    """
    offset = device.channel_diameter / 2 + _GLUELESS_MARGIN_MM
    lines = []
    for cord in manifest.cords if manifest.assembly_of_cords == "held" else ():
        for stretch in cord.stretches:
            if stretch.joint != joint.index:
                continue
            points = cord_line(layout, cord).along(stretch.start, stretch.stop)
            lines += _both_sides(points, offset, joint)
    for wire in sliding_wires(manifest, joint.index):
        assert wire.path is not None
        for stretch in wire.stretches:
            if stretch.joint == joint.index:
                points = _between(wire.path, stretch.start, stretch.stop)
                lines += _both_sides(points, offset, joint)
    in_face = lines[0][0] if lines else joint.pins[0].center if joint.pins else None
    for spot in manifest.assembly[joint.index].glueless:
        depth = 0.0 if in_face is None else float((in_face - spot.at) @ joint.opens)
        if abs(depth) > spot.reach:  # at another face of the joint
            depth = 0.0
        lines.append(_ring(spot.at + depth * joint.opens, spot.reach, joint))
    return lines


def _between(line: Float, start: float, stop: float, points_per_mm: float = 1.0) -> Float:
    """Return points (q, 3) of a line (p, 3) between two distances from its start, mm."""
    stop = min(stop, float(arc_lengths(line)[-1]))
    return resample(line, start, stop, max(2, int(points_per_mm * (stop - start)) + 1))


def _both_sides(points: Float, offset: float, joint: Joint) -> list[Float]:
    """Return the lines (p, 3) on both sides of a line (p, 3) in the face of a joint."""
    sideways = np.cross(np.gradient(points, axis=0), joint.opens)
    sideways *= offset / np.linalg.norm(sideways, axis=1, keepdims=True)
    return [points + sideways, points - sideways]


def _ring(center: Float, radius: float, joint: Joint) -> Float:
    """Return a closed line (p, 3) in the face of a joint."""
    angles = np.linspace(0, 2 * np.pi, _RING_POINTS)[:, None]
    upwards = np.cross(joint.opens, joint.across)
    return np.asarray(center + radius * (np.cos(angles) * joint.across + np.sin(angles) * upwards))


@dataclass(frozen=True)
class CordTemplate:
    """A straight piece of cord, measured from the end that is crimped first.

    Attributes:
        title: Label of the cord.
        first: Name of the end that is crimped first.
        second: Name of the other end.
        mark: Middle of the second ferrule, mm.
        length: Length of the piece, mm.
        cord: Diameter of the cord, mm.
        ferrule: Diameter and length of a ferrule, mm.
        notes: Notes about lengths and resistances.
    """

    title: str
    first: str
    second: str
    mark: float
    length: float
    cord: float
    ferrule: tuple[float, float]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class FaceCord:
    """A stretch of a cord in a face.

    Attributes:
        name: Label of the cord.
        line: Line (p, 2), mm.
        ferrules: Middle (2,) and direction (2,) of each ferrule, mm.
    """

    name: str
    line: Float
    ferrules: tuple[tuple[Float, Float], ...]


@dataclass(frozen=True)
class FaceTemplate:
    """The face of a joint's lower parts, as its pictures show it, from its lower left corner.

    Attributes:
        title: Title of the template.
        outline: Segments (m, 2, 2) of the outline, mm.
        cords: Stretches of cords in the face.
        wires: Lines (p, 2) of wires, mm.
        pins: Letter, middle (2,) in mm and diameter in mm of each pin.
        size: Width and height (2,), mm.
        ferrule: Diameter and length of a ferrule, mm.
        cord: Diameter of the cords, mm.
    """

    title: str
    outline: Float
    cords: tuple[FaceCord, ...]
    wires: tuple[Float, ...]
    pins: tuple[tuple[str, Float, float], ...]
    size: Float
    ferrule: tuple[float, float]
    cord: float


def cord_templates(device: Device, manifest: Manifest) -> tuple[CordTemplate, ...]:
    """Return a template of each cord of a device."""
    templates = []
    for cord in manifest.cords:
        late = late_end(cord)
        first = 0 if late is None else 1 - late
        notes = [
            f"cut to {cord.cut_length:.1f} mm:"
            f" {format_resistance(cord.cut_length * device.cord.ohm_per_mm)} from end to end",
            f"{cord.unstretched:.1f} mm between the middles of the ferrules, not stretched:"
            f" {cord.resistance_before:.0f} ohm",
        ]
        if cord.prestretch:
            elongation = cord.between_ferrules - cord.unstretched
            notes.append(
                f"stretched by {elongation:.1f} mm ({cord.prestretch:.0%}) in the device:"
                f" {cord.resistance:.0f} ohm"
            )
        else:
            notes.append(f"not stretched in the device: {cord.resistance:.0f} ohm")
        templates.append(
            CordTemplate(
                cord_label(cord.sensor),
                END_NAMES[first],
                END_NAMES[1 - first],
                cord.unstretched,
                cord.cut_length,
                device.cord.diameter,
                (device.cord.ferrule_diameter, device.cord.ferrule_length),
                tuple(notes),
            )
        )
    return tuple(templates)


def face_template(
    joint: Joint,
    title: str,
    device: Device,
    layout: LayoutRecord,
    manifest: Manifest,
    parts: Mapping[str, Surface],
) -> FaceTemplate | None:
    """Return the template of the face of a joint's lower parts.

    Args:
        joint: The joint.
        title: Title of the template.
        device: The device.
        layout: Layout of its cords.
        manifest: The manifest of its parts.
        parts: Surfaces of its parts, by name.

    Returns:
        The template, or None if the face has no cord.
    """
    cords = [c for c in manifest.cords if any(s.joint == joint.index for s in c.stretches)]
    if not cords:
        return None
    sensor = next(s for s in layout.sensors if s.name == cords[0].sensor)
    frame = Plane.from_normal(sensor.plane.origin, joint.opens, joint.across)
    below = Plane(frame.origin - _OUTLINE_DEPTH_MM * joint.opens, frame.axes)
    outline = np.concatenate([plane_section(parts[n], below) for n in joint.lower])
    face_cords = [
        _project_stretch(cord_line(layout, c), s, device, frame)
        for c in cords
        for s in c.stretches
        if s.joint == joint.index
    ]
    wires = [_project(w, frame) for w in joint.wires]
    ferrules = [middle[None] for c in face_cords for middle, _ in c.ferrules]
    points = np.concatenate([outline.reshape(-1, 2), *(c.line for c in face_cords), *ferrules])
    low, high = points.min(0), points.max(0)
    diameters = {p.name: p.diameter for p in manifest.pins}
    return FaceTemplate(
        title,
        outline - low,
        tuple(
            FaceCord(c.name, c.line - low, tuple((m - low, d) for m, d in c.ferrules))
            for c in face_cords
        ),
        tuple(w - low for w in wires),
        tuple(
            (letter, _project(p.center[None], frame)[0] - low, diameters[p.name])
            for letter, p in zip(joint.letters, joint.pins, strict=True)
        ),
        high - low,
        (device.cord.ferrule_diameter, device.cord.ferrule_length),
        device.cord.diameter,
    )


def _project(points: Float, frame: Plane) -> Float:
    return np.asarray((points - frame.origin) @ frame.axes[:, :2])


def _project_stretch(
    line: CordLine, stretch: JointStretch, device: Device, frame: Plane
) -> FaceCord:
    ferrules = tuple(
        (
            _project(line.ferrule(end, device.cord.ferrule_length)[None], frame)[0],
            line.way_out(end) @ frame.axes[:, :2],
        )
        for end in line.ends_in(stretch)
    )
    points = line.along(stretch.start, stretch.stop, points_per_mm=2.0)
    return FaceCord(cord_label(line.cord.sensor), _project(points, frame), ferrules)
