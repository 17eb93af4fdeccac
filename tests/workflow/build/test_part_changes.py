"""A build states which parts and cords differ from those before it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.store.manifest import FOLDER, MouldPieceRecord, MouldRecord, save_manifest
from defsense_fab.workflow.build.part_changes import (
    MADE_OF,
    PartChanges,
    compare_parts,
    load_changes,
    made_of,
)
from defsense_fab.workflow.build.stage_files import STATE
from tests.report.guide.blocks import blocks


@pytest.fixture
def device():
    return blocks(1, 2, ends=[["mouth", "mouth"]] * 2).device


@pytest.fixture
def manifest():
    return blocks(1, 2, ends=[["mouth", "mouth"]] * 2).manifest


@pytest.fixture
def made(device):
    return made_of(device)


def write(folder, manifest, made, contents=()):
    """Write a build whose files have given contents by name, else their own name."""
    (folder / FOLDER / "print").mkdir(parents=True)
    save_manifest(folder, manifest)
    (folder / STATE).write_text(json.dumps({"fabricate": {MADE_OF: made}}))
    for piece in (*manifest.parts, *manifest.pins):
        file = folder / FOLDER / getattr(piece, "print", piece.stl)
        file.write_text(dict(contents).get(piece.name, piece.name))
    return folder


@pytest.fixture
def first(manifest, made, tmp_path):
    return write(tmp_path / "a", manifest, made)


@pytest.fixture
def compare(first, tmp_path):
    """Return the changes of another build after the first one."""

    def changes(manifest, made, contents=()):
        folder = write(tmp_path / "b", manifest, made, contents)
        record = compare_parts([tmp_path / "without-parts", first], folder, made)
        (folder / STATE).write_text(json.dumps({"fabricate": record}))
        return load_changes(folder)

    return changes


def names(manifest):
    return {p.name for p in (*manifest.parts, *manifest.pins)}


def test_changed_parts_and_cords_are_listed(manifest, made, compare):
    kept, changed = manifest.cords
    longer = replace(changed, cut_length=changed.cut_length + 3)
    nearly = replace(kept, cut_length=kept.cut_length + 0.2)
    name = manifest.parts[1].name
    changes = compare(replace(manifest, cords=(nearly, longer)), made, {name: "another shape"})
    assert changes.print_again == (name,)
    assert set(changes.keep) == names(manifest) - {name}
    assert changes.cut_again == (changed.sensor,)
    assert changes.keep_cords == (kept.sensor,)
    assert changes.cast_again == ()


def test_a_renumbered_part_of_the_same_shape_is_kept(manifest, made, compare):
    renamed = replace(manifest.parts[0], name="9-block", print="print/9-block.stl")
    later = replace(manifest, parts=(renamed, *manifest.parts[1:]))
    assert compare(later, made, {"9-block": manifest.parts[0].name}).print_again == ()


def test_more_copies_and_more_pins_of_the_same_shape_are_printed(manifest, made, compare):
    pin = manifest.pins[0]
    more = replace(manifest, pins=(replace(pin, count=pin.count + 1), *manifest.pins[1:]))
    assert compare(more, made).print_again == (pin.name,)


def test_copies_need_all_pieces_and_cords_again(manifest, made, compare):
    changes = compare(replace(manifest, copies=2), made)
    assert set(changes.print_again) == names(manifest)
    assert changes.keep_cords == ()


def test_pieces_of_another_material_are_printed(manifest, made, compare):
    changes = compare(manifest, {**made, "pieces": ["another"]})
    assert set(changes.print_again) == names(manifest)
    assert changes.cut_again == ()


def test_a_body_with_traces_of_another_filament_is_printed(device):
    one, other = (
        made_of(replace(device, cord=replace(device.cord, name=name, trace=object())))
        for name in ("eel", "another")
    )
    assert one["pieces"] != other["pieces"]


def moulded(manifest):
    """Return a manifest whose parts are cast in moulds of one piece."""
    up = np.array([0.0, 0.0, 1.0])
    moulds = (
        MouldRecord(
            p.name, (MouldPieceRecord(f"mould-{p.name}-cup", p.stl, p.print, up, 1.0),),
            up, up, up[None], 1.0, 2.0, 0.1, up,
        )
        for p in manifest.parts
    )  # fmt: skip
    return replace(manifest, moulds=tuple(moulds))


def test_parts_whose_mould_is_the_same_are_not_cast_again(manifest, made, tmp_path):
    cast = moulded(manifest)
    changed, kept = (p.name for p in manifest.parts[:2])
    first = write(tmp_path / "a", cast, made)
    same = write(tmp_path / "b", cast, made)
    other = write(tmp_path / "c", cast, made, {changed: "another shape"})
    for folder, expected in ((same, ()), (other, (changed,))):
        record = compare_parts([first], folder, made)
        (folder / STATE).write_text(json.dumps({"fabricate": record}))
        changes = load_changes(folder)
        assert changes.cast_again == expected
        assert set(changes.print_again) == {f"mould-{name}-cup" for name in expected}
        assert kept in changes.keep
    other_silicone = compare_parts([first], other, {**made, "cast": ["another"]})
    assert set(other_silicone["changes"]["cast_again"]) == {p.name for p in manifest.parts}


@pytest.mark.parametrize("damaged", [None, 3, []])
def test_a_damaged_record_of_an_earlier_build_is_ignored(manifest, made, tmp_path, damaged):
    first = write(tmp_path / "a", manifest, damaged)
    folder = write(tmp_path / "b", manifest, made)
    assert compare_parts([first], folder, made)["changes"]["print_again"] == ()


def test_cords_of_another_kind_are_cut(manifest, made, compare):
    changes = compare(manifest, {**made, "cords": ["another", 2.0]})
    assert changes.print_again == ()
    assert changes.keep_cords == ()


def test_without_earlier_parts_nothing_is_compared(manifest, made, tmp_path):
    folder = write(tmp_path / "a", manifest, made)
    assert compare_parts([tmp_path], folder, made) == {}


@pytest.mark.parametrize("record", [None, 3, {}, {"changes": {}}, {"changes": {"other": []}}])
def test_a_record_of_another_version_is_no_change(tmp_path, record):
    (tmp_path / STATE).write_text(json.dumps({"fabricate": record}))
    assert load_changes(tmp_path) is None


def test_groups_without_pieces_are_not_described():
    changes = PartChanges(("1-left",), (), (), ("cord-1",))
    first, second = changes.describe()
    assert "1 (left)" in first
    assert "cord-1" in second
    assert PartChanges((), (), (), ()).describe() == []
