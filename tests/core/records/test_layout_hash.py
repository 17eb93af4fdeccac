"""What tells one layout of cords from another."""

from __future__ import annotations

from dataclasses import replace

from defsense_fab.core.storage import typed_json
from defsense_fab.store.layout import layout_hash, load_layout

from tests.core.records.layouts import layout


def test_it_is_of_the_cords_alone_and_survives_the_file(straight, tmp_path):
    one = layout(straight("left", y=5.0), straight("right", y=-5.0))
    cords, known = one.sensors, layout_hash(one)
    assert layout_hash(replace(one, mesh="other", seed=2, sensors=cords[::-1])) == known
    typed_json.save(tmp_path / "layout.json", one)
    assert layout_hash(load_layout(tmp_path)) == known
    bent = replace(cords[0], control_points=cords[0].control_points + 0.01)
    swapped = replace(cords[0], channel=1), replace(cords[1], channel=0)
    for other in ((bent, cords[1]), swapped, cords[:1]):
        assert layout_hash(replace(one, sensors=other)) != known
