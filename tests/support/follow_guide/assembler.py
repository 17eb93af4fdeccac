"""Perform the actions of a guide one by one, and record each impossible action."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from .state import State
from .workpiece import STEP_MM, Cord

ENDS = {"start": 0, "end": 1}
OPENING_MM = 15.0  # smallest opening of a joint for inserting cords and gluing
GRIP_MM = 5.0  # smallest length of cord that can be held


class Assembler(State):
    """Follows a guide: call `perform` with each action of `guide.json`, then `finish`.

    `complaints` lists the actions that were impossible, with the numbers of their steps.
    """

    def perform(self, number: int, action: dict[str, Any]) -> None:
        """Perform an action of a step."""
        self._number, self._time = number, self._time + 1
        kind = self._kind = action["do"]
        method = getattr(self, "_" + kind.replace(" ", "_").replace("-", "_"), None)
        if method is None:
            self._complain(f"'{kind}' is not a known kind of action")
            return
        cord = self.cords.get(action.get("cord", ""))
        end = ENDS.get(action.get("end", ""), 0)
        method(action, cord, end, action.get("joint"))

    # Each kind of action has a method: it checks the requirements, then changes the state.

    def _print(self, *_: Any) -> None:
        self._done.add(("moulds",) if self._cast_parts else ("printed",))

    def _cast(self, *_: Any) -> None:
        self._check(("moulds",) in self._done, "parts are cast before their moulds are printed")
        self._done.add(("printed",))

    def _try_pins(self, *_: Any) -> None:
        self._check(("printed",) in self._done, "pins are tried before they are printed")
        self._done.add(("tried",))

    def _prepare_faces(self, *_: Any) -> None:
        self._check(("printed",) in self._done, "faces are prepared before they are printed")
        inserted = [c.name for c in self.cords.values() if self._is_in_joint(c)]
        self._check(not inserted, f"faces are prepared while {inserted} are in their grooves")
        self._done.add(("faces",))

    def _cut_cord(self, action: Any, c: Cord, *_: Any) -> None:
        self._check(c.cut is None, f"{c.name} is cut twice")
        c.cut = action["mm"]
        self._check(c.cut >= c.record["unstretched"], f"{c.name} is cut too short")

    def _mark(self, action: Any, c: Cord, *_: Any) -> None:
        self._check(any(c.crimped), f"{c.name} is marked from a ferrule that it does not have")
        right = abs(action["mm"] - c.record["unstretched"]) < 0.5
        self._check(right, f"{c.name} is marked at a wrong place")
        c.marked = True

    def _trim(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._check(c.marked, f"{c.name} is trimmed before it is marked")
        self._check(not c.trimmed, f"{c.name} is trimmed twice")
        self._check(not self._enclosed(c, end), f"{c.name} is trimmed inside a closed joint")
        c.trimmed = True

    def _crimp(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._check(c.cut is not None, f"{c.name} is crimped before it is cut")
        self._check(not c.crimped[end], f"{c.name} is crimped twice at one end")
        self._check(not self._enclosed(c, end), f"{c.name} is crimped inside a closed joint")
        if c.crimped[1 - end]:
            self._check(c.trimmed, f"{c.name} is crimped at both ends before it is trimmed")
        c.crimped[end] = True

    def _dry_fit(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._check(("printed",) in self._done, f"joint {j} is tried before its parts are printed")
        self._check(("glued", j) not in self._done, f"joint {j} is tried dry after it was glued")
        self._check(("faces",) in self._done, f"joint {j} is tried before its faces are prepared")
        if self._pins[j]:
            self._check(("tried",) in self._done, f"joint {j} is tried before its pins")
        for i in self._inner(j):
            ready = ("set", i) in self._done or (self._bonded and ("dry", i) in self._done)
            self._check(ready, f"joint {j} is tried before joint {i} has set")
        self._done.add(("dry", j))
        self._tried_at[j] = self._time

    def _pins_in(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._check(("dry", j) in self._done, f"pins of joint {j} are inserted before it was tried")
        self._check(
            ("glued", j) not in self._done, f"pins of joint {j} are inserted after it was closed"
        )
        self._done.add(("pins", j))

    def _lay(self, _: Any, c: Cord, __: Any, j: int) -> None:
        here = c.line.between(*self._joints[j])
        self._check(here.any(), f"{c.name} is inserted in joint {j}, where it has no groove")
        self._check(c.cut is not None, f"{c.name} is inserted before it is cut")
        self._check(("dry", j) in self._done, f"{c.name} is inserted in parts that were not tried")
        closed = (self._covered(c.line) & here).any()
        self._check(not closed, f"{c.name} is inserted in joint {j} after that was closed")
        for end, k in ((0, 0), (1, -1)):
            if here[k] and c.end(end)["wire"]["leaves"] in ("bend", "bay"):
                self._check(c.crimped[end], f"{c.name} is inserted before its {end} has a wire")
        c.line.inserted |= here

    def _thread(self, _: Any, c: Cord, *__: Any) -> None:
        self._check(sum(c.crimped) < 2, f"{c.name} is threaded with a ferrule at its tip")
        c.line.inserted[:] = True

    def _stretch(self, action: Any, c: Cord, *_: Any) -> None:
        lies = c.line.inserted | self._spanning(c)
        self._check(lies.all(), f"{c.name} is stretched before it is inserted")
        self._check(all(c.crimped), f"{c.name} is stretched before it has both ferrules")
        free = [not self._enclosed(c, e) for e in (0, 1)]
        self._check(any(free), f"{c.name} is stretched inside a closed joint")
        self._check(any(self._anchored(c, e) for e in (0, 1)), f"no end of {c.name} is held")
        apart = len({self._piece[n] for p in c.line.pairs for n in p if n}) > 2
        strain = (action["mm"] + (OPENING_MM if apart else 0.0)) / c.record["unstretched"]
        self._check(strain <= self._max_strain, f"{c.name} is stretched by {strain:.0%}")
        c.stretched = True

    def _glue_end(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._check(
            c.line.inserted[-1 if end else 0], f"an end of {c.name} is glued before it is inserted"
        )
        if not c.let_in[end]:
            self._check(
                not self._enclosed(c, end), f"an end of {c.name} is glued after it was covered"
            )
        both = c.held and self._anchored(c, 1 - end)
        ready = not both or c.stretched or c.let_in[end] or not c.line.inserted.all()
        self._check(ready, f"the second end of {c.name} is glued before it is stretched")
        c.glued[end] = True

    def _let_end_set(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._check(c.glued[end], f"{c.name}: the end sets before it is glued")
        c.end_set[end] = True

    def _route_wire(self, _: Any, c: Cord, end: int, j: int) -> None:
        line = c.wires[end]
        self._check(line is not None, f"{c.name} has no wire to route")
        if line is None:
            return
        here = line.between(*self._joints[j])
        self._check(
            here.any(), f"a wire of {c.name} is inserted in joint {j}, where it has no groove"
        )
        self._check(c.crimped[end], f"a wire of {c.name} is routed before it is crimped")
        closed = (self._covered(line) & here).any()
        self._check(not closed, f"a wire of {c.name} is routed in a closed joint")
        self._check(
            ("connected",) not in self._done,
            f"a wire of {c.name} is already connected to the board",
        )
        line.inserted |= here

    def _glue_joint(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._check(("dry", j) in self._done, f"joint {j} is glued before it was tried dry")
        self._check(("glued", j) not in self._done, f"joint {j} is glued twice")
        if self._pins[j]:
            self._check(("pins", j) in self._done, f"joint {j} is closed without its pins")
        for i in self._inner(j):
            ready = "glued" if self._bonded else "set"
            self._check((ready, i) in self._done, f"joint {j} is closed before joint {i} has set")
        before = {c.name: self._covered(c.line) for c in self.cords.values()}
        wires = {
            (c.name, e): self._covered(w)
            for c in self.cords.values()
            for e, w in enumerate(c.wires)
            if w is not None
        }
        for cord in self.cords.values():
            self._draw(cord, j)
        self._piece = self._joined(j)
        self._done.add(("glued", j))
        self._closed_at[j] = self._time
        for c in self.cords.values():
            is_enclosed = self._closed_over(c, before[c.name], wires)
            if is_enclosed and all(c.crimped) and not self._bonded:
                measured = ("measured", c.name, j) in self._done
                self._check(measured, f"{c.name} is not measured before joint {j} is glued")

    def _closed_over(self, c: Cord, before: Any, wires: Any) -> bool:
        """Check what had to be done with a cord before its groove was closed.

        Returns:
            Whether the cord or a wire of it was enclosed.
        """
        now = self._covered(c.line)
        fresh = now & ~before
        is_enclosed = bool(fresh.any())
        missing = STEP_MM * float((fresh & ~c.line.inserted).sum())
        self._check(missing < 2, f"{c.name} is not inserted in {missing:g} mm of a closed groove")
        open_ends = [
            not c.crimped[e] and c.end(e)["wire"]["leaves"] in ("mouth", "outside") for e in (0, 1)
        ]
        for e, k in ((0, 0), (1, -1)):
            if fresh[k]:
                self._check(c.crimped[e] or open_ends[e], f"{c.name} is enclosed without its wire")
                if c.end(e)["joint"] == "free" and not open_ends[e]:
                    self._check(c.end_set[e], f"nothing holds an end of {c.name}")
            line = c.wires[e]
            if line is not None:
                new = self._covered(line) & ~wires[c.name, e]
                is_enclosed |= bool(new.any())
                lost = STEP_MM * float((new & ~line.inserted).sum())
                self._check(lost < 2, f"a wire of {c.name} is not in its closed groove")
        if fresh.any() and now.all() and c.held and not any(open_ends):
            self._check(c.stretched, f"{c.name} is enclosed before it is stretched")
        return is_enclosed

    def _draw(self, c: Cord, j: int) -> None:
        """Check that a cord in grooves on both sides of a joint can slide while it closes."""
        low, high = self._joints[j]
        passing = c.line.between(low, high) & (c.name not in self._laid_in[j])
        certain = np.flatnonzero(~passing)
        for i, k in pairwise(certain):
            one, two = ({n for n in c.line.pairs[at] if n} for at in (i, k))
            apart = (one <= low and two <= high) or (one <= high and two <= low)
            if not (apart and c.line.inserted[i] and c.line.inserted[k]):
                continue
            c.line.inserted[i:k] = True  # the cord between the faces
            sides = (slice(0, k), slice(k, None))
            stuck = [self._bonded and self._stuck(c, side) for side in sides]
            fixed = [
                stuck[e] or (self._anchored(c, e) and bool(c.line.inserted[sides[e]].all()))
                for e in (0, 1)
            ]
            strain = OPENING_MM / c.record["unstretched"] + (c.record["prestretch"] or 0.0)
            if all(stuck) or (all(fixed) and strain > self._max_strain):
                self._complain(f"{c.name} cannot slide while joint {j} is closed")
            open_ends = [e for e in (0, 1) if not c.crimped[e] and c.line.inserted[-1 if e else 0]]
            for e in open_ends:
                hangs = (c.cut or 0.0) - self._to_mouth(c, e) - OPENING_MM
                self._check(hangs >= GRIP_MM, f"{c.name} is too short to hang out of joint {j}")

    def _let_set(self, _: Any, __: Any, ___: Any, j: int) -> None:
        self._check(("glued", j) in self._done, f"joint {j} sets before it is glued")
        self._done.add(("set", j))
        for c in self.cords.values():
            if self._whole(c) and all(c.crimped) and self._in_place(c):
                since = (self._closed_at if self._bonded else self._tried_at).get(j, 0)
                self._check(c.measured > since, f"{c.name} is not measured in joint {j}")

    def _pull_out(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._check(self._whole(c), f"{c.name} is pulled out before its joints are closed")
        self._check(c.marked, f"{c.name} is pulled out without a mark")
        self._check(not c.crimped[end], f"{c.name} is pulled out after its ferrule was crimped")
        free = c.end(end)["joint"] == "free"
        reach = max(self._ferrule / 2 + GRIP_MM, c.end(end)["lead"] if free else 0.0)
        strain = (self._to_mouth(c, end) + reach) / c.record["unstretched"] - 1
        self._check(strain <= self._max_strain, f"{c.name} is pulled out by {strain:.0%}")
        stuck = self._bonded and self._stuck(c, slice(0, None))
        self._check(
            not stuck or len(self._joints) == 1, f"{c.name} is pulled out after its glue has set"
        )
        c.out[end] = True

    def _let_in(self, _: Any, c: Cord, end: int, __: Any) -> None:
        self._check(c.out[end], f"{c.name} is let back in before it is pulled out")
        self._check(c.crimped[end], f"{c.name} is let back in without its ferrule")
        c.out[end], c.let_in[end] = False, True

    def _measure(self, action: Any, cord: Any, _: Any, j: int | None) -> None:
        open_again = dict(self._piece)
        if j is not None and cord is None and not self._bonded:  # in the joint, closed without glue
            self._check(("glued", j) not in self._done, f"joint {j} is measured after it was glued")
            for c in self.cords.values():
                self._draw(c, j)
            self._piece = self._joined(j)
        readings = action.get("ohm", [])
        for name in [r["cord"] for r in readings] + action.get("steady", []):
            c = self.cords[name]
            self._check(all(c.crimped), f"{c.name} is measured before it has both wires")
            c.measured = self._time
            self._done.add(("measured", name, j))
        for reading in readings:
            c = self.cords[reading["cord"]]
            self._check(
                reading["low"] < reading["about"] < reading["high"],
                f"{c.name}: the expected resistance has no tolerance",
            )
            inserted = c.line.inserted.any()
            ready = not inserted or (self._whole(c) and self._in_place(c))
            self._check(ready, f"{c.name} is measured while it is only partly inserted")
            right = c.record["resistance" if inserted else "resistance_before"]
            self._check(abs(reading["about"] - right) < 1.0, f"{c.name} has another resistance")
        self._piece = open_again

    def _wire_to_the_board(self, *_: Any) -> None:
        for c in self.cords.values():
            self._check(
                self._whole(c) and all(c.crimped), f"{c.name} is connected before it is complete"
            )
            self._check(c.measured > 0, f"{c.name} was never measured")
        self._done.add(("connected",))

    def _check_wiring(self, *_: Any) -> None:
        self._check(("connected",) in self._done, "wiring is checked before it is connected")
        self._done.add(("checked",))

    def finish(self) -> list[str]:
        """Return all complaints, including actions that are missing at the end."""
        self._number, self._kind = self._number + 1, "finish"
        for j in range(len(self._joints)):
            self._check(("set", j) in self._done, f"joint {j} was never closed and set")
        for c in self.cords.values():
            self._check(c.trimmed, f"{c.name} was never trimmed")
            self._check(all(c.crimped), f"{c.name} has no wire at an end")
            self._check(c.line.inserted.all(), f"{c.name} is not inserted along its whole length")
            self._check(not c.held or self._in_place(c), f"{c.name} was never stretched")
            self._check(not any(c.out), f"an end of {c.name} is still pulled out")
            for e in (0, 1):
                holds = c.end(e)["joint"] != "free" or c.end_set[e]
                self._check(holds, f"nothing holds an end of {c.name}")
                line = c.wires[e]
                self._check(
                    line is None or line.inserted.all(), f"a wire of {c.name} is not routed"
                )
        self._check(("connected",) in self._done, "nothing was connected to the board")
        if self.cords:
            self._check(("checked",) in self._done, "the wiring was not checked")
        return self.complaints
