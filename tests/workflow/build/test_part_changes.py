"""A build states which parts and cords differ from those before it."""

from dataclasses import replace

import pytest

from defsense_fab.store.manifest import FOLDER, save_manifest
from defsense_fab.workflow.build.part_changes import CHANGES, compare_parts
from tests.report.guide.blocks import blocks


@pytest.fixture
def manifest():
    return blocks(1, 2, ends=[["mouth", "mouth"]] * 2).manifest


def write(folder, manifest, contents):
    """Write a build whose files have given contents by name, else their own name."""
    (folder / FOLDER / "print").mkdir(parents=True)
    save_manifest(folder, manifest)
    for piece in (*manifest.parts, *manifest.pins):
        file = folder / FOLDER / getattr(piece, "print", piece.stl)
        file.write_text(contents.get(piece.name, piece.name))
    return folder


def test_changed_parts_and_cords_are_listed(manifest, tmp_path):
    first = write(tmp_path / "a", manifest, {})
    kept, changed = manifest.cords
    longer = replace(changed, cut_length=changed.cut_length + 3)
    nearly = replace(kept, cut_length=kept.cut_length + 0.2)
    later = replace(manifest, cords=(nearly, longer))
    name = manifest.parts[1].name
    second = write(tmp_path / "b", later, {name: "another shape"})
    changes = compare_parts(first, second)[CHANGES]
    assert changes["print_again"] == (name,)
    assert set(changes["keep"]) == {p.name for p in (*manifest.parts, *manifest.pins)} - {name}
    assert changes["cut_again"] == (changed.sensor,)
    assert changes["keep_cords"] == (kept.sensor,)


def test_a_renumbered_part_of_the_same_shape_is_kept(manifest, tmp_path):
    first = write(tmp_path / "a", manifest, {})
    renamed = replace(manifest.parts[0], name="9-block", print="print/9-block.stl")
    later = replace(manifest, parts=(renamed, *manifest.parts[1:]))
    second = write(tmp_path / "b", later, {"9-block": manifest.parts[0].name})
    assert compare_parts(first, second)[CHANGES]["print_again"] == ()


def test_without_earlier_parts_nothing_is_compared(manifest, tmp_path):
    assert compare_parts(tmp_path, write(tmp_path / "a", manifest, {})) == {}
