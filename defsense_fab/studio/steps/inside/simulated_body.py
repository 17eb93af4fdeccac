"""The simulated body of a device: its sections, its skin, and its shapes in all states."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ....core.arrays import Float
from ....core.curve import Plane, sample_path
from ....core.device.device import Sensor
from ....core.errors import DeviceError, LayoutError
from ....core.mesh import Surface
from ....workflow.design.body_section import BodySection
from ....workflow.design.layout_judge import LayoutJudge
from ....workflow.design.next_cord import NextCord, shortest_cord
from ....workflow.view import Arrays
from ...messages import inside as messages
from ...session.body_arrays import feature_edges
from ...session.cord_states import plane_of, rounded
from .color_range import ColorRange, range_of, round_range
from .quantities import COLOR_MAPS, QUANTITIES, UNKNOWN_COLOR, ShownQuantity
from .section_planes import box_middle, first_plane, first_state, plane_offsets
from .section_samples import SectionRequest, SectionSampler, nearest_drop

_MIN_GAIN_SPREAD = 0.03  # share of the largest gain

AnySection = messages.ShowSection | messages.ProbePoint


class SimulatedBody:
    """Computes sections of the body in its simulated states.

    Args:
        judge: Predicts the error of cords in these states.
        revision: Number of the simulation.

    Attributes:
        judge: The same judge.
        revision: The same number.
        body: Sections of the body.
    """

    def __init__(self, judge: LayoutJudge, revision: int) -> None:
        task = judge.task
        self.judge, self.revision = judge, revision
        self.body = BodySection(task.everything.locator, task.everything.fields, task.names)
        self._sampler = SectionSampler(self.body)
        self._fixed_ranges: dict[tuple[str, bytes], ColorRange] = {}

    def state(self) -> messages.InsideState:
        """Return what sections can show."""
        rest, task = self.body.skin[0], self.judge.task
        plane = first_plane(rest)
        labels = [_state_label(weights) for weights in task.weights]
        return messages.InsideState(
            is_ready=True,
            text="",
            revision=self.revision,
            states=[
                messages.StateInfo(name=name, label=label)
                for name, label in zip(task.names, labels, strict=True)
            ],
            first_state=first_state(task.weights),
            origin=rounded(plane.origin),
            axes=plane.axes.T.tolist(),
            middle=rounded(box_middle(rest)),
            size=self.body.size,
            short_cord=shortest_cord(task),
            **STATIC,
        )

    def prepare(self) -> None:
        """Compute the cached properties that the first search needs."""
        problem = self.judge.task.everything
        problem.depth, problem.grid  # noqa: B018 - properties that cache their values

    @cached_property
    def skin(self) -> Arrays:
        """The surface at rest."""
        rest, faces = self.body.skin
        edges = feature_edges(Surface(rest, faces))
        return Arrays(
            name="skin",
            arrays={"rest": rest, "faces": faces, "edges": edges},
            facts={"revision": self.revision},
        )

    def shape(self, state: int, sensors: Sequence[Sensor]) -> Arrays:
        """Return the surface and the cords in a state. Raises LayoutError."""
        self._check_state(state)
        paths = [sample_path(sensor) for sensor in sensors]
        points = np.concatenate([np.zeros((0, 3)), *paths])
        cords = self.body.carried(points, state) if len(points) else points
        return Arrays(
            name="shape",
            arrays={"vertices": self.body.carried(self.body.skin[0], state), "cords": cords},
            facts={"revision": self.revision, "counts": [len(path) for path in paths]},
        )

    def section(
        self,
        request: messages.ShowSection,
        sensors: Sequence[Sensor],
        next_cord: NextCord | None,
    ) -> Arrays:
        """Return a section with its values. Raises DefsenseError."""
        shown = QUANTITIES[request.quantity]
        section = self._request(request, sensors, next_cord)
        sample = self._sampler.sample(section, is_fine=request.detail == "fine")
        values = shown.to_shown(sample.numbers)
        known = values[np.isfinite(values)]
        if request.is_range_fixed and shown.engine.quantity is not None:
            color_range = self._fixed_range(shown, section)
        else:
            drop = section.quantity.quantity is None and next_cord is not None
            numbers = next_cord.drop if drop and next_cord is not None else values
            color_range = range_of(numbers, has_zero=not drop or _is_nearly_equal(numbers))
        lowest, highest = plane_offsets(section.plane, self.body.skin[0])[1:]
        return Arrays(
            name="section",
            arrays={
                "vertices": sample.positions,
                "rest": sample.section.points,
                "triangles": sample.section.triangles,
                "values": values,
            },
            facts={
                "revision": self.revision,
                "low": color_range.low,
                "high": color_range.high,
                "step": color_range.step,
                "smallest": float(known.min()) if len(known) else None,
                "largest": float(known.max()) if len(known) else None,
                "lowest": lowest,
                "highest": highest,
            },
        )

    def probe(
        self,
        request: messages.ProbePoint,
        sensors: Sequence[Sensor],
        next_cord: NextCord | None,
    ) -> messages.PointNumbers:
        """Return the numbers of a point. Raises DefsenseError."""
        rest = np.array(request.at, float)
        if rest.shape != (3,) or not np.isfinite(rest).all():
            raise LayoutError("a point needs three finite coordinates", code="invalid-point")
        section = self._request(request, sensors, next_cord)
        at = self.judge.task.everything.locator.find(rest[None])
        values = self._sampler.probe_at(section, at, rest)
        along, largest, smallest = (100 * (s - 1) for s in values.stretches.values())
        drop = np.nan if next_cord is None else nearest_drop(next_cord, rest[None])[0]
        return messages.PointNumbers(
            rest=rounded(rest),
            position=rounded(values.position),
            along=along,
            largest=largest,
            smallest=smallest,
            deviation=100 * float(np.sqrt(max(values.variance, 0.0))),
            drop=float(drop) if np.isfinite(drop) else None,
        )

    def _request(
        self, request: AnySection, sensors: Sequence[Sensor], next_cord: NextCord | None
    ) -> SectionRequest:
        self._check_state(request.state)
        path = None
        if request.cord:
            path = sample_path(_cord(sensors, request.cord))
        return SectionRequest(
            plane=plane_of(request.origin, request.axes),
            state=request.state,
            quantity=QUANTITIES[request.quantity].engine,
            angle=float(np.radians(request.angle)),
            path=path,
            cords=(),
            next_cord=next_cord,
            has_state_range=False,
        )

    def _check_state(self, state: int) -> None:
        if not 0 <= state < len(self.body.names):
            raise LayoutError(
                f"there is no state {state}; there are {len(self.body.names)}", code="no-state"
            )

    def _fixed_range(self, shown: ShownQuantity, section: SectionRequest) -> ColorRange:
        """Return the range of a quantity in the whole body and in all states."""
        quantity = shown.engine.quantity
        assert quantity is not None
        direction = section.direction(self.body.middles)
        key = (shown.info.name, direction.tobytes() if quantity.kind == "along" else b"")
        if key not in self._fixed_ranges:
            span = np.array(self.body.span(quantity, None, direction))
            low, high = shown.to_shown(shown.engine.to_shown(span)).tolist()
            self._fixed_ranges = {key: round_range(low, high)}  # the last one alone
        return self._fixed_ranges[key]


#: What the page gets also before a simulation.
STATIC: Any = {
    "quantities": [shown.info for shown in QUANTITIES.values()],
    "color_maps": COLOR_MAPS,
    "unknown_color": UNKNOWN_COLOR,
}


def empty_state(revision: int, text: str) -> messages.InsideState:
    """Return the state of a device whose poses are not simulated."""
    plane = Plane.from_normal(np.zeros(3), np.eye(3)[2], np.eye(3)[0])
    return messages.InsideState(
        is_ready=False,
        text=text,
        revision=revision,
        states=[],
        first_state=0,
        origin=rounded(plane.origin),
        axes=plane.axes.T.tolist(),
        middle=[0.0, 0.0, 0.0],
        size=1.0,
        short_cord=0.0,
        **STATIC,
    )


def _is_nearly_equal(drop: Float) -> bool:
    """Return whether gains are so similar that their differences must not look large."""
    known = drop[np.isfinite(drop)]
    return not len(known) or float(np.ptp(known)) < _MIN_GAIN_SPREAD * float(np.abs(known).max())


def _state_label(weights: Any) -> str:
    if not weights:
        return "At rest"
    return " + ".join(f"{pose} {100 * weight:.0f} %" for pose, weight in weights.items())


def _cord(sensors: Sequence[Sensor], name: str) -> Sensor:
    for sensor in sensors:
        if sensor.name == name:
            return sensor
    raise DeviceError(
        f"there is no cord {name!r} any more", code="not-in-device", table="sensor", name=name
    )
