"""What an experiment compares, how it is recorded, and the paper's numbers: `experiment.toml`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import msgspec
from msgspec import Meta, structs

from ...core.response import JIG_RADII_MM
from ...core.schema.declare import (
    Positive,
    Problem,
    Table,
    Vector,
    key,
    missing,
    unknown_choice,
)
from ...core.storage.file_names import fold_name, name_problem
from ...twin.electronics.rubber_cords import CORD_KINDS
from ...twin.filming.camera_kinds import CAMERA_KINDS

#: How the cords of a layout are placed.
MANUAL, VISUAL, DRAWN, OPTIMISED = "manual", "visual", "drawn", "optimised"
CORDS = (MANUAL, VISUAL, DRAWN, OPTIMISED)
#: Quantities of a layout; the last one is predicted by the design alone.
RECOGNIZED, PREDICTED = "told_apart", "predicted"
QUANTITIES = ("rmse", "peak", "average_peak", RECOGNIZED, PREDICTED)
#: Quantities of cords alone; the first ones only of the kind that is bent on specimens.
BENT_QUANTITIES = ("k_res", "interval")
CORD_QUANTITIES = (*BENT_QUANTITIES, "hysteresis", "repeatability")
#: Decoder: the paper's, or the one that training chooses.
AFFINE, CHOSEN = "affine", "chosen"

#: Searches for cords of a quick run; with fewer, none of their layouts may be one that can be made.
QUICK_SEARCHES = 3
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
                yield Problem((name,), text, "name-repeated", "Remove the repeated items")
        if len(set(self.radii)) < _MIN_RADII:
            text = f"needs at least {_MIN_RADII} different radii, not {len(set(self.radii))}"
            yield Problem(("radii",), text, "too-few-radii", "Add radii")


class PaperNumber(Table, frozen=True, kw_only=True):
    """A number that is reported, with the paper's."""

    layout: Annotated[
        str | None, key("Layout of the number.", default="required with `[[layouts]]`")
    ] = None
    cord: Annotated[
        str | None, key("Kind of cord of the number.", default="required with `[cords]`")
    ] = None
    quantity: Annotated[
        str,
        key("Quantity, as listed below.", choices=dict.fromkeys((*QUANTITIES, *CORD_QUANTITIES))),
    ]
    over: Annotated[
        str | None,
        key("Layout or cord by whose number it is divided.", default="none: not a ratio"),
    ] = None
    decoder: Annotated[
        str,
        key(
            "Decoder: the paper's (`affine`), or the one that training chooses.",
            choices=(AFFINE, CHOSEN),
        ),
    ] = CHOSEN
    paper: Annotated[float | None, key("Number in the paper.", default="none")] = None
    where: Annotated[
        str, key("Place of that number in the paper.", default="required with `paper`")
    ] = ""
    at_most: Annotated[float | None, key("Largest number that is expected.", default="any")] = None
    at_least: Annotated[float | None, key("Smallest number that is expected.", default="any")] = (
        None
    )
    why: Annotated[str, key("Reason why ours differs from the paper's.", default="none")] = ""

    def check(self) -> Iterator[Problem]:
        """Yield problems of keys that need or exclude each other."""
        if self.decoder == AFFINE and self.quantity == RECOGNIZED:
            text = f"{self.quantity} is a quantity of the chosen decoder"
            yield Problem(("decoder",), text, "key-not-applicable", "Remove it")
        if self.at_most is not None and self.at_least is not None:
            text = "one bound is enough"
            yield Problem(("at_least",), text, "keys-exclusive", "Remove this key or at_most")
        if self.paper is not None and not self.where.strip():
            text = "is missing: the place of the number in the paper"
            yield Problem(("where",), text, "key-missing", "Add it")

    @property
    def subject(self) -> str:
        """The layout, or the kind of cord, of the number."""
        return self.layout or self.cord or ""


class ExperimentFile(Table, frozen=True, kw_only=True):
    """All keys of `experiment.toml`."""

    schema: Annotated[Literal[1], key("Version of this format.")] = 1
    title: Annotated[str, key("Title of the experiment.")]
    figures: Annotated[tuple[str, ...], key("Figures and tables of the paper.")] = ()
    about: Annotated[str, key("What the experiment shows, in one or two sentences.")]
    layouts: Annotated[
        tuple[LayoutChoice, ...],
        key(
            "Layouts that are compared, in the order of the page.",
            default="required without `[cords]`",
        ),
    ] = ()
    session: Annotated[SessionPlan, key("How each built device is recorded.")] = msgspec.field(
        default_factory=SessionPlan
    )
    quick: Annotated[QuickPlan, key("What `--quick` uses instead.")] = msgspec.field(
        default_factory=QuickPlan
    )
    cords: Annotated[
        CordPlan | None,
        key("An experiment of cords alone.", default="required without `[[layouts]]`"),
    ] = None
    numbers: Annotated[tuple[PaperNumber, ...], key("Numbers that are reported.")] = ()

    def check(self) -> Iterator[Problem]:
        """Yield problems of the layouts or cords, and of names."""
        if bool(self.layouts) == (self.cords is not None):
            text = "an experiment is either of a device or of cords"
            action = "Give either [[layouts]] of a device to compare, or [cords]"
            yield Problem(("layouts",), text, "keys-exclusive", action)
            return
        names = [fold_name(layout.name) for layout in self.layouts]
        for position, layout in enumerate(self.layouts):
            if names[position] in names[:position]:
                path = ("layouts", position, "name")
                text = f"{layout.name!r} is used already"
                yield Problem(path, text, "name-repeated", "Choose another name")
        for position, number in enumerate(self.numbers):
            for problem in self._check_number(number):
                yield problem.below("numbers", position)

    def _check_number(self, number: PaperNumber) -> Iterator[Problem]:
        """Yield problems of a number's layout or cord, and of its quantity."""
        names: Sequence[str]
        quantities: Sequence[str]
        if self.cords is None:
            subject, other = "layout", "cord"
            names, quantities = [layout.name for layout in self.layouts], QUANTITIES
        else:
            subject, other = "cord", "layout"
            names, quantities = self.cords.kinds, CORD_QUANTITIES
        if getattr(number, other) is not None:
            text = f"this experiment has no {other}s"
            yield Problem((other,), text, "key-not-applicable", f"Use {subject}")
            return
        name, code = getattr(number, subject), f"unknown-{subject}"
        if name is None:
            yield missing(subject)
            return
        if name not in names:
            yield unknown_choice((subject,), name, names, subject, code)
        if number.quantity not in quantities:
            path = ("quantity",)
            yield unknown_choice(path, number.quantity, quantities, "quantity", "unknown-quantity")
        elif self.cords is not None and number.quantity in BENT_QUANTITIES:
            bent = self.cords.kinds[0]
            if {name, number.over} - {None, bent}:
                text = f"{number.quantity} applies only to {bent}, the kind on the specimens"
                yield Problem(("quantity",), text, "cord-not-bent")
        if number.over is not None and number.over not in names:
            yield unknown_choice(("over",), number.over, names, subject, code)
        elif number.over == name:
            text = f"the ratio of {name} to itself is 1"
            yield Problem(("over",), text, "ratio-to-itself", f"Name another {subject}")


@dataclass(frozen=True)
class Experiment:
    """An experiment of the paper, or of a user.

    Attributes:
        name: Name of its folder.
        folder: Folder with `experiment.toml`.
        file: Content of `experiment.toml`, with the session as it is recorded.
        quick: Whether the experiment is run at the small size, which takes minutes.
    """

    name: str
    folder: Path
    file: ExperimentFile
    quick: bool = False

    def at_size(self, *, quick: bool = False, units: int | None = None) -> Experiment:
        """Return the experiment at the small size, or with another number of units."""
        session, small = self.file.session, self.file.quick
        if quick:
            session = structs.replace(session, frames=small.frames, units=small.units, cameras="")
        if units is not None:
            session = structs.replace(session, units=units)
        return replace(self, file=structs.replace(self.file, session=session), quick=quick)

    @property
    def session(self) -> SessionPlan:
        """How each unit is recorded."""
        return self.file.session

    @property
    def edge_length(self) -> float | None:
        """Edge length of the mesh, mm; None for that of the device."""
        return self.file.quick.edge_length if self.quick else None
