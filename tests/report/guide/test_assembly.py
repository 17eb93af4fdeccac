"""The order of a guide is possible: a simulated assembler follows it and checks each action.

The assembler knows only the geometry of the parts.
"""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from defsense_fab.core.errors import FabricationError
from defsense_fab.report.guide.actions import Action, ActionKind, order_actions
from defsense_fab.report.guide.guide import plain_steps
from defsense_fab.report.guide.instructions import pin_letters
from defsense_fab.report.guide.steps import guide_steps
from defsense_fab.store.manifest import GluelessSpot, JointStretch
from tests.support.errors import raises
from tests.support.follow_guide.__main__ import follow_steps
from tests.support.follow_guide.assembler import Assembler

from .blocks import blocks

MOUTHS = [["mouth", "mouth"]] * 3


def guide_of(some):
    steps = guide_steps(some.device, some.manifest, some.parts)
    return json.loads(json.dumps({"steps": plain_steps(steps)}))


def actions_of(guide, kind=None):
    """Return all actions of a guide, or those of a kind."""
    actions = (a for step in guide["steps"] for a in step["actions"])
    return [a for a in actions if kind in (None, a["do"])]


def follow(some, guide, max_strain=0.5):
    """Return the assembler that followed a guide."""
    assembler = Assembler(some.plain(), some.layout, some.triangles(), 7.0, max_strain)
    follow_steps(guide, assembler)
    return assembler


@pytest.mark.parametrize("assembly", ["held", "bonded"])
@pytest.mark.parametrize("cords", [0, 1, 2, 3])
def test_guides_of_random_devices_can_be_followed(cords, assembly):
    for seed in range(6):
        some = blocks(seed, cords, assembly)
        assert not follow(some, guide_of(some)).complaints, (seed, some.manifest.assembly)


def test_random_devices_include_hard_cases():
    """They have cords drawn together later or crimped last, free ends and many joints."""
    cords = [c for seed in range(6) for c in blocks(seed, 3).manifest.cords]
    drawn = [c for c in cords if c.drawn]
    assert drawn
    assert any(e.after is not None for c in drawn for e in c.ends)
    assert any(len(c.stretches) > 2 for c in cords)
    assert any(e.joint == "free" for c in cords for e in c.ends)
    assert any(len(e.wire.joints) for c in cords for e in c.ends)


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


@pytest.mark.parametrize(
    ("kind", "place", "refused"),
    [
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
        ("prepare faces", {"behind": "lay"}, "prepare faces"),
        ("cut cord", {"behind": "crimp"}, "crimp"),
    ],
)
def test_an_action_in_the_wrong_order_is_refused(kind, place, refused):
    some = blocks(1, 1, ends=[["bend", "outside"]])
    guide = guide_of(some)
    assert not follow(some, guide).refused
    assert refused in follow(some, move_action(guide, kind, **place)).refused


_OTHER_KINDS = {
    ActionKind.CAST,
    ActionKind.THREAD,
    ActionKind.PULL,
    ActionKind.SEAT,
    ActionKind.PADS,
}


@pytest.mark.parametrize("kind", [kind for kind in ActionKind if kind not in _OTHER_KINDS])
def test_a_missing_action_is_noticed(kind):
    some = blocks(1, 1, ends=[["bend", "outside"]])
    guide = guide_of(some)
    step, action = next(
        (s, a) for s in reversed(guide["steps"]) for a in reversed(s["actions"]) if a["do"] == kind
    )
    step["actions"].remove(action)
    assert follow(some, guide).complaints


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
    refused = follow(some, {"steps": [{"number": 1, "actions": actions}]}).refused
    assert {"crimp", "pins in", "dry-fit", "wire to the board", "finish"} <= set(refused)


def test_a_cord_that_cannot_slide_is_noticed():
    """Both its ends hold it, and it must not be stretched enough to open the joint."""
    some = blocks(3, 3, ends=[["bend", "bend"]] * 3)
    assert {"glue joint", "stretch"} & set(follow(some, guide_of(some), max_strain=0.1).refused)


@pytest.mark.parametrize(("places", "is_refused"), [(5, False), (12, True)])
def test_a_cord_may_span_an_open_joint_with_slanted_faces(places, is_refused):
    """The parts above and below the cord are on both sides of the joint.

    This holds for one or two widths of the channel; a longer part of a cord must be in a groove
    before the cord is stretched.
    """
    some = blocks(3, 3, ends=[["bend", "bend"]] * 3)
    assembler = Assembler(some.plain(), some.layout, some.triangles(), 7.0, 0.5)
    cord = next(c for c in some.manifest.cords if c.drawn)
    pairs = assembler.cords[cord.sensor].line.pairs
    at = next(k for k, (a, b) in enumerate(pairwise(pairs)) if a != b) + 1
    mixed = (pairs[at - 1][0], pairs[at][1])
    pairs[at - places // 2 : at + (places + 1) // 2] = [mixed] * places
    complaints = follow_steps(guide_of(some), assembler)
    assert ("stretch" in assembler.refused) == is_refused, complaints
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
        glued = [(a["cord"], a["end"]) for a in actions_of(guide_of(some), "glue end")]
        assert glued == [("cord-0", "start")]


def test_a_device_of_one_part_is_only_printed():
    some = blocks(0, 0)
    kinds = [[a["do"] for a in step["actions"]] for step in guide_of(some)["steps"]]
    assert kinds == [["print"], ["wire to the board"]]


@pytest.mark.parametrize("ends", [["mouth", "mouth"], ["outside", "outside"]])
def test_a_cord_without_a_joint_is_threaded(ends):
    some = blocks(0, 0)
    cord = blocks(1, 1, ends=[ends]).manifest.cords[0]
    manifest = replace(some.manifest, cords=(replace(cord, stretches=(), drawn=()),))
    kinds = [a["do"] for a in actions_of(guide_of(replace(some, manifest=manifest)))]
    order = ["cut cord", "crimp", "mark", "thread", "pull out", "trim", "let in"]
    assert [kinds.index(k) for k in order] == sorted(kinds.index(k) for k in order)
    assert kinds.count("crimp") == 2


def test_measurements_have_the_expected_values():
    some = blocks(1, 1, ends=MOUTHS)
    cord = some.manifest.cords[0]
    rows = actions_of(guide_of(some), "measure")
    loose, installed = (row["ohm"][0] for row in rows)
    assert loose["about"] == cord.resistance_before
    assert installed["about"] == cord.resistance
    assert (installed["low"], installed["high"]) == pytest.approx(
        (0.9 * cord.resistance, 1.1 * cord.resistance)
    )
    for row in rows:  # the instructions name these values
        value = row["ohm"][0]
        assert all(f"{value[k]:.0f}" in " ".join(row["lines"]) for k in ("about", "low", "high"))


@pytest.mark.parametrize("assembly", ["held", "bonded"])
def test_joints_are_measured_while_they_can_be_opened(assembly):
    """Those of held cords without glue, those of bonded cords while the glue is wet."""
    some = blocks(1, 3, assembly, ends=MOUTHS)
    actions = actions_of(guide_of(some))
    order = [(a["do"], a["joint"]) for a in actions if "joint" in a and "cord" not in a]
    measured = [j for kind, j in order if kind == "measure"]
    assert measured
    for j in measured:
        at, glued = order.index(("measure", j)), order.index(("glue joint", j))
        assert (at < glued) == (assembly == "held")
        assert at < order.index(("let set", j))


def test_the_step_of_a_joint_mentions_wires_that_cross_it():
    some = blocks(1, 1, ends=MOUTHS)
    last = len(some.manifest.assembly) - 1
    start, end = some.manifest.cords[0].ends
    end = replace(end, wire=replace(end.wire, leaves="bay", crosses=(last,)))
    cords = (replace(some.manifest.cords[0], ends=(start, end)),)
    changed = replace(some, manifest=replace(some.manifest, cords=cords))
    glued, plain = (actions_of(guide_of(each), "glue joint") for each in (changed, some))
    extra = [
        a["joint"] for a, b in zip(glued, plain, strict=True) if len(a["lines"]) > len(b["lines"])
    ]
    assert extra == [last]
    (line,) = set(glued[-1]["lines"]) - set(plain[-1]["lines"])
    assert "the end of cord-0" in line
    assert "bay" in line
    tried = [a for a in actions_of(guide_of(changed), "measure") if a.get("joint") == last]
    assert line in [text for a in tried for text in a["lines"]]


def test_cords_are_pulled_whenever_a_joint_closes_over_them():
    closings = 0
    for seed in range(6):
        some = blocks(seed, 3, "held", ends=MOUTHS)
        actions = actions_of(guide_of(some))
        for one, glued in pairwise(actions):
            if (one["do"], glued["do"]) == ("measure", "glue joint"):
                pulled = [x for x in glued["lines"] if "loop stays" in x or "pinch" in x]
                assert set(pulled) <= set(one["lines"])
                closings += len(pulled)
    assert closings


def joints_of(cord):
    return [s.joint for s in cord.stretches] + [j for j, _ in cord.drawn]


def test_cords_that_only_a_later_joint_completes_are_measured_before_glue_covers_them():
    checked = 0
    for seed in range(4):
        some = blocks(seed, 3, "held", ends=[["bend", "bend"]] * 3)
        actions = actions_of(guide_of(some))
        for j in range(len(some.manifest.assembly)):
            later = {
                c.sensor
                for c in some.manifest.cords
                if all(e.after is None for e in c.ends)
                and j in (*joints_of(c), *(i for e in c.ends for i in e.wire.joints))
                and max(joints_of(c)) > j
            }
            here = [a for a in actions if a.get("joint") == j]
            measured = [a for a in here if a["do"] == "measure" and "steady" in a]
            assert {name for a in measured for name in a["steady"]} == later
            if later:
                (action,) = measured
                (text,) = [x for x in action["lines"] if "steady" in x]
                assert all(name in text for name in later)
                assert here.index(action) < [a["do"] for a in here].index("glue joint")
                assert "Open the joint again" in action["lines"][-1]
            checked += len(later)
            values = {r["cord"] for a in here for r in a.get("ohm", [])} | later
            (glued,) = [a for a in here if a["do"] == "glue joint"]
            for cord in some.manifest.cords:
                handled = [
                    x for x in glued["lines"] if cord.sensor in x and "between the faces" in x
                ]
                if handled and all(e.after is None for e in cord.ends):
                    assert cord.sensor in values
    assert checked


def wire_with_joints(some, joints, crosses):
    """Return devices of blocks whose first cord's end has a wire to a bay, in some joints."""
    start, end = some.manifest.cords[0].ends
    path = end.wire.path if end.wire.path is not None else np.array([end.at, 0.5 * end.at])
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    shares = np.linspace(0, length, len(joints) + 1)
    stretches = tuple(
        JointStretch(j, low, high) for j, (low, high) in zip(joints, pairwise(shares), strict=True)
    )
    wire = replace(end.wire, leaves="bay", path=path, stretches=stretches, crosses=crosses)
    cord = replace(some.manifest.cords[0], ends=(start, replace(end, wire=wire)))
    manifest = replace(some.manifest, cords=(cord, *some.manifest.cords[1:]))
    return replace(some, manifest=manifest)


@pytest.mark.parametrize("assembly", ["held", "bonded"])
def test_wires_that_a_later_joint_pulls_are_not_glued(assembly):
    some = blocks(1, 2, assembly, ends=MOUTHS)
    first, last = 0, len(some.manifest.assembly) - 1
    assert last > first
    changed = wire_with_joints(some, (last, first), (last,))
    glued = {a["joint"]: a["lines"] for a in actions_of(guide_of(changed), "glue joint")}
    assert [j for j in (first, last) if any("along the wire" in x for x in glued[j])] == [first]


@pytest.mark.parametrize(
    ("order", "texts"),
    [
        ((0, 1, 3), ("until step {1}.", "until step {3}.", "")),
        ((3, 0, 1), ("until step {1}.", "until step {3}, with the cord.", "")),
    ],
)
def test_a_wire_hangs_out_until_the_next_of_its_joints(order, texts):
    some = blocks(3, 3, "held", ends=[["bend", "bend"]] * 3)
    assert len(some.manifest.assembly) > 3
    guide = guide_of(wire_with_joints(some, order, ()))
    step_of = {
        a["joint"]: step["number"]
        for step in guide["steps"]
        for a in step["actions"]
        if a["do"] == "glue joint"
    }
    numbers = [step_of[j] for j in range(len(step_of))]
    routed = [
        a
        for a in actions_of(guide, "route wire")
        if (a["cord"], a["end"]) == (some.manifest.cords[0].sensor, "end")
    ]
    assert [a["joint"] for a in routed] == [0, 1, 3]
    for action, text in zip(routed, texts, strict=True):
        hanging = [line for line in action["lines"] if "hang out" in line]
        assert [line.endswith(text.format(*numbers)) for line in hanging] == [True] * bool(text)


def test_a_slow_glue_is_offered_where_glue_sets_fast():
    some = blocks(1, 1, "held", ends=MOUTHS)
    for assembly, fast in (("held", True), ("bonded", False)):
        fabrication = replace(some.device.fabrication, assembly=assembly)
        guide = guide_of(replace(some, device=replace(some.device, fabrication=fabrication)))
        texts = [
            " ".join(a["lines"])
            for kind in ("prepare faces", "glue joint")
            for a in actions_of(guide, kind)
        ]
        assert ["instead" in texts[0], "slow glue" in texts[1]] == [fast, fast]


def test_the_step_of_a_joint_names_spots_without_glue():
    some = blocks(1, 1, ends=MOUTHS)
    *others, last = some.manifest.assembly
    spot = GluelessSpot("cord-0", np.array([1.0, 2.0, 3.0]), 5.4)
    assembly = (*others, replace(last, glueless=(spot,)))
    changed = replace(some, manifest=replace(some.manifest, assembly=assembly))
    glued, plain = (actions_of(guide_of(each), "glue joint") for each in (changed, some))
    (line,) = set(glued[-1]["lines"]) - set(plain[-1]["lines"])
    assert "cord-0" in line
    assert "(1.0, 2.0, 3.0)" in line
    assert "6 mm" in line  # rounded up


def test_other_parts_need_all_steps_again_but_those_of_the_cords():
    some = blocks(1, 1, ends=MOUTHS)
    name, surface = next(iter(some.parts.items()))
    moved = replace(surface, vertices=surface.vertices + 1e-3)
    one, same, other = (
        {s.title: s.identifier for s in guide_steps(some.device, some.manifest, parts)}
        for parts in (some.parts, dict(some.parts), {**some.parts, name: moved})
    )
    assert one == same
    kept = [title for title in one if other[title] == one[title]]
    assert kept == [title for title in one if title.startswith("Cut ")]


def test_copies_need_all_steps_again_but_those_of_the_cords():
    some = blocks(1, 1, ends=MOUTHS)
    one, other = (
        {s.title: s.identifier for s in guide_steps(some.device, manifest, some.parts)}
        for manifest in (some.manifest, replace(some.manifest, copies=2))
    )
    kept = [title for title in one if other[title] == one[title]]
    assert kept == [title for title in one if title.startswith("Cut ")]


def test_pins_after_z_have_two_letters():
    step = blocks(1, 1).manifest.assembly[-1]
    letters = pin_letters(replace(step, pins=step.pins[:1] * 60))
    assert len(set(letters)) == 60
    assert letters[25:28] == ("z", "aa", "ab")
