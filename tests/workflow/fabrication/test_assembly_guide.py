"""The notes of an assembly guide, and the points that they are about."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.workflow.fabrication import assembly_guide as module
from defsense_fab.workflow.fabrication.assembly_guide import assembly_guide


@pytest.fixture
def build(monkeypatch):
    """Return a build with warnings, whose guide has no steps and tables."""
    functions = ("guide_steps", "exploded_shifts", "guide_tables", "guide_checks", "effort_table")
    for name in functions:
        monkeypatch.setattr(module, name, lambda *_: ())
    layout = SimpleNamespace(
        warnings=("a is silent", "try more cords", "thin"),
        warned_cords={"a is silent": "a"},
        middles={"a": np.array([5.0, 5, 5])},
    )
    manifest = SimpleNamespace(
        warnings=("thin", "cords are compressed"), places={"thin": np.array([1.0, 2, 3])}
    )
    return SimpleNamespace(layout=layout, manifest=manifest, parts={})


def test_each_warning_is_a_note_at_its_point_or_its_cord(build):
    notes = {note.text: note.point for note in assembly_guide(None, build).notes}
    assert list(notes) == ["thin", "cords are compressed", "a is silent", "try more cords"]
    assert notes["thin"].tolist() == [1, 2, 3]
    assert notes["a is silent"].tolist() == [5, 5, 5]
    assert notes["cords are compressed"] is notes["try more cords"] is None
