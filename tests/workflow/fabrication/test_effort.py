"""What a device takes: printing, material, cord, assembly and cost."""

from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.prices import Prices
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.report.guide.actions import ActionKind
from defsense_fab.report.guide.plan import last_joint_while_wet, plan_actions
from defsense_fab.store.manifest import BillItem
from defsense_fab.workflow.fabrication.effort import (
    assembly_time,
    effort_table,
    find_cost,
    find_effort,
)
from tests.report.guide.blocks import blocks
from tests.support.places import BAR

BILL = (
    BillItem("TPU, printed", "100 cm3", "parts", "filament", 0.119),
    BillItem("cord", "450 mm", "pieces", "cord", 0.45),
    BillItem("ferrule", "4", "crimped", "ferrule", 4),
    BillItem("glue", "20 cm2", "faces", "glue", 0.2),
)


@pytest.fixture
def device():
    return load_device(BAR)


@pytest.fixture
def manifest():
    return replace(blocks(1, 3).manifest, bill=BILL)


def test_every_action_has_a_time_and_every_time_an_action_and_a_source():
    rows = read_rows("assembly.csv").values()
    assert {row["action"] for row in rows} == {str(kind) for kind in ActionKind}
    for row in rows:
        assert row["minutes"] or row["waits"] == "glue"
        assert row["source"].startswith("assumed") or row["waits"] == "glue"


def test_the_time_of_assembly_is_that_of_the_actions(manifest):
    rows = list(read_rows("assembly.csv").values())
    kinds = [action.kind for action in plan_actions(manifest)]
    length = sum(s.stop - s.start for c in manifest.cords for s in c.stretches)
    counts = {
        "plate": 1,
        "piece": len(manifest.parts),
        "pin": sum(p.count for p in manifest.pins),
        "joint": len(manifest.assembly),
        "wire": 2 * len(manifest.cords),
        "cord": len(manifest.cords),
        "100 mm": length / 100,
    }
    expected = 0.0
    for row in (row for row in rows if row["action"] in kinds and row["minutes"]):
        count = kinds.count(row["action"]) if row["each"] == "action" else counts[row["each"]]
        expected += count * float(row["minutes"])
    time = assembly_time(manifest, 1.5)
    assert time.minutes == pytest.approx(expected)
    waits = [k for k in kinds if k in (ActionKind.SET, ActionKind.SET_END)]
    assert len(waits) >= len(manifest.assembly)
    assert (time.cures, time.cure_hours) == (len(waits), pytest.approx(1.5 * len(waits)))


def test_joints_that_are_closed_while_wet_set_together():
    manifest = next(
        m
        for m in (blocks(seed, 3, "bonded").manifest for seed in range(20))
        if any(last_joint_while_wet(m, j) is not None for j in range(len(m.assembly)))
    )
    wet = [j for j in range(len(manifest.assembly)) if last_joint_while_wet(manifest, j) is None]
    ends = [a for a in plan_actions(manifest) if a.kind is ActionKind.SET_END]
    assert len(wet) < len(manifest.assembly)
    assert assembly_time(manifest, 24.0).cures == len(wet) + len(ends)


def test_copies_take_as_many_times_the_work_but_cure_together(manifest):
    one, three = (assembly_time(replace(manifest, copies=n), 4) for n in (1, 3))
    # The plates are the same here, so that only their part of the time is not repeated.
    on_plates = 10 + 2 * len(manifest.parts)
    assert three.minutes - on_plates == pytest.approx(3 * (one.minutes - on_plates))
    assert (three.cures, three.cure_hours) == (one.cures, one.cure_hours)


def test_the_effort_has_plates_material_and_cord(device, manifest):
    effort = find_effort(device, replace(manifest, copies=1))
    (plate,) = effort.plates
    volume = sum(part.volume for part in manifest.parts)
    assert plate.mass == pytest.approx(volume / 1000 * device.material.density)
    assert effort.print_hours == plate.hours > volume / device.fabrication.rate / 3600
    assert effort.mass == pytest.approx(119)
    lengths = [cord.cut_length for cord in manifest.cords]
    assert (effort.cord, effort.spare) == (sum(lengths), max(lengths))
    assert (effort.parts, effort.joints) == (len(manifest.parts), len(manifest.assembly))
    without = replace(device, fabrication=replace(device.fabrication, rate=None))
    assert find_effort(without, manifest).print_hours is None


def test_the_cost_has_only_what_the_user_gave_prices_for():
    assert find_cost(Prices(), BILL) is None
    cost = find_cost(Prices("EUR", {"filament": 40.0, "cord": 5.0, "board": 20.0}), BILL)
    assert cost.amount == pytest.approx(0.119 * 40 + 0.45 * 5)
    assert (cost.currency, cost.without_price) == ("EUR", ("ferrule", "glue"))
    assert find_cost(Prices("EUR", {"glue": 2.5}), BILL).amount == pytest.approx(0.5)


def test_the_line_and_the_table_state_the_same(device, manifest):
    device = replace(device, prices=Prices("EUR", {"filament": 40.0}))
    effort = find_effort(device, manifest)
    line, table = effort.describe(), effort_table(device, manifest)
    shown = {name: value for name, value, _ in table.rows}
    assert shown["cost"] == "4.76 EUR"
    for value in (shown["printing"], "119 g", shown["assembly"], shown["cost"]):
        assert value in line
    assert all(basis for _, _, basis in table.rows)
