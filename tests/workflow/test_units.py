"""The unit of a mesh is said, or told by its size; what is doubtful is not taken for mm."""

import numpy as np
import pytest
import trimesh

import defsense_fab as df
from tests.workflow.conftest import small_bar


def box(scale, faces=12):
    """The bar of the other tests in another unit, with so many of its triangles."""
    made = trimesh.creation.box(extents=np.array([80, 20, 20]) * scale)
    made.apply_translation([40 * scale, 0, 0])
    return trimesh.Trimesh(made.vertices, made.faces[:faces], process=False)


@pytest.mark.parametrize("unit", ["m", "inch"])
def test_a_size_that_is_none_of_mm_is_refused_with_what_it_is_likely_in(unit, tmp_path):
    scale = {"m": 1000.0, "inch": 25.4}[unit]
    path = tmp_path / "bar.stl"
    box(1 / scale).export(path)
    with pytest.raises(df.DefsenseError, match=f'in millimetres .* give units="{unit}"'):
        small_bar(body=path)
    made = small_bar(body=path, units=unit)
    assert made.record.body.scale == scale
    assert made.notes == ()


def test_vertices_and_faces_have_units_too():
    with pytest.raises(df.DefsenseError, match='give units="m"'):
        small_bar(body=box(0.001))
    assert small_bar(body=box(0.001), units="metres").record.body.scale == 1000.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"units": "mile"}, "units mile: there is mm"),
        ({"units": 5}, "units: must be text, not 5"),
        ({"units": "um"}, "would be 0.085 mm across; .*: choose another unit"),
    ],
)
def test_units_that_cannot_be_are_told(changes, message):
    with pytest.raises(df.DefsenseError, match=message):
        small_bar(**changes)


def test_a_shape_has_its_own_unit():
    bd = pytest.importorskip("build123d")
    with pytest.raises(df.DefsenseError, match='units="inch": is for meshes'):
        small_bar(body=bd.Box(80, 20, 20), units="inch")


def test_what_was_mended_of_a_body_and_an_unusual_size_are_told():
    made = small_bar(body=box(0.01, faces=11), units="m")
    mended, size = made.notes
    assert mended.startswith("the body was mended: closed 1 hole")
    assert size.startswith("800 mm is unusually long")
    assert made.changed({"cord.noise": 0.01}).notes == made.notes


def test_a_cavity_is_filled_as_a_new_device_s_is():
    hollow = trimesh.creation.box(extents=[20, 10, 10])
    hollow.apply_translation([40, 0, 0])
    hollow.invert()
    made = small_bar(body=trimesh.util.concatenate([box(1.0), hollow]))
    assert made.record.body.fill_cavities
    assert "filled" in made.notes[0]
