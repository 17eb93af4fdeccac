"""Tables of `device.toml` for the body, mesh, regions, outputs, readout and design."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from ..errors import DeviceError
from ..schema.declare import Count, Positive, Problem, Table, Vector, key, missing
from ..schema.types import is_number
from .boards import CONVERTERS, find_board
from .boards import FILE as BOARDS
from .device import (
    DECODERS,
    PREFERENCES,
    BaySpec,
    BodyKind,
    BodySpec,
    Device,
    MeshSpec,
    OutputsSpec,
)
from .pads import PADS
from .regions import Box, Cylinder, HalfSpace, Shape, Sphere, shape_problem

_BODY_KINDS: tuple[BodyKind, ...] = ("script", "step", "mesh")
_BayEdge = Annotated[float, Meta(ge=2)]
_Accuracy = Annotated[float, Meta(ge=0.0001, le=0.2)]


class BayTable(Table, frozen=True):
    """A recess for a connector, into which wires lead."""

    at: Annotated[
        Vector,
        key(
            "Point of the skin around which the bay opens; meshes, poses and cords keep to the"
            " body with it, and wires end in it (`docs/wires.md`).",
            unit="mm",
        ),
    ]
    size: Annotated[
        tuple[_BayEdge, _BayEdge, _BayEdge],
        key("Width, height and depth: by default of pin headers or a 4-way JST-XH.", unit="mm"),
    ] = (14.0, 7.0, 8.0)


class BodyTable(Table, frozen=True):
    """Where the body comes from: exactly one of a script, a STEP file and a mesh."""

    script: Annotated[
        str | None,
        key(
            "Python file next to `device.toml` whose function `body(**parameters)` returns one"
            " build123d or CadQuery solid, in mm; it runs in its own process"
            " (`docs/studio-keys.md` explains how it declares bounds for sliders).",
            default="this, `step` or `mesh`",
        ),
    ] = None
    step: Annotated[str | None, key("STEP file.", default="this, `script` or `mesh`")] = None
    mesh: Annotated[
        str | None,
        key(
            "Mesh file: STL, OBJ, PLY, OFF, 3MF, GLB, or tetrahedra in `.msh`, `.vtu` or `.mesh`"
            " (`docs/bodies.md` lists what is repaired).",
            default="this, `script` or `step`",
        ),
    ] = None
    parameters: Annotated[
        dict[str, Any],
        key(
            "Arguments of the script's function `body`; `--set name=value` replaces one for one"
            " command.",
        ),
    ] = msgspec.field(default_factory=dict)
    scale: Annotated[
        Positive | None,
        key("Factor that turns the unit of a mesh into mm.", default="`1`"),
    ] = None
    time_limit: Annotated[
        Positive,
        key(
            "Longest processor time for the script, or for reading and repairing a file; Ctrl-C"
            " also stops it.",
            unit="s",
        ),
    ] = BodySpec.time_limit
    fill_cavities: Annotated[
        bool,
        key(
            "Whether closed cavities, which cannot be made, become solid; otherwise a body with"
            " one is refused, with its volume and place.",
        ),
    ] = False
    bay: Annotated[BayTable | None, key("Recess for a connector.", default="no bay")] = None

    def check(self) -> Iterator[Problem]:
        """Yield problems of the kind of body and of keys that do not apply to it."""
        kinds = [kind for kind in _BODY_KINDS if getattr(self, kind) is not None]
        if len(kinds) != 1:
            yield Problem(
                (),
                f"needs exactly one of script, step and mesh; it has {len(kinds)}",
                "body-kind",
                "Give one of them",
            )
            return
        for name, kind in (("parameters", "script"), ("scale", "mesh")):
            if getattr(self, name) and kinds != [kind]:
                text = f"is for a body with the key {kind!r}, and this one has {kinds[0]!r}"
                yield Problem((name,), text, "key-not-applicable", "Remove it")
        for name, value in self.parameters.items():
            if isinstance(value, int | float) and not (isinstance(value, bool) or is_number(value)):
                yield Problem(
                    ("parameters",),
                    f"{name} must be a finite number, not {value!r}",
                    "not-finite",
                    data={"parameter": name},
                )

    @property
    def kind(self) -> BodyKind:
        """The one kind of body that is given."""
        return next(kind for kind in _BODY_KINDS if getattr(self, kind) is not None)

    def record(self, folder: Path) -> BodySpec:
        """Return the body, whose file is in `folder`."""
        return BodySpec(
            self.kind,
            folder / getattr(self, self.kind),
            dict(self.parameters),
            1.0 if self.scale is None else self.scale,
            None if self.bay is None else BaySpec(np.array(self.bay.at), self.bay.size),
            self.time_limit,
            self.fill_cavities,
        )


class MeshTable(Table, frozen=True):
    """The tetrahedra: give either their edge length or an accuracy."""

    edge_length: Annotated[
        Positive | None,
        key(
            "Edge length of the elements, shorter where the surface is curved: about a fifth of"
            " the body's thickness is enough, and smaller is more accurate and slower.",
            unit="mm",
            default="this or `accuracy`",
        ),
    ] = None
    accuracy: Annotated[
        _Accuracy | None,
        key(
            "Relative accuracy of the signals, as 0.01, in place of `edge_length`: poses are"
            " solved on finer and finer meshes until lines through the body change less, and"
            " `mesh.json` reports the accuracy that was reached.",
            default="this or `edge_length`",
        ),
    ] = None
    time_limit: Annotated[
        Positive, key("Longest time for meshing, over all methods that are tried.", unit="s")
    ] = MeshSpec.time_limit

    def check(self) -> Iterator[Problem]:
        """Yield a problem unless exactly one of edge length and accuracy is given."""
        if self.edge_length is None and self.accuracy is None:
            yield missing("edge_length")
        if self.edge_length is not None and self.accuracy is not None:
            yield Problem(
                ("edge_length",),
                "accuracy is given too",
                "keys-exclusive",
                "Give either edge_length = 6.0 (mm) or accuracy = 0.01 (of signals)",
            )

    def record(self) -> MeshSpec:
        """Return the settings of the mesh."""
        return MeshSpec(self.edge_length, self.accuracy, self.time_limit)


class SphereTable(Table, frozen=True):
    """A ball."""

    center: Annotated[Vector, key("Center.", unit="mm")]
    radius: Annotated[Positive, key("Radius.", unit="mm")]


class HalfSpaceTable(Table, frozen=True):
    """All points on one side of a plane."""

    origin: Annotated[Vector, key("Point of the plane.", unit="mm")]
    normal: Annotated[
        Vector, key("Direction, of any length but zero, to the side that is the region.")
    ]


class CylinderTable(Table, frozen=True):
    """A solid cylinder."""

    start: Annotated[Vector, key("One end of the axis.", unit="mm")]
    end: Annotated[Vector, key("Other end of the axis.", unit="mm")]
    radius: Annotated[Positive, key("Radius.", unit="mm")]


class RegionTable(Table, frozen=True):
    """A named part of the body, by exactly one shape."""

    box: Annotated[
        tuple[Vector, Vector] | None,
        key("Two corners of a box, `[[low], [high]]`.", unit="mm", default="one of these shapes"),
    ] = None
    sphere: Annotated[SphereTable | None, key("A ball.", default="one of these shapes")] = None
    half_space: Annotated[
        HalfSpaceTable | None,
        key(
            "All that lies beyond `origin` in the direction of `normal`.",
            default="one of these shapes",
        ),
    ] = None
    cylinder: Annotated[
        CylinderTable | None, key("A solid cylinder.", default="one of these shapes")
    ] = None

    def check(self) -> Iterator[Problem]:
        """Yield a problem unless there is exactly one shape, and it holds some space."""
        kinds = ("box", "sphere", "half_space", "cylinder")
        given = [kind for kind in kinds if getattr(self, kind) is not None]
        if len(given) != 1:
            text = f"needs exactly one of {', '.join(kinds)}; it has {len(given)}"
            yield Problem((), text, "region-shape", "Give one of them")
        elif wrong := shape_problem(self.shape()):
            name, text = wrong
            path = (name,) if name == given[0] else (given[0], name)
            yield Problem(path, text, "region-empty")

    def shape(self) -> Shape:
        """Return the shape."""
        if self.box is not None:
            return Box(*np.array(self.box))
        if (s := self.sphere) is not None:
            return Sphere(np.array(s.center), s.radius)
        if (h := self.half_space) is not None:
            return HalfSpace(np.array(h.origin), np.array(h.normal))
        assert self.cylinder is not None
        c = self.cylinder
        return Cylinder(np.array(c.start), np.array(c.end), c.radius)


class OutputsTable(Table, frozen=True):
    """What is decoded from the cords."""

    markers: Annotated[
        Count | Annotated[list[Vector], Meta(min_length=1)] | Literal["surface"],
        key(
            "Number of points that are spread evenly on the surface, the points (mm), or"
            ' `"surface"`'
            " for all of it.",
            form='a number of markers, a list of points [x, y, z], or "surface"',
        ),
    ] = 40
    anchor: Annotated[
        str | None,
        key(
            "Region that stays in place while the device is recorded, to which recorded markers"
            " are aligned; builds do without.",
            default="none",
        ),
    ] = None

    def record(self) -> OutputsSpec:
        """Return the outputs."""
        markers = np.array(self.markers) if isinstance(self.markers, list) else self.markers
        return OutputsSpec(markers, self.anchor)


class ReadoutTable(Table, frozen=True):
    """What measures the cords."""

    board: Annotated[
        str,
        key(
            "Board that the cords are connected to (`docs/boards.md`): the wiring is drawn for it.",
            choices=BOARDS,
        ),
    ] = Device.board
    converter: Annotated[
        str | None,
        key(
            "Analog-to-digital converter: `ads1115` has 16 bits and one conversion a sample, on any"
            " board; a board's own has 16 conversions a sample of 10 bits (`arduino`, on `nano` and"
            " `uno`), 12 bits (`pico`) or mV (`esp32`); its steps are part of the noise.",
            default="the board's own",
            choices=CONVERTERS,
        ),
    ] = None

    def check(self) -> Iterator[Problem]:
        """Yield a problem if the board does not have the converter."""
        try:
            find_board(self.board).check_converter(self.used_converter)
        except DeviceError as error:
            yield Problem(("converter",), error.problem, error.code, error.action, error.data)

    @property
    def used_converter(self) -> str:
        """The converter, which is the board's own if none is given."""
        return self.converter or find_board(self.board).converter


class WiresTable(Table, frozen=True):
    """Where wires leave the body, and how they are connected to printed traces."""

    exit: Annotated[
        tuple[str, ...] | None,
        key(
            "Regions in which both ends of every cord or trace leave the body, so that it goes out"
            " and comes back; `[]` allows any place.",
            default="any place; of printed traces, the regions that all poses hold",
        ),
    ] = None
    pad: Annotated[
        str | None,
        key(
            "Pads in which printed traces end, for a `screw` with a washer, an `eyelet` below a"
            " screw, a `spring-pin`, or conductive `thread` (`docs/printed-reference.md` has"
            " drawings).",
            default=f"`{next(iter(PADS))}` with printed traces",
            choices=PADS,
        ),
    ] = None


class DesignTable(Table, frozen=True):
    """What is found automatically."""

    sensors: Annotated[
        Count | None,
        key(
            "Number of cords in all; those that are not drawn are found. More cords distinguish"
            " more movements, and make more parts.",
            default="those drawn",
        ),
    ] = None
    planes: Annotated[
        Count | None,
        key(
            "Largest number of planes for cords that are found: fewer planes make fewer parts.",
            default="any",
        ),
    ] = None
    decoder: Annotated[
        str,
        key(
            "Map from signals to positions: `affine` in the signals; `quadratic`, also in their"
            " squares and products; `kernel`, any smooth function, better with many states and"
            " little noise; `auto` designs for each and takes the best on unseen states, or"
            " `affine` without any.",
            choices=(*DECODERS, "auto"),
        ),
    ] = "auto"
    prefer: Annotated[
        str,
        key(
            "Which layout to take: `simple`, of those within 25 % of the best as built the one"
            " with the fewest parts; or `accuracy`, the best that can be made.",
            choices=PREFERENCES,
        ),
    ] = PREFERENCES[0]
    parts: Annotated[
        Count | None,
        key(
            "Number of parts of the layout to take, of those that the report offers; the cords are"
            " not searched for again.",
            default="as `prefer` states",
        ),
    ] = None
    seed: Annotated[Count, key("Seed of the random choices in the search for cords.")] = 1
    searches: Annotated[
        Count | None,
        key(
            "Largest number of searches that a layout is chosen from: fewer are quicker, and find"
            " less.",
            default="15 divided by the cords, at least 5, and some in fewer planes",
        ),
    ] = None
