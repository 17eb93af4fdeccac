"""Do what a guide says, action by action, and record each impossible action."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from .state import State
from .workpiece import STEP, Cord

ENDS = {"start": 0, "end": 1}
OPEN = 15.0  # mm, by which a joint is opened at least to lay and to glue
GRIP = 5.0  # mm, to hold something by


class Hands(State):
    """Follow a guide: call `do` with each action of `guide.json`, then `finish`.

    `complaints` has the actions that could not be done, with the numbers of their steps.
    """

    def do(self, number: int, action: dict[str, Any]) -> None:
        """Do an action of a step."""
        self._number, self._time = number, self._time + 1
        kind = action["do"]
        method = getattr(self, "_" + kind.replace(" ", "_").replace("-", "_"), None)
        if method is None:
            self._no(f"'{kind}' is nothing that these hands know")
            return
        cord = self._cords.get(action.get("cord", ""))
        end = ENDS.get(action.get("end", ""), 0)
        method(action, cord, end, action.get("joint"))

    # Each action is a method: what it needs first, then what it makes of the work piece.

    def _print(self, *_: Any) -> None:
        self._done.add(("moulds",) if self._cast_parts else ("printed",))

    def _cast(self, *_: Any) -> None:
        self._need(("moulds",) in self._done, "parts are cast before their moulds are printed")
        self._done.add(("printed",))

    def _try_pins(self, *_: Any) -> None:
        self._need(("printed",) in self._done, "pins are tried before they are printed")
        self._done.add(("tried",))

    def _cut_cord(self, action: Any, c: Cord, *_: Any) -> None:
        self._need(c.cut is None, f"{c.name} is cut twice")
        c.cut = action["mm"]
        self._need(c.cut >= c.record["unstretched"], f"{c.name} is cut too short")

    def _mark(self, action: Any, c: Cord, *_: Any) -> None:
        self._need(any(c.crimped), f"{c.name} is marked from a ferrule that it does not have")
        right = abs(action["mm"] - c.record["unstretched"]) < 0.5
        self._need(right, f"{c.name} is marked in a wrong place")
        c.marked = True

    def _trim(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._need(c.marked, f"{c.name} is trimmed before it is marked")
        self._need(not c.trimmed, f"{c.name} is trimmed twice")
        self._need(not self._enclosed(c, end), f"{c.name} is trimmed inside a closed joint")
        c.trimmed = True

    def _crimp(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._need(c.cut is not None, f"{c.name} is crimped before it is cut")
        self._need(not c.crimped[end], f"{c.name} is crimped twice at one end")
        self._need(not self._enclosed(c, end), f"{c.name} is crimped inside a closed joint")
        if c.crimped[1 - end]:
            self._need(c.trimmed, f"{c.name} is crimped at both ends before it is trimmed")
        c.crimped[end] = True

    def _dry_fit(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._need(("printed",) in self._done, f"joint {j} is tried before its parts are printed")
        self._need(("glued", j) not in self._done, f"joint {j} is tried dry when it is glued")
        if self._pins[j]:
            self._need(("tried",) in self._done, f"joint {j} is tried before its pins are")
        for i in self._inner(j):
            ready = ("set", i) in self._done or (self._bonded and ("dry", i) in self._done)
            self._need(ready, f"joint {j} is tried before joint {i} holds")
        self._done.add(("dry", j))

    def _pins_in(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._need(("dry", j) in self._done, f"pins of joint {j} go in before it was tried")
        self._need(("glued", j) not in self._done, f"pins of joint {j} go in when it is closed")
        self._done.add(("pins", j))

    def _lay(self, _: Any, c: Cord, __: Any, j: int) -> None:
        here = c.line.between(*self._joints[j])
        self._need(here.any(), f"{c.name} is laid in joint {j}, where it does not run")
        self._need(c.cut is not None, f"{c.name} is laid before it is cut")
        self._need(("dry", j) in self._done, f"{c.name} is laid in parts that were not tried")
        closed = (self._covered(c.line) & here).any()
        self._need(not closed, f"{c.name} is laid in joint {j} when that is closed")
        for end, k in ((0, 0), (1, -1)):
            if here[k] and c.end(end)["wire"]["leaves"] in ("bend", "bay"):
                self._need(c.crimped[end], f"{c.name} is laid before its {end} has its wire")
        c.line.laid |= here

    def _thread(self, _: Any, c: Cord, *__: Any) -> None:
        self._need(sum(c.crimped) < 2, f"{c.name} is threaded with a ferrule at its tip")
        c.line.laid[:] = True

    def _stretch(self, action: Any, c: Cord, *_: Any) -> None:
        lies = c.line.laid | self._spanning(c)
        self._need(lies.all(), f"{c.name} is stretched before it is laid")
        self._need(all(c.crimped), f"{c.name} is stretched before it has both ferrules")
        free = [not self._enclosed(c, e) for e in (0, 1)]
        self._need(any(free), f"{c.name} is stretched inside a closed joint")
        self._need(any(self._anchored(c, e) for e in (0, 1)), f"{c.name} is held at no end")
        apart = len({self._piece[n] for p in c.line.pairs for n in p if n}) > 2
        strain = (action["mm"] + (OPEN if apart else 0.0)) / c.record["unstretched"]
        self._need(strain <= self._most, f"{c.name} is stretched by {strain:.0%}")
        c.stretched = True

    def _glue_end(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._need(c.line.laid[-1 if end else 0], f"an end of {c.name} is glued before it is laid")
        if not c.let_in[end]:
            self._need(not self._enclosed(c, end), f"an end of {c.name} is glued when covered")
        both = c.held and self._anchored(c, 1 - end)
        ready = not both or c.stretched or c.let_in[end] or not c.line.laid.all()
        self._need(ready, f"the second end of {c.name} is glued before it is stretched")
        c.glued[end] = True

    def _let_end_set(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._need(c.glued[end], f"{c.name}: glue that is not there sets")
        c.end_set[end] = True

    def _route_wire(self, _: Any, c: Cord, end: int, j: int) -> None:
        line = c.wires[end]
        self._need(line is not None, f"{c.name} has no wire to lay")
        if line is None:
            return
        here = line.between(*self._joints[j])
        self._need(here.any(), f"a wire of {c.name} is laid in joint {j}, where it does not run")
        self._need(c.crimped[end], f"a wire of {c.name} is laid before it is crimped")
        closed = (self._covered(line) & here).any()
        self._need(not closed, f"a wire of {c.name} is laid in a closed joint")
        self._need(("connected",) not in self._done, f"a wire of {c.name} is on the board already")
        line.laid |= here

    def _glue_joint(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._need(("dry", j) in self._done, f"joint {j} is glued before it was tried dry")
        self._need(("glued", j) not in self._done, f"joint {j} is glued twice")
        if self._pins[j]:
            self._need(("pins", j) in self._done, f"joint {j} is closed without its pins")
        for i in self._inner(j):
            ready = "glued" if self._bonded else "set"
            self._need((ready, i) in self._done, f"joint {j} is closed before {i} holds")
        before = {c.name: self._covered(c.line) for c in self._cords.values()}
        wires = {(c.name, e): self._covered(w) for c in self._cords.values()
                 for e, w in enumerate(c.wires) if w is not None}  # fmt: skip
        for cord in self._cords.values():
            self._draw(cord, j)
        names = self._joints[j][0] | self._joints[j][1]
        piece = min(self._piece[n] for n in names)
        old = {self._piece[n] for n in names}
        self._piece = {n: piece if k in old else k for n, k in self._piece.items()}
        self._done.add(("glued", j))
        self._closed_at[j] = self._time
        for c in self._cords.values():
            self._closed_over(c, before[c.name], wires)

    def _closed_over(self, c: Cord, before: Any, wires: Any) -> None:
        """What had to be done with a cord before its groove was closed."""
        now = self._covered(c.line)
        fresh = now & ~before
        missing = STEP * float((fresh & ~c.line.laid).sum())
        self._need(
            missing < 2, f"{c.name} is not laid in {missing:g} mm of a groove that is closed"
        )
        open_ends = [not c.crimped[e] and c.end(e)["wire"]["leaves"] in ("mouth", "outside")
                for e in (0, 1)]  # fmt: skip
        for e, k in ((0, 0), (1, -1)):
            if fresh[k]:
                self._need(c.crimped[e] or open_ends[e], f"{c.name} is closed in without its wire")
                if c.end(e)["joint"] == "free" and not open_ends[e]:
                    self._need(c.end_set[e], f"nothing holds an end of {c.name}")
            line = c.wires[e]
            if line is not None:
                new = self._covered(line) & ~wires[c.name, e]
                lost = STEP * float((new & ~line.laid).sum())
                self._need(lost < 2, f"a wire of {c.name} is not in its groove that is closed")
        if fresh.any() and now.all() and c.held and not any(open_ends):
            self._need(c.stretched, f"{c.name} is closed in before it is stretched")

    def _draw(self, c: Cord, j: int) -> None:
        """A cord that is laid on both sides of a joint has to slide as that is closed."""
        low, high = self._joints[j]
        passing = c.line.between(low, high) & (c.name not in self._laid_in[j])
        certain = np.flatnonzero(~passing)
        for i, k in pairwise(certain):
            one, two = ({n for n in c.line.pairs[at] if n} for at in (i, k))
            apart = (one <= low and two <= high) or (one <= high and two <= low)
            if not (apart and c.line.laid[i] and c.line.laid[k]):
                continue
            c.line.laid[i:k] = True  # what lies between the faces themselves
            sides = (slice(0, k), slice(k, None))
            stuck = [self._bonded and self._stuck(c, side) for side in sides]
            fixed = [
                stuck[e] or (self._anchored(c, e) and bool(c.line.laid[sides[e]].all()))
                for e in (0, 1)
            ]
            strain = OPEN / c.record["unstretched"] + (c.record["prestretch"] or 0.0)
            if all(stuck) or (all(fixed) and strain > self._most):
                self._no(f"{c.name} cannot slide as joint {j} is closed over it")
            open_ends = [e for e in (0, 1) if not c.crimped[e] and c.line.laid[-1 if e else 0]]
            for e in open_ends:
                hangs = (c.cut or 0.0) - self._to_mouth(c, e) - OPEN
                self._need(hangs >= GRIP, f"{c.name} is too short to hang out of joint {j}")

    def _let_set(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._need(("glued", j) in self._done, f"joint {j} sets before it is glued")
        self._done.add(("set", j))
        for c in self._cords.values():
            if self._whole(c) and all(c.crimped) and self._in_place(c):
                since = self._closed_at.get(j, 0)
                self._need(c.measured > since, f"{c.name} is not measured after joint {j}")

    def _pull_out(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._need(self._whole(c), f"{c.name} is pulled out before its joints are closed")
        self._need(c.marked, f"{c.name} is pulled out without a mark")
        self._need(not c.crimped[end], f"{c.name} is pulled out with its ferrule on")
        free = c.end(end)["joint"] == "free"
        reach = max(self._ferrule / 2 + GRIP, c.end(end)["lead"] if free else 0.0)
        strain = (self._to_mouth(c, end) + reach) / c.record["unstretched"] - 1
        self._need(strain <= self._most, f"{c.name} is pulled out by {strain:.0%}")
        stuck = self._bonded and self._stuck(c, slice(0, None))
        self._need(not stuck or len(self._joints) == 1, f"{c.name} is pulled when its glue is set")
        c.out[end] = True

    def _let_in(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._need(c.out[end], f"{c.name} is let in before it is pulled out")
        self._need(c.crimped[end], f"{c.name} is let in without its ferrule")
        c.out[end], c.let_in[end] = False, True

    def _measure(self, action: Any, *_: Any) -> None:
        for reading in action["ohm"]:
            c = self._cords[reading["cord"]]
            self._need(all(c.crimped), f"{c.name} is measured before it has both wires")
            self._need(
                reading["low"] < reading["about"] < reading["high"], f"{c.name}: no tolerance"
            )
            laid = c.line.laid.any()
            ready = not laid or (self._whole(c) and self._in_place(c))
            self._need(ready, f"{c.name} is measured while it lies half")
            right = c.record["resistance" if laid else "resistance_before"]
            self._need(abs(reading["about"] - right) < 1.0, f"{c.name} will not measure that")
            c.measured = self._time

    def _wire_to_the_board(self, *_: Any) -> None:
        for c in self._cords.values():
            self._need(self._whole(c) and all(c.crimped), f"{c.name} is wired before it is in")
            self._need(c.measured > 0, f"{c.name} was never measured")
        self._done.add(("connected",))

    def finish(self) -> list[str]:
        """Return all complaints, with what is not done at the end."""
        self._number += 1
        for j in range(len(self._joints)):
            self._need(("set", j) in self._done, f"joint {j} was never closed and set")
        for c in self._cords.values():
            self._need(c.trimmed, f"{c.name} was never trimmed")
            self._need(all(c.crimped), f"{c.name} has no wire at an end")
            self._need(c.line.laid.all(), f"{c.name} is not laid all along")
            self._need(not c.held or self._in_place(c), f"{c.name} was never stretched")
            self._need(not any(c.out), f"{c.name} hangs out")
            for e in (0, 1):
                holds = c.end(e)["joint"] != "free" or c.end_set[e]
                self._need(holds, f"nothing holds an end of {c.name}")
                line = c.wires[e]
                self._need(line is None or line.laid.all(), f"a wire of {c.name} is not laid")
        self._need(("connected",) in self._done, "nothing was wired to the board")
        return self.complaints
