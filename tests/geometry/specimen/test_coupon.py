"""The fit coupon, measured on the exported facets."""

import json

import numpy as np
import pytest
import trimesh

from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import DefsenseError
from defsense_fab.geometry.kernels import triangle_kernel
from tests.geometry import slicer
from tests.support.errors import raises
from tests.support.surfaces import from_trimesh


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("coupon")
    options = ["--clearances", "0.3,0.1,0.2"]
    assert run_command(["calibrate", "coupon", str(out), *options]) == 0
    return out


def circles(points, count):
    """Middles along x and radii of circles through the points of a section, which are reported
    apart by the gaps between them."""
    points = points[np.argsort(points[:, 0])]
    breaks = np.argsort(np.diff(points[:, 0]))[-(count - 1) :] + 1
    circles_found = []
    for part in np.split(points, np.sort(breaks)):
        A = np.column_stack([part, np.ones(len(part))])
        a, b, c = np.linalg.lstsq(A, (part**2).sum(1), rcond=None)[0]
        circles_found.append((a / 2, np.sqrt(c + (a / 2) ** 2 + (b / 2) ** 2)))
    return np.array(circles_found).T


def grooves_of(mesh):
    low, high = mesh.bounds
    across = mesh.section(plane_origin=[0, low[1] + 1, 0], plane_normal=[0, 1, 0]).vertices[
        :, [0, 2]
    ]
    inside = (np.abs(across[:, 0]) < high[0] - 0.1) & (across[:, 1] > 4)
    return circles(across[inside & (across[:, 1] < high[2] - 0.01)], 3)


def test_grooves_and_sockets_have_their_clearance(folder):
    mesh = trimesh.load(folder / "coupon-plate.stl")
    assert mesh.is_watertight
    low, high = mesh.bounds
    assert grooves_of(mesh)[1] == pytest.approx([1.05, 1.1, 1.15], abs=0.02)
    level = mesh.section(plane_origin=[0, 0, high[2] - 3], plane_normal=[0, 0, 1]).vertices[:, :2]
    sockets = level[np.abs(level[:, 1] - low[1] - 7) < 3]
    sockets = sockets[np.abs(sockets[:, 0]) < high[0] - 0.1]
    assert circles(sockets, 3)[1] == pytest.approx([2.05, 2.1, 2.15], abs=0.02)
    data = json.loads((folder / "coupon.json").read_text("utf-8"))
    assert data["clearances"] == [0.1, 0.2, 0.3]
    assert data["grooves"] == pytest.approx([2.1, 2.2, 2.3])
    peg = trimesh.load(folder / "coupon-peg.stl")
    assert peg.extents == pytest.approx([12, 12, 9.5], abs=0.02)


def test_a_cord_passes_between_two_plates(folder):
    """The same plate turned over closes each groove with its like, from edge to edge."""
    mesh = trimesh.load(folder / "coupon-plate.stl")
    turned = mesh.copy()
    top = [0, 0, mesh.bounds[1, 2]]
    turned.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0], top))
    closed = [triangle_kernel.to_manifold(from_trimesh(m), "plate") for m in (mesh, turned)]
    for x, radius in grooves_of(mesh).T:
        y = np.linspace(-20, 20, 3)
        line = np.stack([np.full(3, x), y, np.full(3, top[2])], axis=1)
        normal = np.array([0, 0, 1.0])
        cord = triangle_kernel.tube(line, normal, 2 * radius - 0.05)
        assert sum((cord ^ half).volume() for half in closed) < 1e-3
        cord = triangle_kernel.tube(line, normal, 2 * radius + 0.1)
        assert sum((cord ^ half).volume() for half in closed) > 1


@pytest.mark.peer
def test_slicer_accepts_both(folder):
    slicer.accept(folder)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("0.1,0.1", "clearances-invalid"),
        ("-0.1,0.2", "out-of-range"),
        ("0.1,9", "out-of-range"),
        ("0.1,nan", "clearances-invalid"),
        ("a", "argument-invalid"),
        (",".join(str(n / 100) for n in range(25)), "part-too-large"),
    ],
)
def test_impossible_coupons_are_refused(tmp_path, text, code):
    out = tmp_path / "out"
    with raises(DefsenseError, code):
        run_command(["calibrate", "coupon", str(out), f"--clearances={text}"])
    assert not out.exists()
