"""Closed cavities of CAD solids."""

import build123d as bd
import pytest

from defsense_fab.core.device.device import BodySpec
from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.cad_solid import cad_solid
from defsense_fab.geometry.kernels import occ

HOLLOW = bd.Box(40, 20, 20) - bd.Pos(5, 0, 0) * bd.Sphere(4) - bd.Pos(-12, 0, 0) * bd.Sphere(1)
SOLIDS = [s.wrapped for s in HOLLOW.solids()]


def test_a_cavity_is_refused_with_its_place_or_filled():
    told = r"a closed cavity of 268 mm3 around \(5, 0, 0\) and 1 smaller"
    with pytest.raises(BodyError, match=rf"^x: {told} .* fill_cavities = true"):
        cad_solid(SOLIDS, "x", (1, 1e4), 0.05, False, False)
    made = cad_solid(SOLIDS, "x", (1, 1e4), 0.05, False, True)
    assert made.volume == pytest.approx(16000)
    assert made.surface.volume == pytest.approx(16000)
    assert made.repairs[0].startswith("filled a closed cavity of 268 mm3")


def test_several_solids_are_told_with_sizes_and_places():
    two = bd.Compound(children=[bd.Box(10, 10, 10), bd.Pos(50, 0, 0) * bd.Box(2, 2, 2)])
    solids = [s.wrapped for s in two.solids()]
    with pytest.raises(
        BodyError, match=r"gives 2 solids, .*: 1e\+03 mm3 around \(0, 0, 0\); 8 mm3"
    ):
        cad_solid(solids, "x", (1, 1e4), 0.05, False, True)


@pytest.mark.slow
def test_a_step_file_is_read_with_its_cavity_filled(tmp_path):
    occ.write_step(SOLIDS[0], tmp_path / "a.stp", "a")
    with pytest.raises(BodyError, match=r"a\.stp: a closed cavity of 268 mm3"):
        load_body(BodySpec("step", tmp_path / "a.stp"))
    body = load_body(BodySpec("step", tmp_path / "a.stp", fill_cavities=True))
    assert body.volume == pytest.approx(16000)
    assert occ.volume(body.solid) == pytest.approx(16000)
    assert body.repairs
