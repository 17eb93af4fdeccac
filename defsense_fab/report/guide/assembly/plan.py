"""The actions that a device takes, with what each needs and bars, joint by joint."""

from __future__ import annotations

from ....store.manifest import CutCord, Manifest
from .actions import Action, Expected, Fact, Kind

# What follows for the hands from where cords lie: ends that wait, what slides, ohms.

#: How far pieces of one kind of cord may differ in resistance, and a cord from what it measured
#: before it was laid, times what laying makes of it.
BATCH, LAID = 0.1, 0.05


def anchored_later(cord: CutCord) -> int | None:
    """The end of a cord that is crimped only when all its joints are closed, if any."""
    return next((k for k, e in enumerate(cord.ends) if e.after is not None), None)


def joint_of(cord: CutCord, end: int) -> int | None:
    """The joint that an end lies in; None where the cord lies in none."""
    return cord.stretches[-end].joint if cord.stretches else None


def strained(cord: CutCord) -> tuple[int, ...]:
    """Joints that are still to be closed when both ends of a cord hold it on either side of them:
    it is stretched further as long as they are open."""
    if anchored_later(cord) is not None or not cord.stretches:
        return ()
    last = max(s.joint for s in (cord.stretches[0], cord.stretches[-1]))
    return tuple(j for j, _ in cord.drawn if j > last)


def sliding(cord: CutCord, joint: int, at: int) -> tuple[int, ...]:
    """The joints in which a cord has to slide while `joint` draws it together before its stretch
    `at`: those on the side whose end is free then, or else was laid last."""
    sides = cord.stretches[:at], cord.stretches[at:]
    late = anchored_later(cord)
    free = [any(s.joint > joint for s in side) for side in sides]
    last = [max(s.joint for s in side) for side in sides]
    chosen = max((0, 1), key=lambda k: (free[k], k == late, last[k]))
    return tuple(s.joint for s in sides[chosen] if s.joint < joint)


def wet_until(manifest: Manifest, i: int) -> int | None:
    """The joint up to which the glue of joint i must stay wet: bonded cords that lie in it have to
    slide until that draws them together."""
    if manifest.assembly_of_cords != "bonded":
        return None
    waits = [
        j
        for cord in manifest.cords
        for j, _ in cord.drawn
        if i < j and any(s.joint == i for s in cord.stretches)
    ]
    return max(waits, default=None)


def joints_within(manifest: Manifest, j: int) -> list[int]:
    """The joints whose parts are all on one side of this one: closed before it."""
    sides = [set(side) for side in manifest.assembly[j].join]
    wholes = [{*s.join[0], *s.join[1]} for s in manifest.assembly]
    return [i for i, w in enumerate(wholes) if i != j and any(w <= side for side in sides)]


def loose(cord: CutCord) -> Expected:
    """Before it is laid."""
    return _around(cord.sensor, cord.resistance_before)


def laid(cord: CutCord) -> Expected:
    """In the device at rest."""
    return _around(cord.sensor, cord.resistance)


def _around(cord: str, ohm: float) -> Expected:
    return Expected(cord, ohm, (1 - BATCH) * ohm, (1 + BATCH) * ohm)


def actions(manifest: Manifest) -> list[Action]:
    """All of them. The order that they are in is that wished for; `in_order` finds one that can
    be."""
    return _Plan(manifest).made


class _Plan:
    """Collects the actions of one device."""

    def __init__(self, manifest: Manifest) -> None:
        self._manifest = manifest
        self._cords = {c.sensor: c for c in manifest.cords}
        self._bonded = manifest.assembly_of_cords == "bonded"
        self.made: list[Action] = []
        self._print()
        for cord in manifest.cords:
            self._prepare(cord)
        for cord in (c for c in manifest.cords if not c.stretches):
            self._thread(cord)
        for j in range(len(manifest.assembly)):
            self._join(j)
        self._connect()

    def _add(
        self,
        kind: Kind,
        *,
        needs: set[Fact] | None = None,
        bars: set[Fact] | None = None,
        makes: set[Fact] | None = None,
        joint: int | None = None,
        cord: str | None = None,
        end: int | None = None,
        amount: float | None = None,
        expected: tuple[Expected, ...] = (),
        late: bool = False,
    ) -> None:
        self.made.append(
            Action(kind, joint, cord, end, frozenset(needs or ()), frozenset(bars or ()),
                   frozenset(makes or ()), amount, expected, late)
        )  # fmt: skip

    def _print(self) -> None:
        if self._manifest.casting is None:
            self._add(Kind.PRINT, makes={("printed",)})
        else:
            self._add(Kind.PRINT, makes={("moulds printed",)})
            self._add(Kind.CAST, needs={("moulds printed",)}, makes={("printed",)})
        if self._manifest.pins:
            self._add(Kind.TRY_PINS, needs={("printed",)}, makes={("pins tried",)})

    def _prepare(self, cord: CutCord) -> None:
        """At the bench: both wires are crimped where nothing keeps an end for later."""
        name, late = cord.sensor, anchored_later(cord)
        threaded = not cord.stretches
        first = 0 if late is None else 1 - late
        second = 1 - first
        self._add(Kind.CUT, cord=name, amount=cord.cut_length, makes={("cut", name)})
        self._add(Kind.CRIMP, cord=name, end=first, needs={("cut", name)},
                  makes={("crimped", name, first)})  # fmt: skip
        self._add(Kind.MARK, cord=name, end=second, amount=cord.unstretched,
                  needs={("crimped", name, first)}, makes={("marked", name)})  # fmt: skip
        if late is None and not threaded:
            self._second(cord, second, set(), bars={("laid", name)})
            self._add(Kind.MEASURE, cord=name, needs={("crimped", name, second)},
                      bars={("laid", name)}, makes={("measured loose", name)},
                      expected=(loose(cord),))  # fmt: skip

    def _second(self, cord: CutCord, end: int, needs: set[Fact], bars: set[Fact]) -> None:
        """Trim what is too much, and crimp."""
        name, after = cord.sensor, cord.ends[end].after
        late = bool(needs)
        self._add(Kind.TRIM, late=late, joint=after, cord=name, end=end, amount=cord.slack,
                  needs={("marked", name), *needs}, makes={("trimmed", name)})  # fmt: skip
        self._add(Kind.CRIMP, late=late, joint=after, cord=name, end=end,
                  needs={("trimmed", name), *needs}, bars=bars,
                  makes={("crimped", name, end)})  # fmt: skip

    def _thread(self, cord: CutCord) -> None:
        """A channel that no joint opens: the cord is pushed through it, and crimped behind."""
        name = cord.sensor
        self._add(Kind.THREAD, cord=name, needs={("printed",), ("marked", name)},
                  makes={("laid", name), ("in", name)})  # fmt: skip
        self._late_end(cord, 1, {("laid", name)}, set())

    def _join(self, j: int) -> None:
        step = self._manifest.assembly[j]
        before = joints_within(self._manifest, j)
        wet = {i for i in before if self._open(i, j)}
        dry: set[Fact] = {("dry", i) if i in wet else ("set", i) for i in before}
        tried: set[Fact] = {("pins tried",)} if self._manifest.pins else set()
        self._add(Kind.DRY_FIT, joint=j, needs={("printed",), *tried, *dry},
                  bars={("closed", i) for i in (*wet, j)}, makes={("dry", j)})  # fmt: skip
        if step.pins:
            self._add(Kind.PINS, joint=j, needs={("dry", j)}, bars={("closed", j)},
                      makes={("pins", j)})  # fmt: skip
        closing: set[Fact] = {("dry", j), *({("pins", j)} if step.pins else set())}
        for i in before:
            closing.add(("closed", i) if i in wet else ("set", i))
        for name in step.cords:
            if any(s.joint == j for s in self._cords[name].stretches):
                closing |= self._lay(self._cords[name], j)
        for name, cord in self._cords.items():
            for end in (0, 1):
                if j in cord.ends[end].wire.joints:
                    closing |= self._wire(name, end, j)
        self._add(Kind.GLUE, joint=j, needs=closing, makes={("closed", j)})
        self._after(j)

    def _open(self, i: int, j: int) -> bool:
        """Whether joint i, or one within it, must not have set when joint j is closed."""
        inner = (i, *joints_within(self._manifest, i))
        return any(self._wet_chain(k) >= j for k in inner)

    def _wet_chain(self, i: int) -> int:
        """The last of the joints that follow joint i in one go."""
        last = wet_until(self._manifest, i)
        return -1 if last is None else max(last, self._wet_chain(last))

    def _lay(self, cord: CutCord, j: int) -> set[Fact]:
        """Lay a stretch, and what follows from it in this joint; what must be done before the joint
        is closed."""
        name = cord.sensor
        here = {end for end in (0, 1) if joint_of(cord, end) == j}
        early = {e for e in here if cord.ends[e].after is None}
        needs: set[Fact] = {("marked", name), ("dry", j)}
        needs |= {("crimped", name, e) for e in early}
        if self._manifest.assembly[j].pins:
            needs.add(("pins", j))
        joints = [s.joint for s in cord.stretches]
        makes: set[Fact] = {("in", name, j)}
        if j == max(joints):
            makes |= {("laid", name), ("in", name)}
        self._add(Kind.LAY, joint=j, cord=name, needs=needs, bars={("closed", j)}, makes=makes)
        out: set[Fact] = {("in", name, j)}
        ready: Fact = ("in", name, j)
        free = [e for e in sorted(early) if cord.ends[e].joint == "free"]
        stretched = bool(cord.prestretch) and j == max(joints) and anchored_later(cord) is None
        if stretched:
            # One end must be held before the cord is stretched from the other.
            loose_ends = sum(e.joint == "free" for e in cord.ends)
            if free and (loose_ends > 1 and len(here) > 1):
                ready = self._glue_end(cord, free.pop(0), j, ready)
                out.add(ready)
            needs = {("laid", name), ready}
            ready = ("stretched", name)
            self._add(Kind.STRETCH, joint=j, cord=name, needs=needs, bars={("closed", j)},
                      makes={ready}, amount=cord.between_ferrules - cord.unstretched)  # fmt: skip
            out.add(ready)
        for end in free:
            out.add(self._glue_end(cord, end, j, ready))
        return out

    def _glue_end(self, cord: CutCord, end: int, j: int | None, ready: Fact) -> Fact:
        """Glue an end that no pocket holds, and let it set; what is true then. In a joint, while
        that is open."""
        name = cord.sensor
        late = cord.ends[end].after is not None or not cord.stretches
        open_joint: set[Fact] = set() if late or j is None else {("closed", j)}
        self._add(Kind.GLUE_END, late=late, joint=j, cord=name, end=end, needs={ready},
                  bars=open_joint, makes={("end glued", name, end)})  # fmt: skip
        self._add(
            Kind.SET_END, late=late, joint=j, cord=name, end=end,
            needs={("end glued", name, end)}, makes={("end set", name, end)},
        )  # fmt: skip
        return ("end set", name, end)

    def _wire(self, name: str, end: int, j: int) -> set[Fact]:
        """Lay a wire into its groove of this joint."""
        needs: set[Fact] = {("crimped", name, end), ("dry", j)}
        cord = self._cords[name]
        if joint_of(cord, end) == j:
            needs.add(("in", name, j))
        makes: set[Fact] = {("wire in", name, end, j)}
        self._add(Kind.WIRE, joint=j, cord=name, end=end, needs=needs,
                  bars={("closed", j), ("connected",)}, makes=makes)  # fmt: skip
        return makes

    def _after(self, j: int) -> None:
        """When the joint is closed: measure, wait, and finish what had to wait for it."""
        wet, done = wet_until(self._manifest, j), self._done_by(j)
        if done:
            self._add(Kind.MEASURE, joint=j, needs={("closed", j)}, bars={("set", j)},
                      makes={("measured", j)},
                      expected=tuple(laid(c) for c in done))  # fmt: skip
        needs: set[Fact] = {("closed", j), *({("measured", j)} if done else set())}
        if wet is not None:
            needs.add(("measured", wet) if self._done_by(wet) else ("closed", wet))
        self._add(Kind.SET, joint=j, needs=needs, makes={("set", j)})
        for cord in self._manifest.cords:
            late = anchored_later(cord)
            if late is not None and cord.ends[late].after == j:
                ready: set[Fact] = {("closed", j), ("laid", cord.sensor)}
                bars: set[Fact] = set()
                if self._bonded:
                    bars = {("set", s.joint) for s in cord.stretches}
                else:
                    ready |= {("set", j)}
                self._late_end(cord, late, ready, bars)

    def _done_by(self, j: int) -> list[CutCord]:
        """Cords that lie as they will when joint j is closed, with both wires on."""
        out = []
        for cord in self._manifest.cords:
            joints = [s.joint for s in cord.stretches]
            ready = bool(joints) and max((*joints, *(i for i, _ in cord.drawn))) <= j
            if (ready and anchored_later(cord) is None) or (
                ready and max(e.after or 0 for e in cord.ends) < j
            ):
                out.append(cord)
        return out

    def _late_end(self, cord: CutCord, end: int, ready: set[Fact], bars: set[Fact]) -> None:
        """Crimp an end outside of its mouth, and let it in."""
        name, j = cord.sensor, cord.ends[end].after
        out: Fact = ("out", name)
        needs: set[Fact] = {("marked", name), *ready}
        self._add(Kind.PULL, late=True, joint=j, cord=name, end=end, needs=needs,
                  bars=bars, makes={out},
                  amount=cord.between_ferrules - cord.unstretched)  # fmt: skip
        self._second(cord, end, {out}, set())
        self._add(Kind.SEAT, late=True, joint=j, cord=name, end=end, needs={("crimped", name, end)},
                  bars=bars, makes={("in place", name)})  # fmt: skip
        last: Fact = ("in place", name)
        if cord.ends[end].joint == "free":
            last = self._glue_end(cord, end, j, last)
        self._add(Kind.MEASURE, late=True, joint=j, cord=name, needs={last}, bars=bars,
                  makes={("measured in place", name)}, expected=(laid(cord),))  # fmt: skip

    def _connect(self) -> None:
        everything = {f for a in self.made for f in a.makes}
        self._add(Kind.CONNECT, needs=everything, makes={("connected",)},
                  expected=tuple(laid(c) for c in self._manifest.cords))  # fmt: skip
