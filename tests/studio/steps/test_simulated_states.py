"""What the step Poses shows of simulated states."""

import shutil

import numpy as np

from defsense_fab.core.device.device_file import load_device
from defsense_fab.store.build import Build
from defsense_fab.store.forces import ForcesRecord, HeldRecord, PoseForces, save_forces
from defsense_fab.studio.steps.poses.simulated_states import simulated_states


def test_a_pose_that_is_too_hard_has_a_warning(live_bar, tmp_path):
    device = load_device(live_bar.folder)
    shutil.copytree(live_bar.folder / "build" / "fields", tmp_path / "fields")
    name = device.poses[0].name
    held = HeldRecord("tip", 230.0, np.zeros(3), np.array([2800.0, 0, 0]))
    save_forces(tmp_path, ForcesRecord((PoseForces(name, f"{name}@1", 1.0, (held,)),)))
    (forces,) = simulated_states(Build(tmp_path), device, is_current=True).forces
    assert (forces.effort, forces.held[0].torque) == ("hand", 2.8)
    assert "2.8 N m" in forces.warning
