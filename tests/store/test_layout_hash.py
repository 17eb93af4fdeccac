"""Test the hash that identifies a layout of cords."""

from __future__ import annotations

from dataclasses import replace

from defsense_fab.core.storage import typed_json
from defsense_fab.store.layout import layout_hash, load_layout
from tests.store.layouts import layout


def test_hash_depends_only_on_the_cords_and_survives_the_file(straight, tmp_path):
    record = layout(straight("left", y=5.0), straight("right", y=-5.0))
    cords, expected = record.sensors, layout_hash(record)
    assert layout_hash(replace(record, mesh="other", seed=2, sensors=cords[::-1])) == expected
    typed_json.save(tmp_path / "layout.json", record)
    assert layout_hash(load_layout(tmp_path)) == expected
    bent = replace(cords[0], control_points=cords[0].control_points + 0.01)
    swapped = replace(cords[0], channel=1), replace(cords[1], channel=0)
    for others in ((bent, cords[1]), swapped, cords[:1]):
        assert layout_hash(replace(record, sensors=others)) != expected
