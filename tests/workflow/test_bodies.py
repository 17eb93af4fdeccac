"""Test the units, repairs and sizes of bodies that are given in Python."""

import numpy as np
import pytest
import trimesh

import defsense_fab as df
from tests.support.errors import raises
from tests.workflow.conftest import small_bar


def box(scale, faces=12):
    """Return the bar of the other tests in another unit, with some of its triangles."""
    mesh = trimesh.creation.box(extents=np.array([80, 20, 20]) * scale)
    mesh.apply_translation([40 * scale, 0, 0])
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:faces], process=False)


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["m", "inch"])
def test_unusual_size_is_refused_with_the_likely_unit(unit, tmp_path):
    scale = {"m": 1000.0, "inch": 25.4}[unit]
    path = tmp_path / "bar.stl"
    box(1 / scale).export(path)
    with raises(df.DefsenseError, "unit-doubtful", unit=unit):
        small_bar(body=path)
    device = small_bar(body=path, units=unit)
    assert device.record.body.scale == scale
    assert device.notes == ()


@pytest.mark.slow
def test_vertices_and_faces_have_units():
    with raises(df.DefsenseError, "unit-doubtful", unit="m"):
        small_bar(body=box(0.001))
    assert small_bar(body=box(0.001), units="metres").record.body.scale == 1000.0


@pytest.mark.parametrize(
    ("units", "code"), [("mile", "unknown-unit"), ("um", "body-size-impossible")]
)
def test_invalid_units_are_refused(units, code):
    with raises(df.DefsenseError, code):
        small_bar(units=units)


@pytest.mark.slow
def test_a_unit_of_a_cad_shape_is_refused():
    bd = pytest.importorskip("build123d")
    with raises(df.DefsenseError, "unit-not-applicable", unit="inch"):
        small_bar(body=bd.Box(80, 20, 20), units="inch")


def test_a_mesh_is_scaled_to_a_size():
    assert small_bar(body=box(0.02), size=80).record.body.scale == pytest.approx(50)
    with raises(df.DefsenseError, "options-conflict", option="size"):
        small_bar(body=box(0.02), size=80, units="mm")
    with raises(df.DefsenseError, "not-a-number"):
        small_bar(body=box(0.02), size=-1)


@pytest.mark.slow
def test_repairs_and_an_unusual_size_are_noted():
    device = small_bar(body=box(0.01, faces=11), units="m")
    repair, size = device.notes
    assert "1 hole" in repair
    assert "800 mm" in size
    assert device.changed({"cord.noise": 0.01}).notes == device.notes


def test_a_cavity_is_filled():
    hollow = trimesh.creation.box(extents=[20, 10, 10])
    hollow.apply_translation([40, 0, 0])
    hollow.invert()
    device = small_bar(body=trimesh.util.concatenate([box(1.0), hollow]))
    assert device.record.body.fill_cavities
    assert len(device.notes) == 1
