"""A small bar with fields by formula, and a model of it."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.store.fields import FieldIndex, StateRecord, field_path, save_field, save_index
from defsense_fab.store.layout import layout_hash, load_layout, load_prediction
from defsense_fab.store.mesh import load_mesh
from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.training.fitting.model_file import write_model
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from tests.runtime.bars import bent, twisted
from tests.training.conftest import walk
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar = small_bar_fixture
R0 = np.array([1500.0, 900.0])
NAMES = ("cord_1", "cord_2")
SHARE = 0.3  # of the quarter circle and the turn of the formulas


def moved(points, bend, twist):
    """Return displacements (m, 3), mm."""
    return bent(points, SHARE * bend) + twisted(points, SHARE * twist)


def signals(levels):
    """Return signals (t, 2) at levels (t, 2) of bend and twist."""
    return np.stack(
        [0.12 * levels[:, 0] + 0.03 * levels[:, 1], 0.1 * levels[:, 1] - 0.02 * levels[:, 0]],
        axis=1,
    )


@dataclass
class LiveBar:
    folder: Path
    model: Path
    rest_points: np.ndarray

    def run(self, seconds, seed, rate=60.0):
        """Return a recording that starts with three seconds of rest, and its levels (n, 2)."""
        rng = np.random.default_rng(seed)
        time = np.arange(0.0, seconds, 1 / rate)
        levels = np.abs(walk(time, 2, rng)) * np.clip((time - 3) / 2, 0, 1)[:, None]
        ohm = R0 * (1 + signals(levels) + 2e-4 * rng.normal(size=(len(time), 2)))
        points = np.array([self.rest_points + moved(self.rest_points, *x) for x in levels])
        sigma = np.full(points.shape, 0.05)
        return Recording("run-1", "s", "1", time, ohm, R0, time, points, sigma), levels


@pytest.fixture(scope="session")
def live_bar(small_bar, tmp_path_factory):
    folder = tmp_path_factory.mktemp("live") / "bar"
    shutil.copytree(small_bar, folder, ignore=shutil.ignore_patterns("twin", "session*"))
    build = folder / "build"
    mesh = QuadraticMesh.from_linear(load_mesh(build))
    (build / "fields").mkdir(exist_ok=True)
    states = []
    for pose, at in (("bend_up", (0.5, 0.0)), ("bend_up", (1.0, 0.0)), ("twist", (0.0, 0.5)),
                     ("twist", (0.0, 1.0))):  # fmt: skip
        level = max(at)
        name = f"{pose}@{level:g}"
        save_field(field_path(build, name), mesh, moved(mesh.nodes, *at), {})
        states.append(StateRecord(name, {pose: level}, False, "ok", 1, 1, 1, 0.0, 1.0))
    save_index(build, FieldIndex("neo-hookean", "formula", (), tuple(states)))
    markers = load_prediction(build).markers
    bar = LiveBar(folder, folder / "model.json", markers)
    hash_ = layout_hash(load_layout(build))
    recording, _ = bar.run(90.0, 0)
    dataset = Dataset(
        load_device(folder).name, hash_, NAMES, np.arange(len(markers)), markers, (recording,),
        {"sessions": [{"reference": dict(zip(NAMES, (1500.0, 1000.0), strict=True))}]},
    )  # fmt: skip
    model = train(dataset, TrainOptions(decoder="quadratic", memory=False)).model
    from dataclasses import replace

    metadata = {"provenance": dict(dataset.provenance), "R0": {"run-1": R0.tolist()}}
    write_model(bar.model, replace(model, metadata=metadata))
    return bar
