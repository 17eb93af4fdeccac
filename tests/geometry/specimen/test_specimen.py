"""The specimen and its jigs, measured on the exported facets."""

import json

import numpy as np
import pytest
import trimesh

from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import DefsenseError, FabricationError
from defsense_fab.core.mesh import Surface
from defsense_fab.core.response import JIG_RADII_MM
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.specimen.specimen import Specimen
from defsense_fab.workflow.calibrate.calibration_parts import PrintPart, write_specimen
from defsense_fab.workflow.calibrate.options import PrintOptions, SpecimenOptions
from tests.geometry import slicer
from tests.support.errors import raises
from tests.support.surfaces import distance, from_trimesh

pytestmark = pytest.mark.slow

WITHIN = 0.05  # mm
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("specimen")
    assert run_command(["calibrate", "specimen", str(out)]) == 0
    return out


def load(folder, name):
    mesh = trimesh.load(folder / f"{name}.stl")
    assert mesh.is_watertight
    assert mesh.volume > 0
    return mesh


def test_halves_have_the_requested_size(folder):
    left, right = (load(folder, f"specimen-{side}") for side in ("left", "right"))
    assert left.extents == pytest.approx([150, 15, 10 + 4], abs=WITHIN)  # pins stand up
    assert right.extents == pytest.approx([150, 15, 10], abs=WITHIN)
    for mesh in (left, right):
        assert mesh.bounds[0, 2] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("side", ["left", "right"])
def test_channels_lie_where_the_strain_is_known(folder, side):
    """Grooves in the cut face at 2, 7.5 and 13 of 15 mm, of the cord's diameter and clearance."""
    mesh = load(folder, f"specimen-{side}")
    section = mesh.section(plane_origin=[30, 0, 0], plane_normal=[1, 0, 0])
    y, z = section.vertices[:, 1], section.vertices[:, 2]
    across = y + 7.5  # from the side that lies on the jig, or the other way about: the same
    for height in (2.0, 7.5, 13.0):
        near = (np.abs(across - height) < 1.3) & (z > 1) & (z < 9.9)
        distance = np.hypot(across[near] - height, z[near] - 10)
        assert near.sum() > 8
        assert distance.max() == pytest.approx(1.1, abs=WITHIN)
        assert distance.min() == pytest.approx(1.1, abs=WITHIN)


@pytest.mark.parametrize("radius", JIG_RADII_MM)
def test_jigs_have_their_radius(folder, radius):
    """A circle through the corners of the facets that the specimen lies on."""
    mesh = load(folder, f"jig-{radius:g}")
    reach = radius * np.sin(0.95 * Specimen().half_angle(radius))
    middle = mesh.triangles_center
    between_rails = np.abs(middle[:, 2] - mesh.extents[2] / 2) < 9.9
    outward = (mesh.face_normals[:, 1] < -0.3) & (np.abs(mesh.face_normals[:, 2]) < 1e-3)
    lowest = mesh.bounds[0, 1] + radius * (1 - np.cos(Specimen().half_angle(radius))) + 9
    under = between_rails & outward & (np.abs(middle[:, 0]) < reach) & (middle[:, 1] < lowest)
    x, y = mesh.vertices[np.unique(mesh.faces[under])][:, :2].T
    assert np.ptp(x) > 1.5 * reach
    A = np.stack([x, y, np.ones_like(x)], axis=1)
    a, b, c = np.linalg.lstsq(A, x**2 + y**2, rcond=None)[0]
    assert np.sqrt(c + (a / 2) ** 2 + (b / 2) ** 2) == pytest.approx(radius, abs=WITHIN)
    assert np.abs(np.hypot(x - a / 2, y - b / 2) - radius).max() < WITHIN
    assert a / 2 == pytest.approx(0, abs=WITHIN)
    assert (mesh.extents[:2] < 220).all()


def test_halves_fit_together_with_the_process_clearance(folder):
    left, right = (load(folder, f"specimen-{side}") for side in ("left", "right"))
    right.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0], [0, 0, 10]))
    assert overlap(left, right) < 1e-3
    pins = left.vertices[left.vertices[:, 2] > 11]
    gap = distance(from_trimesh(right), pins).min()
    assert gap == pytest.approx(0.1, abs=0.02)  # 0.2 mm on the diameter
    right.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [0, 0, 1], [0, 0, 0]))
    assert overlap(left, right) > 1  # turned round it does not fit


def overlap(a, b):
    """mm^3"""
    one, other = (triangle_kernel.to_manifold(from_trimesh(m), "a half") for m in (a, b))
    return (one ^ other).volume()


def test_strains_equal_those_of_the_paper(folder):
    """METHOD: 6.7 % at a radius of 75 mm and 2.1 % at 250 mm, 5.5 mm off the neutral plane."""
    data = json.loads((folder / "specimen.json").read_text("utf-8"))
    strains = {j["radius"]: j["strains"] for j in data["jigs"]}
    assert strains[75.0] == pytest.approx([-0.0667, 0, 0.0667], abs=1e-4)
    assert strains[250.0] == pytest.approx([-0.0214, 0, 0.0214], abs=1e-4)
    assert strains[None] == [0, 0, 0]
    assert data["warnings"] == []


@pytest.fixture
def no_parts(monkeypatch):
    """Specimens without the time that their solids take."""
    files = "defsense_fab.workflow.calibrate.calibration_parts"
    monkeypatch.setattr("defsense_fab.geometry.specimen.jig.make_jig", lambda *_: None)
    monkeypatch.setattr("defsense_fab.geometry.specimen.specimen.make_halves", lambda *_: {})
    monkeypatch.setattr(
        f"{files}.PrintPart.from_solid", lambda *_: PrintPart(Surface(CORNERS, FACES), None)
    )
    monkeypatch.setattr(f"{files}.write_prints", lambda folder, _, data, file: data)


@pytest.mark.parametrize("process", read_rows("printers.csv"))
@pytest.mark.parametrize("cord", read_rows("cords.csv"))
def test_defaults_cause_no_warnings(no_parts, tmp_path, process, cord):
    """The paper's offset of 2 mm, on its printer above all."""
    record = write_specimen(tmp_path, printing=PrintOptions(cord, process))
    assert record["warnings"] == []
    skin = record["offset"] - record["channel_diameter"] / 2
    assert skin >= 2 * float(read_rows("printers.csv")[process]["line"]) - 1e-6
    assert record["offset"] == 2 or process not in ("fdm-tpu", "polyjet")


def test_thin_skin_is_reported_with_a_sufficient_offset(no_parts, tmp_path):
    warnings = write_specimen(tmp_path, SpecimenOptions(offset=1.7))["warnings"]
    assert len(warnings) == 1
    assert all(fact in warnings[0] for fact in ("0.60 mm", "0.80 mm", "fdm-tpu", "1.9"))
    assert write_specimen(tmp_path, SpecimenOptions(offset=1.9))["warnings"] == []


@pytest.mark.peer
def test_slicer_accepts_all_parts(folder):
    slicer.accept(folder)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--offset", "1"], "offset-too-small"),
        (["--thickness", "5"], "thickness-too-small"),
        (["--radii", "20"], "radius-too-small"),
        (["--radii", "75,nan"], "radii-invalid"),
        (["--radii", "75,x"], "argument-invalid"),
        (["--length", "nan"], "out-of-range"),
        (["--length", "260", "--radii", "300"], "part-too-large"),
        (["--cord", "wire"], "unknown-cord"),
        (["--process", "cnc"], "unknown-process"),
    ],
)
def test_impossible_specimens_are_refused(tmp_path, arguments, code):
    out = tmp_path / "out"
    with raises(DefsenseError, code):
        run_command(["calibrate", "specimen", str(out), *arguments])
    assert not out.exists()


def test_suggested_minimum_works():
    with raises(FabricationError, "thickness-too-small") as caught:
        Specimen(thickness=12.0)
    assert caught.value.data["least"] == pytest.approx(12.4)
    assert Specimen(thickness=12.4).pin == pytest.approx(1.0)
