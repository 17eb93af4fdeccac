"""Closed cavities of CAD solids."""

import build123d as bd
import numpy as np
import pytest

from defsense_fab.core.device.device import BodySpec
from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.cad_solid import make_cad_solid
from defsense_fab.geometry.kernels import occ
from tests.support.errors import raises

HOLLOW = bd.Box(40, 20, 20) - bd.Pos(5, 0, 0) * bd.Sphere(4) - bd.Pos(-12, 0, 0) * bd.Sphere(1)
SOLIDS = [s.wrapped for s in HOLLOW.solids()]


def test_a_cavity_is_refused_with_its_place_or_filled():
    with raises(BodyError, "closed-cavity", count=2) as caught:
        make_cad_solid(SOLIDS, "x", (1, 1e4), 0.05, False, False)
    assert caught.value.data["volume"] == pytest.approx(4 / 3 * np.pi * 4**3)
    assert caught.value.data["at"] == pytest.approx([5, 0, 0], abs=1e-9)
    solid, surface, repairs = make_cad_solid(SOLIDS, "x", (1, 1e4), 0.05, False, True)
    assert occ.volume(solid) == pytest.approx(16000)
    assert surface.volume == pytest.approx(16000)
    assert len(repairs) == 1
    assert "268 mm3" in repairs[0]


def test_several_solids_are_reported_with_sizes_and_places():
    two = bd.Compound(children=[bd.Box(10, 10, 10), bd.Pos(50, 0, 0) * bd.Box(2, 2, 2)])
    solids = [s.wrapped for s in two.solids()]
    with raises(BodyError, "not-one-solid", count=2) as caught:
        make_cad_solid(solids, "x", (1, 1e4), 0.05, False, True)
    assert "1e+03 mm3 around (0, 0, 0); 8 mm3" in str(caught.value)


@pytest.mark.slow
def test_a_step_file_is_read_with_its_cavity_filled(tmp_path):
    occ.write_step(SOLIDS[0], tmp_path / "a.stp", "a")
    with raises(BodyError, "closed-cavity", count=2) as caught:
        load_body(BodySpec("step", tmp_path / "a.stp"))
    assert caught.value.data["volume"] == pytest.approx(4 / 3 * np.pi * 4**3)
    body = load_body(BodySpec("step", tmp_path / "a.stp", fill_cavities=True))
    assert body.volume == pytest.approx(16000)
    assert occ.volume(body.solid) == pytest.approx(16000)
    assert body.repairs
