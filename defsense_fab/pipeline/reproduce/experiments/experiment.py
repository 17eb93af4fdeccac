"""What an experiment compares, how it is recorded, and which numbers it is to be held against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ....core.arrays import Float

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


@dataclass(frozen=True)
class LayoutChoice:
    """A layout by its `name`, with a `title` for readers; `cords` is one of CORDS, `count` their
    number where it is not that of `device.toml`, `file` the one beside it with other [[sensors]];
    `design` are keys that are laid over those of [design]."""

    name: str
    title: str
    cords: str
    count: int | None = None
    file: str | None = None
    design: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class SessionPlan:
    """A recorded session: pictures of the test (`frames`), the last `share` of all, `rate` of them
    a second, by rendered `cameras` ("webcam,cameras=3"; empty: by cameras that are numbers alone);
    how many `tags` of `tag_size` mm lie on the skin, only on one `side` (3,) where one is given;
    how many `units` are built and recorded."""

    frames: int = 2040
    rate: float = 15.0
    cameras: str = "webcam"
    tags: int = 20
    tag_size: float = 8.0
    side: Float | None = None
    units: int = 3
    share: float = 0.3

    @property
    def seconds(self) -> float:
        """How long a session is."""
        return self.frames / self.share / self.rate


@dataclass(frozen=True)
class QuickPlan:
    """What is taken at a small size: `edge_length` of the mesh, mm (None: the device's), `frames`
    of the test and `units`."""

    edge_length: float | None = None
    frames: int = 900
    units: int = 1


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


@dataclass(frozen=True)
class CordPlan:
    """A cord on bending specimens of these `lengths` at these `radii`, mm, laid `rounds` times; the
    slope `k_res` that the twin's cord has; kinds of cords by name that are stretched twice by
    `strain` of the `sample` length (mm), as in the paper's Fig. 10."""

    lengths: tuple[float, ...]
    radii: tuple[float, ...]
    rounds: int
    k_res: float
    kinds: tuple[str, ...]
    strain: float
    sample: float


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
            session = replace(session, frames=small.frames, units=small.units, cameras="")
        if units is not None:
            session = replace(session, units=units)
        return replace(
            self, session=session, quick=quick,
            edge_length=small.edge_length if quick else None, searches=_SEARCHES if quick else None,
        )  # fmt: skip

    def layout(self, name: str) -> LayoutChoice:
        """By its name, which is one of them."""
        return next(x for x in self.layouts if x.name == name)
