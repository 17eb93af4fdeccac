"""What an experiment compares, how it is recorded, and the paper's numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import msgspec
from msgspec import Meta, structs

from ....core.response import JIG_RADII_MM
from ....core.schema.declare import Positive, Problem, Table, Vector, key, unknown_choice
from ....core.storage.file_names import name_problem
from ....twin.electronics.rubber_cords import CORD_KINDS
from ....twin.filming.camera_kinds import CAMERA_KINDS

#: How the cords of a layout come about.
MANUAL, VISUAL, DRAWN, OPTIMISED = "manual", "visual", "drawn", "optimised"
CORDS = (MANUAL, VISUAL, DRAWN, OPTIMISED)
#: Of a test, over units; the last of a design alone.
TOLD_APART, PREDICTED = "told_apart", "predicted"
QUANTITIES = ("rmse", "peak", "average_peak", TOLD_APART, PREDICTED)
#: Of cords alone (`cord_experiment.py`); these of the first kind, which is bent on specimens.
BENT_QUANTITIES = ("k_res", "interval")
CORD_QUANTITIES = (*BENT_QUANTITIES, "hysteresis", "repeatability")
#: Which decoder: the paper's, or that which the training's folds choose.
AFFINE, CHOSEN = "affine", "chosen"

#: For cords at a small size: with fewer, none of the layouts that are found may be one that can be
#: made.
_SEARCHES = 3
_MIN_RADII = 3
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*")
#: Names in the experiment's folder of results that are taken.
_TAKEN = ("simulated", "markers", "pictures")

_Frames = Annotated[int, Meta(ge=50, le=100_000)]
_Units = Annotated[int, Meta(ge=1, le=100)]
_SpecimenLength = Annotated[float, Meta(ge=50, le=400)]


class LayoutChoice(Table, frozen=True):
    """A layout of cords that an experiment compares."""

    name: Annotated[str, key("Name of the layout and of its folder: letters, digits, hyphens.")]
    title: Annotated[str, key("Title on the page.")]
    cords: Annotated[
        str,
        key(
            "How the cords are placed: `manual`, straight side by side in the middle plane;"
            " `visual`, straight where the strain is large and differs between poses; `drawn`, as"
            " in `[[sensors]]`; or `optimised`.",
            choices=CORDS,
        ),
    ]
    count: Annotated[
        Annotated[int, Meta(ge=1, le=50)] | None,
        key(
            "Number of cords.",
            default="required by `manual` and `visual`; else that of `device.toml`",
        ),
    ] = None
    file: Annotated[
        str | None,
        key(
            "TOML file next to `device.toml` whose `[[sensors]]` are `drawn`, or where the search"
            " for `optimised` cords starts.",
            default="`device.toml`",
        ),
    ] = None
    design: Annotated[
        dict[str, Any],
        key("Keys that replace those of `[design]` in `device.toml`.", default="none"),
    ] = msgspec.field(default_factory=dict)

    def check(self) -> Iterator[Problem]:
        """Yield problems of the name, and of keys that do not go with the kind of cords."""
        if not _NAME.fullmatch(self.name) or self.name in _TAKEN or name_problem(self.name):
            yield Problem(
                ("name",),
                f"{self.name!r} cannot be the name of a folder",
                "name-invalid",
                f"Use letters, digits and hyphens, and none of {', '.join(_TAKEN)}, or of Windows"
                " (con, nul, ...)",
            )
        if self.count is None and self.cords in (MANUAL, VISUAL):
            text = f"is missing: {self.cords} cords need their number"
            yield Problem(("count",), text, "key-missing", "Add it")
        if self.file is not None and self.cords not in (DRAWN, OPTIMISED):
            text = f"{self.cords} cords are not drawn"
            yield Problem(("file",), text, "key-not-applicable", "Remove it")
        elif self.count is not None and (self.cords == DRAWN or self.file is not None):
            text = "the number of drawn cords follows from the drawing"
            yield Problem(("count",), text, "key-not-applicable", "Remove it")


class SessionPlan(Table, frozen=True):
    """How each built device is recorded."""

    #: Share of all frames that are tested, the last ones.
    share: ClassVar[float] = 0.3

    frames: Annotated[_Frames, key("Frames of the test, the last 30 % of a session.")] = 2040
    rate: Annotated[Annotated[float, Meta(ge=5, le=60)], key("Frames a second.", unit="Hz")] = 15.0
    cameras: Annotated[
        str,
        key(
            "Kind of the rendered cameras, and their number if it is not 2, as in"
            ' `"webcam,cameras=3"`.'
        ),
    ] = "webcam"
    tags: Annotated[
        Annotated[int, Meta(ge=3, le=200)], key("Number of printed tags on the skin.")
    ] = 20
    tag_size: Annotated[Annotated[float, Meta(gt=2)], key("Side of a tag.", unit="mm")] = 8.0
    side: Annotated[
        Vector | None, key("Direction to the cameras.", default="tags on all sides")
    ] = None
    units: Annotated[
        _Units, key("Number of devices that are built, each moved by another hand.")
    ] = 3

    @property
    def seconds(self) -> float:
        """Duration of a session, s."""
        return self.frames / self.share / self.rate

    def check(self) -> Iterator[Problem]:
        """Yield problems of the cameras and of the direction to them."""
        kind, _, number = self.cameras.partition(",cameras=")
        if kind not in CAMERA_KINDS:
            noun, code = "kind of cameras", "unknown-camera-kind"
            yield unknown_choice(("cameras",), kind, CAMERA_KINDS, noun, code)
        elif number and not (number.isdecimal() and 1 <= int(number) <= 6):
            text = f"needs 1 to 6 cameras, not {self.cameras!r}"
            yield Problem(("cameras",), text, "out-of-range", f"Write {kind},cameras=2")
        if self.side is not None and not any(self.side):
            action = "Give the direction to the cameras, such as [0, -1, 1]"
            yield Problem(("side",), "must not be zero", "zero-vector", action)


class QuickPlan(Table, frozen=True):
    """What a quick run uses instead of the device's mesh and parts of the session."""

    edge_length: Annotated[
        Positive | None,
        key("Edge length of the mesh.", unit="mm", default="that of `device.toml`"),
    ] = None
    frames: Annotated[_Frames, key("Frames of the test.")] = 900
    units: Annotated[_Units, key("Number of devices that are built.")] = 1


@dataclass(frozen=True)
class PaperNumber:
    """The `quantity` of a layout (or cord), or its ratio to that of the one it is `over`; the
    `paper`'s number and `where` it stands; least and greatest that are expected; `why` ours is
    another one."""

    layout: str
    quantity: str
    over: str | None = None
    decoder: str = CHOSEN
    paper: float | None = None
    where: str = ""
    at_most: float | None = None
    at_least: float | None = None
    why: str = ""


class CordPlan(Table, frozen=True, kw_only=True):
    """Cords that are bent on specimens, and stretched in a machine."""

    lengths: Annotated[
        Annotated[tuple[_SpecimenLength, ...], Meta(min_length=1)],
        key("Lengths of the specimens.", unit="mm"),
    ]
    radii: Annotated[
        tuple[Positive, ...], key("Radii of the jigs, at least 3 different ones.", unit="mm")
    ] = tuple(float(radius) for radius in JIG_RADII_MM)
    rounds: Annotated[
        Annotated[int, Meta(ge=1, le=20)], key("Number of times that each radius is measured.")
    ] = 3
    k_res: Annotated[Positive, key("Slope of the response of the twin's cord.")]
    kinds: Annotated[
        tuple[str, ...],
        key(
            "Kinds of cords that are stretched twice; the first is bent on the specimens.",
            choices=CORD_KINDS,
        ),
    ] = tuple(CORD_KINDS)
    strain: Annotated[Positive, key("Largest strain of the stretched cords.")] = 0.1
    sample: Annotated[Positive, key("Length of the stretched cords.", unit="mm")] = 67.0

    def check(self) -> Iterator[Problem]:
        """Yield problems of lists with too few different items."""
        for name in ("kinds", "lengths"):
            items = getattr(self, name)
            if not items or len(set(items)) < len(items):
                text = "needs at least one item, and each only once"
                yield Problem((name,), text, "names-not-unique", "Remove what is repeated")
        if len(set(self.radii)) < _MIN_RADII:
            text = f"needs at least {_MIN_RADII} different radii, not {len(set(self.radii))}"
            yield Problem(("radii",), text, "too-few-radii", "Add radii")


@dataclass(frozen=True)
class Experiment:
    """By its `name`, in its `folder`: `title`, the paper's `figures`, what it is `about`; either
    `layouts` of a device with a `session`, or `cords`; the `numbers`. At a small size (`quick`) the
    mesh has edges of `edge_length` mm, and `searches` tells how many searches for cords there are;
    None is what the device asks for."""

    name: str
    folder: Path
    title: str
    figures: tuple[str, ...]
    about: str
    numbers: tuple[PaperNumber, ...]
    layouts: tuple[LayoutChoice, ...] = ()
    session: SessionPlan = field(default_factory=SessionPlan)
    small: QuickPlan = field(default_factory=QuickPlan)
    cords: CordPlan | None = None
    quick: bool = False
    edge_length: float | None = None
    searches: int | None = None

    def at_size(self, *, quick: bool = False, units: int | None = None) -> Experiment:
        """The same as it is run: small if `quick`, with so many `units`, if given."""
        session, small = self.session, self.small
        if quick:
            session = structs.replace(session, frames=small.frames, units=small.units, cameras="")
        if units is not None:
            session = structs.replace(session, units=units)
        return replace(
            self, session=session, quick=quick,
            edge_length=small.edge_length if quick else None, searches=_SEARCHES if quick else None,
        )  # fmt: skip

    def layout(self, name: str) -> LayoutChoice:
        """By its name, which is one of them."""
        return next(x for x in self.layouts if x.name == name)
