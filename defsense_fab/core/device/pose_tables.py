"""The tables `[[poses]]` and `[states]` of `device.toml`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from ..arrays import Float
from ..schema.declare import Problem, Table, Vector, key, unknown_choice
from ..storage.file_names import fold_name
from .device import Handle, PointDrag, Pose, RegionPressure, StatesSpec, SymmetryPlane
from .states import DEFAULT_RAMP, default_states, state_key

#: Largest movement (mm), load or stiffness; beyond, arithmetic overflows.
MAX_SIZE = 1e5
_MAX_NAME_LENGTH = 60  # letters

_Bounded = Annotated[float, Meta(ge=-MAX_SIZE, le=MAX_SIZE)]
_BoundedVector = tuple[_Bounded, _Bounded, _Bounded]
_Angle = Annotated[float, Meta(ge=-3600, le=3600)]
_Free = Literal["free"]
_Fraction = Annotated[float, Meta(gt=0, le=1)]


class RotationTable(Table, frozen=True):
    """How a handle turns its region."""

    axis: Annotated[Vector, key("Direction of the axis, of any length but zero.")]
    degrees: Annotated[
        _Angle | _Free,
        key(
            'Angle, by the right hand (270 degrees stay 270), or `"free"` for a hinge about'
            " `axis`.",
            unit="degrees",
            form='a number or "free"',
        ),
    ]
    about: Annotated[
        _BoundedVector | None,
        key(
            "Point about which the region turns.",
            unit="mm",
            default="middle of the bounding box of the region's nodes",
        ),
    ] = None

    def check(self) -> Iterator[Problem]:
        """Yield the problem of an axis without a direction."""
        if not any(self.axis):
            yield _zero("axis")

    @property
    def vector(self) -> Float:
        """Rotation vector (3,) rad; zero where the angle is free."""
        if isinstance(self.degrees, str):
            return np.zeros(3)
        return np.asarray(unit_vector(self.axis) * np.deg2rad(self.degrees))


class HandleTable(Table, frozen=True):
    """A region that a pose moves rigidly."""

    region: Annotated[str, key("Region that moves rigidly.")]
    rotate: Annotated[
        RotationTable | _Free | None,
        key(
            'Rotation about an axis, or `"free"`: the region turns until no moment is left.',
            default="no rotation",
            form='"free" or { axis = [x, y, z], degrees = 30 }',
        ),
    ] = None
    translate: Annotated[
        tuple[_Bounded | _Free, _Bounded | _Free, _Bounded | _Free] | _Free,
        key(
            'Translation; each number may be `"free"`, and `"free"` alone is all three: the region'
            " moves to where no force is left.",
            unit="mm",
            form='"free" or [x, y, z], where each may be "free"',
        ),
    ] = (0.0, 0.0, 0.0)

    @property
    def moves(self) -> bool:
        """Whether a rotation or translation is prescribed that is not zero."""
        numbers = [v for v in self.translate if not isinstance(v, str)]  # none in "free"
        turns = isinstance(self.rotate, RotationTable) and bool(self.rotate.vector.any())
        return turns or any(numbers)

    def record(self) -> Handle:
        """Return the handle with its vectors."""
        rotate = self.rotate if isinstance(self.rotate, RotationTable) else None
        free_axes = np.eye(3) if self.rotate == "free" else np.zeros((0, 3))
        if rotate is not None and rotate.degrees == "free":
            free_axes = unit_vector(rotate.axis)[None]
        shifts = ("free",) * 3 if isinstance(self.translate, str) else self.translate
        return Handle(
            self.region,
            np.zeros(3) if rotate is None else rotate.vector,
            np.array([np.nan if v == "free" else float(v) for v in shifts]),
            free_axes,
            None if rotate is None or rotate.about is None else np.array(rotate.about),
        )


class DragTable(Table, frozen=True):
    """A spring that pulls at a point."""

    at: Annotated[_BoundedVector, key("Point that is pulled.", unit="mm")]
    by: Annotated[
        _BoundedVector,
        key("Where to, from there; a mixture of poses scales it.", unit="mm"),
    ]
    stiffness: Annotated[
        Annotated[float, Meta(gt=0, le=MAX_SIZE)],
        key("Stiffness of the spring; a mixture of poses keeps it.", unit="N/mm"),
    ] = 1.0


class PressureTable(Table, frozen=True):
    """A pressure on the surface in a region."""

    region: Annotated[str, key("Region whose surface is loaded.")]
    value: Annotated[
        _Bounded,
        key("Pressure; it follows the surface, and positive pushes inwards.", unit="MPa"),
    ]


class SymmetryTable(Table, frozen=True):
    """A region whose nodes stay in their plane."""

    region: Annotated[str, key("Flat region whose nodes stay in their plane.")]
    normal: Annotated[Vector, key("Normal of the plane, of any length but zero.")]

    def check(self) -> Iterator[Problem]:
        """Yield the problem of a normal without a direction."""
        if not any(self.normal):
            yield _zero("normal")


class PoseTable(Table, frozen=True):
    """A pose that the device senses: it holds some regions, and moves or loads others."""

    name: Annotated[
        str,
        key("Name of up to 60 letters, digits, `-` and `_`; it names files, and `rest` is taken."),
    ]
    fixed: Annotated[tuple[str, ...], key("Regions that stay in place.")] = ()
    handles: Annotated[tuple[HandleTable, ...], key("Regions that move.")] = ()
    gravity: Annotated[
        _BoundedVector | None,
        key(
            "Direction and size of gravity, as `[0, 0, -1]`.",
            unit="g",
            default="none",
        ),
    ] = None
    drags: Annotated[tuple[DragTable, ...], key("Springs that pull at points.")] = ()
    pressures: Annotated[tuple[PressureTable, ...], key("Pressures on the surface.")] = ()
    symmetry: Annotated[tuple[SymmetryTable, ...], key("Regions that stay in their plane.")] = ()

    def check(self) -> Iterator[Problem]:
        """Yield problems of the name, of regions with two roles, and of poses without a motion."""
        plain = self.name.replace("_", "").replace("-", "")
        if not plain.isalnum() or len(self.name) > _MAX_NAME_LENGTH:
            yield Problem(
                ("name",),
                f"{self.name!r} cannot be a file name",
                "name-invalid",
                f"Use up to {_MAX_NAME_LENGTH} letters, digits, - and _ only",
            )
        moved = [h.region for h in self.handles]
        if len(set(moved)) < len(moved):
            yield Problem(
                ("handles",), "two handles move the same region", "region-moved-twice", "Merge them"
            )
        if both := set(self.fixed) & set(moved):
            yield Problem(
                ("handles",),
                f"region {min(both)!r} is fixed and moved",
                "region-fixed-and-moved",
                "Remove it from one of the two",
                {"region": min(both)},
            )
        if not (self.fixed or self.handles or self.symmetry or self.drags):
            yield Problem(
                ("fixed",),
                "nothing holds the body in this pose",
                "pose-not-held",
                "Give at least one region that is fixed",
            )
        is_loaded = self.drags or self.pressures or any(self.gravity or ())
        if not is_loaded and not any(h.moves for h in self.handles):
            yield Problem(
                ("handles",),
                "nothing moves" if self.handles else "nothing moves or loads the body",
                "pose-without-motion",
                "Give a handle a rotation or a translation"
                if self.handles
                else "Add a handle that moves a region, a drag, a pressure or gravity",
            )

    def regions(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the path of each key that names a region, with the name."""
        for name in self.fixed:
            yield ("fixed",), name
        lists: Sequence[tuple[str, Sequence[HandleTable | PressureTable | SymmetryTable]]] = (
            ("handles", self.handles),
            ("pressures", self.pressures),
            ("symmetry", self.symmetry),
        )
        for table, rows in lists:
            for position, row in enumerate(rows):
                yield (table, position, "region"), row.region

    def record(self) -> Pose:
        """Return the pose with its vectors."""
        return Pose(
            self.name,
            tuple(self.fixed),
            tuple(h.record() for h in self.handles),
            tuple(SymmetryPlane(s.region, unit_vector(s.normal)) for s in self.symmetry),
            tuple(PointDrag(np.array(d.at), np.array(d.by), d.stiffness) for d in self.drags),
            tuple(RegionPressure(p.region, p.value) for p in self.pressures),
            np.array(self.gravity) if self.gravity else np.zeros(3),
        )


class StatesTable(Table, frozen=True):
    """Fractions and mixtures of the poses that are simulated."""

    ramp: Annotated[
        Annotated[tuple[_Fraction, ...], Meta(min_length=1)],
        key("Fractions of every pose that the design is optimized for."),
    ] = DEFAULT_RAMP
    mixtures: Annotated[
        list[dict[str, float]] | None,
        key(
            "Weights of poses that act at once, as `[{ bend_up = 0.5, twist = 0.5 }]`: rotation"
            " vectors and translations add up; a region that one pose leaves free and another"
            " translates moves on from where the first leaves it; `[]` is none.",
            default="poses that agree and are not opposite, in pairs, whole and half, without the"
            " states of `held_out`; mixtures that cannot be solved are left out with a note",
        ),
    ] = None
    held_out: Annotated[
        list[dict[str, float]] | None,
        key(
            "Mixtures to which neither paths nor decoder are fitted: they compare layouts, and"
            " give the reported error; `[]` is none.",
            default="pairs of a whole and a half, and three at once, without the states of"
            " `mixtures`; where no poses mix, each pose between its two largest fractions",
        ),
    ] = None

    def check(self) -> Iterator[Problem]:
        """Yield problems of fractions that coincide and of mixtures that are empty."""
        if len({f"{fraction:g}" for fraction in self._fractions}) < len(self._fractions):
            yield Problem(
                ("ramp",), "two fractions are nearly the same", "state-duplicate", "Remove one"
            )
        for name, mixtures in self._given:
            if not all(mixtures):
                yield Problem(
                    (name,),
                    "a mixture is empty",
                    "mixture-empty",
                    "Give at least one pose = weight",
                )
            elif not all(any(mixture.values()) for mixture in mixtures):
                yield Problem(
                    (name,),
                    "all weights of a mixture are zero, which is the rest state",
                    "mixture-zero",
                    "Give a weight that is not zero, or remove the mixture",
                )

    @property
    def _fractions(self) -> tuple[float, ...]:
        return tuple(float(fraction) for fraction in np.unique(self.ramp))

    @property
    def _given(self) -> tuple[tuple[str, Sequence[Mapping[str, float]]], ...]:
        return ("mixtures", self.mixtures or ()), ("held_out", self.held_out or ())

    def check_poses(self, poses: Sequence[str]) -> Iterator[Problem]:
        """Yield problems of mixtures that name poses which do not exist."""
        for key_name, mixtures in self._given:
            for position, mixture in enumerate(mixtures):
                for pose in mixture:
                    if pose not in poses:
                        path = (key_name, position, pose)
                        yield unknown_choice(path, pose, poses, "pose", "unknown-pose")

    def record(self, poses: Sequence[Pose]) -> StatesSpec:
        """Return the states; a list that is not given is proposed from what the `poses` span."""
        return default_states(poses, self._fractions, self.mixtures, self.held_out)


def repeated_states(states: StatesSpec, poses: Sequence[str]) -> Iterator[Problem]:
    """Yield a problem for each state that occurs twice.

    It would count double, or be both designed for and held out.
    """
    known = {state_key({name: fraction}) for name in poses for fraction in states.ramp}
    for name, mixtures in (("mixtures", states.mixtures), ("held_out", states.held_out)):
        for mixture in mixtures:
            state = state_key(mixture)
            if state in known:
                text = f"the state {dict(mixture)} occurs twice"
                yield Problem((name,), text, "state-duplicate", "Remove one")
            known.add(state)


def check_pose_names(poses: Sequence[PoseTable]) -> Iterator[Problem]:
    """Yield problems of names that are used twice, or that differ only in case."""
    names = ["rest"]
    for position, pose in enumerate(poses):
        same = next((n for n in names if fold_name(n) == fold_name(pose.name)), None)
        if same is not None:
            text = f"{pose.name!r} is used already"
            if same != pose.name:
                text = f"{pose.name!r} and {same!r} name the same file on Windows"
            yield Problem((position, "name"), text, "name-repeated", "Choose another name")
        names.append(pose.name)


def unit_vector(vector: Vector) -> Float:
    """Return a vector (3,) that is not zero with length 1, without overflow."""
    scaled = np.array(vector) / max(map(abs, vector))
    return np.asarray(scaled / np.linalg.norm(scaled))


def _zero(name: str) -> Problem:
    return Problem((name,), "must not be zero", "zero-vector", "Give a direction")
