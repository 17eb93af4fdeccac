"""Plan the actions that assemble a device: what each requires, and what it must precede."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ...store.manifest import CutCord, Manifest, WireRecord
from .actions import Action, ActionKind, ExpectedResistance, Fact

#: Relative tolerance of the resistance of pieces of one kind of cord.
BATCH_TOLERANCE = 0.1
#: Relative tolerance of the resistance of printed traces, whose resistivity is hardly known.
TRACE_TOLERANCE = 0.5
#: Relative tolerance of an installed cord's resistance, against its loose resistance times the
#: predicted ratio.
INSTALLED_TOLERANCE = 0.05


def late_end(cord: CutCord) -> int | None:
    """Return the end of a cord that is crimped after all its joints are closed, or None."""
    return next((k for k, e in enumerate(cord.ends) if e.after is not None), None)


def joint_of_end(cord: CutCord, end: int) -> int | None:
    """Return the joint that holds an end of a cord, or None if no joint holds the cord."""
    return cord.stretches[-end].joint if cord.stretches else None


def last_joint(cord: CutCord) -> int:
    """Return the joint that completes a cord; -1 if no joint holds it."""
    return max((*(s.joint for s in cord.stretches), *(j for j, _ in cord.drawn)), default=-1)


def sliding_wires(manifest: Manifest, j: int) -> list[WireRecord]:
    """Return the wires in joint j that must still slide when a later joint closes."""
    return [
        end.wire
        for cord in manifest.cords
        for end in cord.ends
        if j in end.wire.joints and max(end.wire.crosses, default=-1) > j
    ]


def joints_that_stretch(cord: CutCord) -> tuple[int, ...]:
    """Return the joints that are still open when both ends of a cord are held, one on each side.

    While such a joint is open, the cord is stretched further.
    """
    if late_end(cord) is not None or not cord.stretches:
        return ()
    last = max(s.joint for s in (cord.stretches[0], cord.stretches[-1]))
    return tuple(j for j, _ in cord.drawn if j > last)


def sliding_end(cord: CutCord, joint: int, stretch: int) -> int:
    """Return the end towards which a cord must be pulled while a joint draws it together.

    The cord slides on the side whose end is free at that time, else on the side that was inserted
    last.

    Args:
        cord: The cord.
        joint: The joint that is being closed.
        stretch: Index of the cord's stretch that starts behind that joint.
    """
    late = late_end(cord)
    if late is not None:
        return late
    sides = cord.stretches[:stretch], cord.stretches[stretch:]
    is_free = [any(s.joint > joint for s in side) for side in sides]
    last_joint = [max(s.joint for s in side) for side in sides]
    return max((0, 1), key=lambda k: (is_free[k], last_joint[k]))


def last_joint_while_wet(manifest: Manifest, joint: int) -> int | None:
    """Return the last joint that must be closed while the glue of `joint` is still wet, or None.

    Bonded cords in `joint` must slide until that last joint has drawn them together.
    """
    if manifest.assembly_of_cords != "bonded":
        return None
    later = [
        j
        for cord in manifest.cords
        for j, _ in cord.drawn
        if joint < j and any(s.joint == joint for s in cord.stretches)
    ]
    return max(later, default=None)


def inner_joints(manifest: Manifest, joint: int) -> list[int]:
    """Return the joints whose parts are all on one side of `joint`; they are closed before it."""
    sides = [set(side) for side in manifest.assembly[joint].join]
    assemblies = [{*s.join[0], *s.join[1]} for s in manifest.assembly]
    return [
        i for i, whole in enumerate(assemblies) if i != joint and any(whole <= s for s in sides)
    ]


def expect_loose(cord: CutCord) -> ExpectedResistance:
    """Return the resistance that a cord should have before it is inserted."""
    return _with_tolerance(cord.sensor, cord.resistance_before)


def expect_installed(cord: CutCord) -> ExpectedResistance:
    """Return the resistance that a cord should have in the device at rest."""
    return _with_tolerance(cord.sensor, cord.resistance)


def _with_tolerance(
    cord: str, ohm: float, tolerance: float = BATCH_TOLERANCE
) -> ExpectedResistance:
    return ExpectedResistance(cord, ohm, (1 - tolerance) * ohm, (1 + tolerance) * ohm)


def plan_actions(manifest: Manifest) -> list[Action]:
    """Return all actions that assemble a device, in the preferred order.

    The preferred order need not be possible: `actions.order_actions` finds one that is.
    """
    return _Planner(manifest).actions


class _Planner:
    """Collects the actions of one device."""

    def __init__(self, manifest: Manifest) -> None:
        self._manifest = manifest
        self._cords = {c.sensor: c for c in manifest.cords}
        self._is_bonded = manifest.assembly_of_cords == "bonded"
        self.actions: list[Action] = []
        self._plan_printing()
        if manifest.traces:
            for cord in manifest.cords:
                self._plan_pads(cord)
            self._connect()
            return
        for cord in manifest.cords:
            self._prepare_cord(cord)
        for cord in (c for c in manifest.cords if not c.stretches):
            self._thread_cord(cord)
        for j in range(len(manifest.assembly)):
            self._plan_joint(j)
        self._connect()

    def _add(
        self,
        kind: ActionKind,
        requires: Iterable[Fact],
        effects: Iterable[Fact],
        must_precede: Iterable[Fact] = (),
        **details: Any,
    ) -> None:
        """Add an action; `details` are further fields of `Action`."""
        details["requires"], details["effects"] = frozenset(requires), frozenset(effects)
        self.actions.append(Action(kind, must_precede=frozenset(must_precede), **details))

    def _plan_printing(self) -> None:
        if self._manifest.casting is None:
            self._add(ActionKind.PRINT, (), {("printed",)})
        else:
            self._add(ActionKind.PRINT, (), {("moulds printed",)})
            self._add(ActionKind.CAST, {("moulds printed",)}, {("printed",)})
        if self._manifest.pins:
            self._add(ActionKind.TRY_PINS, {("printed",)}, {("pins tried",)})
        if self._manifest.assembly:
            pins_tried = {("pins tried",)} if self._manifest.pins else set()
            self._add(ActionKind.FACES, {("printed",), *pins_tried}, {("faces",)})

    def _plan_pads(self, cord: CutCord) -> None:
        """Connect wires to the pads of a printed trace, and measure it."""
        name = cord.sensor
        expected = (_with_tolerance(name, cord.resistance, TRACE_TOLERANCE),)
        pads: Fact = ("connected", name)
        self._add(ActionKind.PADS, {("printed",)}, {pads}, cord=name, expected=expected)

    def _prepare_cord(self, cord: CutCord) -> None:
        """Prepare a cord at the bench; both wires are crimped unless one end must wait."""
        name, late = cord.sensor, late_end(cord)
        is_threaded = not cord.stretches
        first = 0 if late is None else 1 - late
        second = 1 - first
        self._add(ActionKind.CUT, (), {("cut", name)}, cord=name, amount=cord.cut_length)
        self._add(
            ActionKind.CRIMP, {("cut", name)}, {("crimped", name, first)}, cord=name, end=first
        )
        self._add(
            ActionKind.MARK,
            {("crimped", name, first)},
            {("marked", name)},
            cord=name,
            end=second,
            amount=cord.unstretched,
        )
        if late is None and not is_threaded:
            self._crimp_second_end(cord, second)
            self._add(
                ActionKind.MEASURE,
                {("crimped", name, second)},
                {("measured loose", name)},
                {("inserted", name)},
                cord=name,
                expected=(expect_loose(cord),),
            )

    def _crimp_second_end(self, cord: CutCord, end: int, pulled_out: Fact | None = None) -> None:
        """Trim the second end at its mark, and crimp it: at the bench, or pulled out later."""
        name = cord.sensor
        requires = set() if pulled_out is None else {pulled_out}
        must_precede: set[Fact] = {("inserted", name)} if pulled_out is None else set()
        at = _details(cord, end, cord.ends[end].after, is_late=pulled_out is not None)
        trimmed: Fact = ("trimmed", name)
        trim_requires = {("marked", name), *requires}
        self._add(ActionKind.TRIM, trim_requires, {trimmed}, amount=cord.slack, **at)
        crimped: Fact = ("crimped", name, end)
        self._add(ActionKind.CRIMP, {trimmed, *requires}, {crimped}, must_precede, **at)

    def _thread_cord(self, cord: CutCord) -> None:
        """Push a cord through a channel that no joint opens, and crimp its end behind it."""
        name = cord.sensor
        self._add(
            ActionKind.THREAD,
            {("printed",), ("marked", name)},
            {("inserted", name)},
            cord=name,
        )
        self._finish_late_end(cord, 1, {("inserted", name)}, set())

    def _plan_joint(self, j: int) -> None:
        """Plan everything that is done while a joint is open, its gluing, and what follows it."""
        step = self._manifest.assembly[j]
        inner = inner_joints(self._manifest, j)
        wet = {i for i in inner if self._is_wet_until(i, j)}
        dry: set[Fact] = {("dry", i) if i in wet else ("set", i) for i in inner}
        self._add(
            ActionKind.DRY_FIT,
            {("faces",), *dry},
            {("dry", j)},
            {("closed", i) for i in (*wet, j)},
            joint=j,
        )
        if step.pins:
            self._add(ActionKind.PINS, {("dry", j)}, {("pins", j)}, {("closed", j)}, joint=j)
        before_closing: set[Fact] = {("dry", j), *({("pins", j)} if step.pins else set())}
        for i in inner:
            before_closing.add(("closed", i) if i in wet else ("set", i))
        for name in step.cords:
            if any(s.joint == j for s in self._cords[name].stretches):
                before_closing |= self._lay_cord(self._cords[name], j)
        for name, cord in self._cords.items():
            for end in (0, 1):
                if j in cord.ends[end].wire.joints:
                    before_closing |= self._route_wire(name, end, j)
        if not self._is_bonded:
            before_closing |= self._measure_joint(j, before_closing, ("closed", j))
        self._add(ActionKind.GLUE, before_closing, {("closed", j)}, joint=j)
        self._follow_joint(j)

    def _measure_joint(self, j: int, requires: set[Fact], must_precede: Fact) -> set[Fact]:
        """Measure the cords that joint j encloses; return what is true afterwards.

        Held cords are measured in the joint that is closed without glue, as it can be opened again.
        Bonded cords are measured while the glue is wet, and only once they are complete.
        """
        finished_cords = self._cords_finished_by(j)
        unfinished_cords = [] if self._is_bonded else self._cords_continued_after(j)
        if not finished_cords and not unfinished_cords:
            return set()
        self._add(
            ActionKind.MEASURE,
            requires,
            {("measured", j)},
            {must_precede},
            joint=j,
            expected=tuple(expect_installed(c) for c in finished_cords),
            steady=tuple(c.sensor for c in unfinished_cords),
        )
        return {("measured", j)}

    def _is_wet_until(self, i: int, j: int) -> bool:
        """Return whether joint i, or one inside it, must not have set when joint j is closed."""
        joints = (i, *inner_joints(self._manifest, i))
        return any(self._last_of_wet_chain(k) >= j for k in joints)

    def _last_of_wet_chain(self, i: int) -> int:
        """Return the last of the joints that must follow joint i without a pause."""
        last = last_joint_while_wet(self._manifest, i)
        return -1 if last is None else max(last, self._last_of_wet_chain(last))

    def _lay_cord(self, cord: CutCord, j: int) -> set[Fact]:
        """Insert the stretch of a cord in a joint; return what must be true before it closes."""
        name = cord.sensor
        ends_here = {end for end in (0, 1) if joint_of_end(cord, end) == j}
        early_ends = {e for e in ends_here if cord.ends[e].after is None}
        requires: set[Fact] = {("marked", name), ("dry", j)}
        requires |= {("crimped", name, e) for e in early_ends}
        if self._manifest.assembly[j].pins:
            requires.add(("pins", j))
        joints = [s.joint for s in cord.stretches]
        effects: set[Fact] = {("inserted", name, j)}
        if j == max(joints):
            effects |= {("inserted", name)}
        self._add(ActionKind.LAY, requires, effects, {("closed", j)}, joint=j, cord=name)
        before_closing: set[Fact] = {("inserted", name, j)}
        ready: Fact = ("inserted", name, j)
        free_ends = [e for e in sorted(early_ends) if cord.ends[e].joint == "free"]
        is_stretched = bool(cord.prestretch) and j == max(joints) and late_end(cord) is None
        if is_stretched:
            # One end must be held before the cord is stretched from the other.
            free_count = sum(e.joint == "free" for e in cord.ends)
            if free_ends and (free_count > 1 and len(ends_here) > 1):
                ready = self._glue_end(cord, free_ends.pop(0), j, ready)
                before_closing.add(ready)
            requires = {("inserted", name), ready}
            ready = ("stretched", name)
            self._add(
                ActionKind.STRETCH,
                requires,
                {ready},
                {("closed", j)},
                joint=j,
                cord=name,
                amount=cord.between_ferrules - cord.unstretched,
            )
            before_closing.add(ready)
        for end in free_ends:
            before_closing.add(self._glue_end(cord, end, j, ready))
        return before_closing

    def _glue_end(self, cord: CutCord, end: int, j: int | None, ready: Fact) -> Fact:
        """Glue an end that no pocket holds, and let it set; return the fact that it has set.

        In a joint this is done while the joint is open.
        """
        name = cord.sensor
        is_late = cord.ends[end].after is not None or not cord.stretches
        must_precede: set[Fact] = set() if is_late or j is None else {("closed", j)}
        at = _details(cord, end, j, is_late)
        glued, is_set = ("end glued", name, end), ("end set", name, end)
        self._add(ActionKind.GLUE_END, {ready}, {glued}, must_precede, **at)
        self._add(ActionKind.SET_END, {glued}, {is_set}, **at)
        return is_set

    def _route_wire(self, name: str, end: int, j: int) -> set[Fact]:
        """Insert a wire into its groove in a joint; return what must be true before it closes."""
        requires: set[Fact] = {("crimped", name, end), ("dry", j)}
        if joint_of_end(self._cords[name], end) == j:
            requires.add(("inserted", name, j))
        effects: set[Fact] = {("wire in", name, end, j)}
        self._add(
            ActionKind.WIRE,
            requires,
            effects,
            {("closed", j), ("connected",)},
            joint=j,
            cord=name,
            end=end,
        )
        return effects

    def _follow_joint(self, j: int) -> None:
        """Let a closed joint set, and finish the ends that waited for it."""
        wet_until = last_joint_while_wet(self._manifest, j)
        requires: set[Fact] = {("closed", j)}
        if self._is_bonded:
            requires |= self._measure_joint(j, {("closed", j)}, ("set", j))
        if wet_until is not None:
            is_measured = self._cords_finished_by(wet_until)
            requires.add(("measured", wet_until) if is_measured else ("closed", wet_until))
        self._add(ActionKind.SET, requires, {("set", j)}, joint=j)
        for cord in self._manifest.cords:
            late = late_end(cord)
            if late is not None and cord.ends[late].after == j:
                ready: set[Fact] = {("closed", j), ("inserted", cord.sensor)}
                must_precede: set[Fact] = set()
                if self._is_bonded:
                    must_precede = {("set", s.joint) for s in cord.stretches}
                else:
                    ready |= {("set", j)}
                self._finish_late_end(cord, late, ready, must_precede)

    def _cords_finished_by(self, j: int) -> list[CutCord]:
        """Return the cords that are in their final place, with both wires, when joint j closes."""
        finished = []
        for cord in self._manifest.cords:
            is_in_place = bool(cord.stretches) and last_joint(cord) <= j
            is_crimped = late_end(cord) is None or max(e.after or 0 for e in cord.ends) < j
            if is_in_place and is_crimped:
                finished.append(cord)
        return finished

    def _cords_continued_after(self, j: int) -> list[CutCord]:
        """Return the cords with both wires that joint j can pinch and a later one completes."""
        return [
            cord
            for cord in self._manifest.cords
            if late_end(cord) is None
            and last_joint(cord) > j
            and (
                any(s.joint == j for s in cord.stretches)
                or any(i == j for i, _ in cord.drawn)
                or any(j in (*end.wire.joints, *end.wire.crosses) for end in cord.ends)
            )
        ]

    def _finish_late_end(
        self, cord: CutCord, end: int, ready: set[Fact], must_precede: set[Fact]
    ) -> None:
        """Pull an end out of its mouth, crimp it there, and let it back in."""
        name, j = cord.sensor, cord.ends[end].after
        at = _details(cord, end, j, is_late=True)
        pulled_out: Fact = ("out", name)
        requires = {("marked", name), *ready}
        elongation = cord.between_ferrules - cord.unstretched
        self._add(ActionKind.PULL, requires, {pulled_out}, must_precede, amount=elongation, **at)
        self._crimp_second_end(cord, end, pulled_out)
        last: Fact = ("in place", name)
        self._add(ActionKind.SEAT, {("crimped", name, end)}, {last}, must_precede, **at)
        if cord.ends[end].joint == "free":
            last = self._glue_end(cord, end, j, last)
        self._add(
            ActionKind.MEASURE,
            {last},
            {("measured in place", name)},
            must_precede,
            joint=j,
            cord=name,
            is_late=True,
            expected=(expect_installed(cord),),
        )

    def _connect(self) -> None:
        everything = {fact for action in self.actions for fact in action.effects}
        self._add(
            ActionKind.CONNECT,
            everything,
            {("connected",)},
            expected=tuple(expect_installed(c) for c in self._manifest.cords),
        )
        if self._manifest.cords:
            self._add(ActionKind.CHECK, {("connected",)}, {("checked",)})


def _details(cord: CutCord, end: int, joint: int | None, is_late: bool) -> dict[str, Any]:
    """Return the fields of an action at an end of a cord."""
    return {"joint": joint, "cord": cord.sensor, "end": end, "is_late": is_late}
