"""The order of a guide is possible: a simulated assembler follows it and checks each action.

The assembler knows only the geometry of the parts.
"""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from itertools import pairwise

import pytest

from defsense_fab.core.errors import FabricationError
from defsense_fab.report.guide.assembly.actions import Action, ActionKind, order_actions
from defsense_fab.report.guide.assembly.steps import guide_steps
from defsense_fab.report.guide.assembly.wording import pin_letters
from defsense_fab.report.guide.guide import plain_steps
from tests.support.errors import raises
from tests.support.follow_guide.__main__ import follow_steps
from tests.support.follow_guide.hands import Hands

from .blocks import blocks

MOUTHS = [["mouth", "mouth"]] * 3


def guide_of(some):
    steps = guide_steps(some.device, some.manifest, some.parts)
    return json.loads(json.dumps({"steps": plain_steps(steps)}))


def complaints(some, guide):
    hands = Hands(some.plain(), some.layout, some.triangles(), 7.0, 0.5)
    return follow_steps(guide, hands)


@pytest.mark.parametrize("assembly", ["held", "bonded"])
@pytest.mark.parametrize("cords", [0, 1, 2, 3])
def test_guides_of_random_devices_can_be_followed(cords, assembly):
    for seed in range(6):
        some = blocks(seed, cords, assembly)
        assert complaints(some, guide_of(some)) == [], (seed, some.manifest.assembly)


def test_random_devices_include_hard_cases():
    """They have cords drawn together later or crimped last, free ends and many joints."""
    made = [c for seed in range(6) for c in blocks(seed, 3).manifest.cords]
    drawn = [c for c in made if c.drawn]
    assert drawn
    assert any(e.after is not None for c in drawn for e in c.ends)
    assert any(len(c.stretches) > 2 for c in made)
    assert any(e.joint == "free" for c in made for e in c.ends)
    assert any(len(e.wire.joints) for c in made for e in c.ends)


def move_action(guide, kind, before=None, behind=None):
    """Return a guide with the first action of a kind moved before or behind one of another kind."""
    out = copy.deepcopy(guide)
    rows = [(s, a) for s in out["steps"] for a in s["actions"]]
    action = next(r for r in rows if r[1]["do"] == kind)
    rows.remove(action)
    places = [
        k
        for k, r in enumerate(rows)
        if r[1]["do"] == (before or behind)
        and r[1].get("cord", action[1].get("cord")) == action[1].get("cord", r[1].get("cord"))
        and r[1].get("joint", 0) == action[1].get("joint", r[1].get("joint", 0))
    ]
    rows.insert(places[0] if before else places[-1] + 1, action)
    # Each action is a step of its own: only their order matters.
    out["steps"] = [{**step, "actions": [action]} for step, action in rows]
    return out


class RecordingHands(Hands):
    """Records the kinds of the actions that could not be done; "finish" is the final check."""

    def do(self, number, action):
        count = len(self.complaints)
        super().do(number, action)
        if len(self.complaints) > count:
            self.__dict__.setdefault("refused", []).append(action["do"])

    def finish(self):
        count = len(self.complaints)
        super().finish()
        if len(self.complaints) > count:
            self.__dict__.setdefault("refused", []).append("finish")
        return self.complaints


def refused_actions(some, guide):
    hands = RecordingHands(some.plain(), some.layout, some.triangles(), 7.0, 0.5)
    follow_steps(guide, hands)
    return hands.__dict__.get("refused", [])


@pytest.mark.parametrize(("kind", "place", "refused"), [
    ("crimp", {"behind": "glue joint"}, "crimp"),
    ("trim", {"behind": "crimp"}, "crimp"),
    ("lay", {"behind": "glue joint"}, "glue joint"),
    ("stretch", {"behind": "glue joint"}, "glue joint"),
    ("pins in", {"behind": "glue joint"}, "glue joint"),
    ("dry-fit", {"behind": "glue joint"}, "glue joint"),
    ("let set", {"before": "glue joint"}, "let set"),
    ("route wire", {"behind": "glue joint"}, "glue joint"),
    ("glue end", {"behind": "glue joint"}, "glue end"),
    ("mark", {"behind": "trim"}, "trim"),
    ("print", {"behind": "try pins"}, "try pins"),
    ("cut cord", {"behind": "crimp"}, "crimp"),
])  # fmt: skip
def test_an_action_at_the_wrong_time_is_refused(kind, place, refused):
    some = blocks(1, 1, ends=[["bend", "outside"]])
    guide = guide_of(some)
    assert refused_actions(some, guide) == []
    assert refused in refused_actions(some, move_action(guide, kind, **place))


@pytest.mark.parametrize("kind", [
    "crimp", "mark", "trim", "lay", "stretch", "glue joint", "let set", "measure", "pins in",
    "dry-fit", "print", "try pins", "cut cord", "glue end", "let end set", "wire to the board",
    "route wire",
])  # fmt: skip
def test_a_missing_action_is_found(kind):
    some = blocks(1, 1, ends=[["bend", "outside"]])
    guide = guide_of(some)
    step, action = next(
        (s, a) for s in reversed(guide["steps"]) for a in reversed(s["actions"]) if a["do"] == kind
    )
    step["actions"].remove(action)
    assert complaints(some, guide)


def test_a_naive_order_is_refused():
    """Everything is crimped first, nothing is trimmed or set, and nothing is measured."""
    some = blocks(3, 3, ends=MOUTHS)
    assert any(c.drawn for c in some.manifest.cords)
    cords = some.manifest.cords
    actions = [{"do": "print"}]
    for c in cords:
        actions.append({"do": "cut cord", "cord": c.sensor, "mm": c.cut_length})
        actions += [{"do": "crimp", "cord": c.sensor, "end": e} for e in ("start", "end")]
    for j, step in enumerate(some.manifest.assembly):
        actions.append({"do": "pins in", "joint": j})
        actions += [{"do": "lay", "cord": c, "joint": j} for c in step.cords]
        actions += [{"do": "stretch", "cord": c, "joint": j, "mm": 2.0} for c in step.cords]
        actions += [{"do": "dry-fit", "joint": j}, {"do": "glue joint", "joint": j}]
    actions.append({"do": "wire to the board"})
    refused = refused_actions(some, {"steps": [{"number": 1, "actions": actions}]})
    assert {"crimp", "pins in", "dry-fit", "wire to the board", "finish"} <= set(refused)


def test_a_cord_that_cannot_slide_is_found():
    """Both its ends hold it, and it must not be stretched enough to open the joint."""
    some = blocks(3, 3, ends=[["bend", "bend"]] * 3)
    hands = RecordingHands(some.plain(), some.layout, some.triangles(), 7.0, 0.1)
    follow_steps(guide_of(some), hands)
    assert {"glue joint", "stretch"} & set(hands.__dict__["refused"])


@pytest.mark.parametrize(("places", "is_refused"), [(5, False), (12, True)])
def test_a_cord_may_span_an_open_joint_with_slanted_faces(places, is_refused):
    """There, the parts above and below it are on both sides of the joint.

    This holds for one or two widths of the channel; a longer part of a cord must lie in a groove
    before the cord is stretched.
    """
    some = blocks(3, 3, ends=[["bend", "bend"]] * 3)
    hands = RecordingHands(some.plain(), some.layout, some.triangles(), 7.0, 0.5)
    cord = next(c for c in some.manifest.cords if c.drawn)
    pairs = hands._cords[cord.sensor].line.pairs
    at = next(k for k, (a, b) in enumerate(pairwise(pairs)) if a != b) + 1
    mixed = (pairs[at - 1][0], pairs[at][1])
    pairs[at - places // 2 : at + (places + 1) // 2] = [mixed] * places
    complaints = follow_steps(guide_of(some), hands)
    assert ("stretch" in hands.__dict__.get("refused", [])) == is_refused, complaints
    assert bool(complaints) == is_refused


def test_an_impossible_order_is_refused():
    a, b = ("a",), ("b",)
    ring = [
        Action(ActionKind.LAY, joint=0, requires=frozenset({a}), effects=frozenset({b})),
        Action(ActionKind.GLUE, joint=0, requires=frozenset({b}), effects=frozenset({a})),
    ]
    with raises(FabricationError, "no-assembly-order", action_kind="lay", joint=0):
        order_actions(ring)
    with raises(FabricationError, "requirement-unmet", action_kind="lay", joint=0, fact=a):
        order_actions(ring[:1])


def test_free_ends_are_glued():
    for assembly in ("held", "bonded"):
        some = blocks(1, 1, assembly, ends=[["outside", "mouth"]])
        glued = [(a["cord"], a["end"]) for s in guide_of(some)["steps"] for a in s["actions"]
                 if a["do"] == "glue end"]  # fmt: skip
        assert glued == [("cord-0", "start")]


def test_a_device_of_one_part_is_only_printed():
    some = blocks(0, 0)
    steps = guide_steps(some.device, some.manifest, some.parts)
    kinds = [[a.kind for p in s.passages for a, _ in p.actions] for s in steps]
    assert kinds == [[ActionKind.PRINT], [ActionKind.CONNECT]]


def test_a_cord_without_a_joint_is_threaded():
    some = blocks(0, 0)
    from dataclasses import replace

    cord = blocks(1, 1, ends=[["mouth", "mouth"]]).manifest.cords[0]
    manifest = replace(some.manifest, cords=(replace(cord, stretches=(), drawn=()),))
    kinds = [a.kind for s in guide_steps(some.device, manifest, some.parts)
             for p in s.passages for a, _ in p.actions]  # fmt: skip
    order = [
        ActionKind.CUT,
        ActionKind.CRIMP,
        ActionKind.MARK,
        ActionKind.THREAD,
        ActionKind.PULL,
        ActionKind.TRIM,
        ActionKind.SEAT,
    ]
    assert [kinds.index(k) for k in order] == sorted(kinds.index(k) for k in order)
    assert kinds.count(ActionKind.CRIMP) == 2


def test_measurements_have_the_expected_values():
    some = blocks(1, 1, ends=MOUTHS)
    cord = some.manifest.cords[0]
    rows = [a for s in guide_of(some)["steps"] for a in s["actions"] if a["do"] == "measure"]
    loose, installed = (row["ohm"][0] for row in rows)
    assert loose["about"] == cord.resistance_before
    assert installed["about"] == cord.resistance
    assert (installed["low"], installed["high"]) == pytest.approx(
        (0.9 * cord.resistance, 1.1 * cord.resistance)
    )
    for row in rows:  # the instructions name these values
        value = row["ohm"][0]
        assert all(f"{value[k]:.0f}" in row["lines"][0] for k in ("about", "low", "high"))


def test_the_step_of_a_joint_mentions_wires_that_cross_it():
    some = blocks(1, 1, ends=MOUTHS)
    last = len(some.manifest.assembly) - 1
    start, end = some.manifest.cords[0].ends
    end = replace(end, wire=replace(end.wire, leaves="bay", crosses=(last,)))
    cords = (replace(some.manifest.cords[0], ends=(start, end)),)
    steps = guide_steps(some.device, replace(some.manifest, cords=cords), some.parts)
    glued = [a for s in plain_steps(steps) for a in s["actions"] if a["do"] == "glue joint"]
    plain = [a for s in guide_of(some)["steps"] for a in s["actions"] if a["do"] == "glue joint"]
    extra = [
        a["joint"] for a, b in zip(glued, plain, strict=True) if len(a["lines"]) > len(b["lines"])
    ]
    assert extra == [last]
    (line,) = set(glued[-1]["lines"]) - set(plain[-1]["lines"])
    assert "bay" in line


def test_pins_after_z_have_two_letters():
    step = blocks(1, 1).manifest.assembly[-1]
    letters = pin_letters(replace(step, pins=step.pins[:1] * 60))
    assert len(set(letters)) == 60
    assert letters[25:28] == ("z", "aa", "ab")
