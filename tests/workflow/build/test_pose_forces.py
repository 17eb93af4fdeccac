"""The forces of poses that a build stores."""

import json

import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from defsense_fab.store.build import Build
from defsense_fab.store.forces import HeldRecord
from defsense_fab.workflow.build.pose_forces import pose_forces
from defsense_fab.workflow.changed_values import changed_device


def test_forces_are_those_of_the_material(saved, capsys):
    """M = E I angle / L for 12 MPa, 20 x 20 mm, and 69 mm between the ends.

    The held ends stiffen a bar this short by about 14 %.
    """
    assert main(["optimize", str(saved), "--json"]) == 0
    bend, twist = json.loads(capsys.readouterr().out)["forces"]["poses"]
    assert (bend["pose"], bend["state"], twist["state"]) == ("bend", "bend@1", "twist@1")
    (tip,) = bend["held"]
    moment = 12 * 20**4 / 12 * np.deg2rad(20) / 69
    assert tip["moment"][1] == pytest.approx(moment, rel=0.2)
    assert np.abs(tip["force"]).max() < 1e-3 * moment / 69
    assert bend["power"] == pytest.approx(tip["moment"][1] * np.deg2rad(20))
    assert tip["push"] == pytest.approx(2 * moment / 69, rel=0.2)


def test_forces_are_proportional_to_the_modulus(saved):
    device, build = load_device(saved), Build(saved / "build")
    text = (saved / "device.toml").read_text(encoding="utf-8")
    stiffer = changed_device(text, saved, {"material.young_modulus": 120.0})
    before, after = (
        pose_forces(d, build.quadratic_mesh, build.fields).poses for d in (device, stiffer)
    )
    for soft, stiff in zip(before, after, strict=True):
        assert stiff.power == pytest.approx(10 * soft.power, rel=1e-4)
        assert stiff.push == pytest.approx(10 * soft.push, rel=1e-4)


def test_a_pose_of_gravity_alone_moves_no_region(saved):
    text = (saved / "device.toml").read_text(encoding="utf-8")
    build = Build(saved / "build")
    hang = [{"name": "bend", "fixed": ["base"], "gravity": [0, 0, -1]}]
    device = changed_device(text, saved, {"poses": hang, "states": {"ramp": [0.5, 1.0]}})
    (forces,) = pose_forces(device, build.quadratic_mesh, build.fields).poses
    assert (forces.held, forces.push, forces.power) == ((), 0.0, 0.0)


def test_a_turned_place_has_a_torque_instead_of_a_force_at_its_edge():
    none = np.zeros(3)
    bent = HeldRecord("tip", 5.0, none, np.array([240.0, 0, 0]))
    turned = HeldRecord("tip", 56.0, none, np.array([0, 0, 500.0]))
    assert bent.describe() == "5 N at 'tip', 0.24 N m"
    assert turned.describe() == "0.5 N m at 'tip'"
