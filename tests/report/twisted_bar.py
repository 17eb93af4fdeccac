"""A bar of three parts whose shape in every pose is known in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from defsense_fab.core.mesh import Surface
from defsense_fab.core.storage import typed_json
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.report.surface_errors import SurfaceErrors
from defsense_fab.report.viewer.scene import Scene, scene
from defsense_fab.store.build import Build
from defsense_fab.store.fields import Fields
from defsense_fab.store.layout import PREDICTION, PredictionRecord
from defsense_fab.store.manifest import (
    CordEnd,
    CutCord,
    JoinedPin,
    JoinStep,
    Manifest,
    PartRecord,
    PinRecord,
    TagSeat,
    WireRecord,
)
from defsense_fab.store.mesh import MeshRecord, save_mesh
from tests.conftest import box_surface
from tests.support.grid import grid_of_tets

LENGTH, HALF = 120.0, 12.0  # mm
TURN = np.radians(60)  # of the end, at the full twist
#: Name, weights, held out; the error of the predicted surface is MISS mm along y times the weight.
STATES = (
    ("twist@0.5", {"twist": 0.5}, False),
    ("twist@1", {"twist": 1.0}, False),
    ("1*twist+1*bend", {"twist": 1.0, "bend": 1.0}, False),
    ("0.5*twist+1*bend", {"twist": 0.5, "bend": 1.0}, True),
)
MISS = 0.8
FRAME = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
FRONT, BACK, TOP = "front", "back</script><b>", "top"


def displaced(points, weights):
    """Return displacements (n, 3), mm: sections turn about x, and sink with the square of x."""
    x, y, z = np.asarray(points, float).T
    angle = TURN * weights.get("twist", 0.0) * x / LENGTH
    sink = 20 * weights.get("bend", 0.0) * (x / LENGTH) ** 2
    turned = y * np.cos(angle) - z * np.sin(angle), y * np.sin(angle) + z * np.cos(angle) - sink
    return np.stack([np.zeros_like(x), turned[0] - y, turned[1] - z], axis=1)


@dataclass
class TwistedBar:
    folder: Path
    parts: dict[str, Surface]
    manifest: Manifest
    layout: SimpleNamespace
    device: SimpleNamespace
    errors: SurfaceErrors

    def scene(self) -> Scene:
        build = Build(self.folder)
        build.layout, build.manifest, build.parts = self.layout, self.manifest, self.parts
        return scene(self.device, build, self.errors, FRAME)


def twisted_bar(folder: Path, cells: tuple[int, int, int] = (12, 4, 4)) -> TwistedBar:
    """Write the files that the view reads to a build's folder, and return the bar."""
    low, high = [0, -HALF, -HALF], [LENGTH, HALF, HALF]
    mesh = grid_of_tets(
        [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, cells, strict=True)]
    )
    record = MeshRecord("0" * 16, 10.0, len(mesh.tets), len(mesh.nodes), 40.0, 0.0, 0.0)
    save_mesh(folder, mesh, {}, record)
    signals = np.array([[0, 0]] + [[0.1 * sum(w.values()), -0.05] for _, w, _ in STATES])
    prediction = PredictionRecord(
        np.zeros((0, 3)), ("rest", *(n for n, _, _ in STATES)), signals, np.zeros((5, 0)), {}
    )
    typed_json.save(folder / PREDICTION, prediction)
    parts = {
        FRONT: box_surface([0, -HALF, -HALF], [LENGTH, 0, 0]),
        BACK: box_surface([0, 0, -HALF], [LENGTH, HALF, 0]),
        TOP: box_surface([0, -HALF, 0], [LENGTH, HALF, HALF]),
    }
    paths = {
        "level": np.stack([np.linspace(2, 118, 60), np.full(60, 5.0), np.zeros(60)], 1),
        "upright": np.stack([np.linspace(2, 118, 60), np.zeros(60), np.full(60, -5.0)], 1),
    }
    return TwistedBar(
        folder,
        parts,
        _manifest(parts, paths),
        SimpleNamespace(sensors=[_record(name, path) for name, path in paths.items()]),
        SimpleNamespace(
            name="bar <!-- & </script>",
            fabrication=SimpleNamespace(wire_diameter=0.8),
            cord=SimpleNamespace(noun="cord", trace=None),
        ),
        _surface_errors(mesh),
    )


def _record(name, path):
    return SimpleNamespace(
        name=name,
        points=path,
        cord_diameter=2.0,
        length=116.0,
        prestretch=0.06,
        least_strain=0.01,
        peak_strain=0.1,
    )


def _manifest(parts, paths):
    wire = np.array([[2.0, 5, 0], [1, 5, 0], [0, 6, 0]])
    ends = tuple(
        CordEnd("pocket", 7.0, np.zeros(3), 0.0, WireRecord("bend", 3.0, path))
        for path in (wire, None)
    )
    cords = [
        CutCord(
            name,
            118.0,
            5.0,
            116.0,
            110.0,
            104.0,
            0.06,
            110.0,
            ends,
            2.2,
            1500.0,
            1600.0,
            (1500.0, 1800.0),
            1600.0,
        )
        for name in paths
    ]
    pin = JoinedPin("pin-4x10", np.array([60.0, 0, -8]), 4.2, 5.2, (FRONT, BACK))
    level = np.array([0, 0, 1.0])
    return Manifest(
        "bar",
        "mm",
        tuple(
            PartRecord(n, k, f"{n}.stl", "", None, s.volume, s.bounds, ())
            for k, (n, s) in enumerate(parts.items())
        ),
        (PinRecord("pin-4x10", "", 1, 4.0, 10.0),),
        (),
        tuple(cords),
        "held",
        (),
        (
            JoinStep(((FRONT,), (BACK,)), ("upright",), (), np.array([0, 1.0, 0]), (pin,)),
            JoinStep(((FRONT, BACK), (TOP,)), ("level",), (), level, ()),
        ),
        (TagSeat(3, np.array([60.0, 0, HALF]), np.array([1.0, 0, 0]), level, 10.0),),
        (),
        None,
        0.0,
        1.0,
        (),
    )


def _surface_errors(mesh):
    boundary, used = mesh.boundary().compact()
    nodes = QuadraticMesh.from_linear(mesh).nodes
    names, weights, held_out = zip(*STATES, strict=True)
    fields = Fields(
        names,
        weights,
        np.array(held_out),
        np.array([displaced(nodes, w) for w in weights]),
        np.array([sum(w.values()) * nodes[:, 0] / LENGTH / 10 for w in weights]),
    )
    missed = np.array([np.tile([0, MISS * sum(w.values()), 0], (len(used), 1)) for w in weights])
    error = np.linalg.norm(missed, axis=2)
    return SurfaceErrors(
        names,
        weights,
        fields.held_out,
        boundary.vertices,
        boundary.faces,
        fields.displacements[:, used],
        fields.strains[:, used],
        missed,
        error,
        (1, 2, 3),
        float(error.max()),
        fields,
    )
