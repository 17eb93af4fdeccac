"""Test that the device of `make demo` stays what its documentation promises to a maker."""

import re
import shutil

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.store.build import Build
from defsense_fab.workflow.build.build import build
from tests.geometry.slicer import estimate_hours
from tests.support.places import DEVICES, ROOT
from tests.support.shared_folders import fill_once

pytestmark = pytest.mark.slow

DEMO = re.search(r"defsense build fixtures/devices/(\S+)", (ROOT / "Makefile").read_text("utf-8"))[
    1
]
MAX_FORCE_N, MAX_TORQUE_NM = 5.0, 0.3  # that a hand exerts easily
MAX_PUSH_N = 6.0  # that device.toml states
MAX_ERROR_SHARE = 0.03  # of the largest movement


@pytest.fixture(scope="module")
def device():
    return load_device(DEVICES / DEMO)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    def fill(folder):
        skip = shutil.ignore_patterns("build", ".*")
        shutil.copytree(DEVICES / DEMO, folder, ignore=skip, dirs_exist_ok=True)
        build(load_device(folder))

    return Build(fill_once(tmp_path_factory, "demo", fill) / "build")


@pytest.fixture(scope="module")
def movements(device, built):
    """Return the largest displacement of the body in each pose, mm."""
    fields = built.fields
    largest = np.linalg.norm(fields.displacements, axis=2).max(axis=1)
    return {p.name: largest[fields.names.index(f"{p.name}@1")] for p in device.poses}


def test_demo_has_few_parts_of_printable_tpu(device, built):
    assert device.fabrication.process == "fdm-tpu"
    assert device.material.name == "ninjaflex-85a"
    manifest = built.manifest
    assert len(manifest.parts) in (2, 3)
    assert len(manifest.cords) <= 2
    assert sum(pin.count for pin in manifest.pins) == 2 * (len(manifest.parts) - 1)


def test_demo_builds_without_warnings(built):
    assert not built.field_index.warnings
    assert {s.status for s in built.field_index.states} == {"ok"}
    assert not built.layout.warnings
    assert not built.manifest.warnings


def test_a_hand_can_reach_every_pose(device, built, movements):
    # Energies grow with the square of the angle, so the moment is twice the energy divided by the
    # angle. Twice the energy divided by the movement is more than the force of a push at the top,
    # which reaches the same movement with less energy.
    energies = {s.state: s.energy for s in built.field_index.states}
    for pose in device.poses:
        half, whole = energies[f"{pose.name}@0.5"], energies[f"{pose.name}@1"]
        assert whole == pytest.approx(4 * half, rel=0.01)
        (handle,) = pose.handles
        assert 2 * whole / np.linalg.norm(handle.rotation) / 1000 < MAX_TORQUE_NM
        assert 2 * whole / movements[pose.name] < MAX_FORCE_N
    assert max(pose.push for pose in built.forces.poses) < MAX_PUSH_N


def test_predicted_error_is_small_beside_the_movement(built, movements):
    assert built.layout.band.trained.median < MAX_ERROR_SHARE * max(movements.values())


@pytest.mark.peer
def test_demo_prints_in_about_two_hours(built, tmp_path):
    (plate,) = built.folder.glob("parts/plate*.3mf")
    assert 1.5 < estimate_hours(plate, tmp_path) < 2.5
