"""Compare force and torque of poses with beam theory, and with what a hand can do."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.printing.export import write_stl
from defsense_fab.store.forces import ForcesRecord, HeldRecord, PoseForces
from defsense_fab.store.hand_strength import FINGERS, HAND, judge_effort
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.pose_forces import pose_forces
from tests.conftest import box_surface

YOUNG, NU = 12.0, 0.48  # MPa, of ninjaflex-85a
LENGTH, WIDTH, HEIGHT, HELD = 200.0, 16.0, 8.0, 8.0
FREE_LENGTH = LENGTH - 2 * HELD  # between the held ends, mm
DEGREES, TWIST, PUSH, PULL = 90.0, 40.0, 80.0, 4.0
BENDING = YOUNG * WIDTH * HEIGHT**3 / 12
#: Of a rectangle twice as wide as high (Timoshenko & Goodier 1970, section 109).
TORSION = YOUNG / (2 * (1 + NU)) * 0.229 * WIDTH * HEIGHT**3

DEVICE = f"""schema = 1
name = "beam"
[body]
mesh = "beam.stl"
[material]
name = "ninjaflex-85a"
[mesh]
edge_length = 6.0
[regions]
base = {{ box = [[-1, -9, -5], [{HELD}, 9, 5]] }}
tip = {{ box = [[{LENGTH - HELD}, -9, -5], [{LENGTH + 1}, 9, 5]] }}
[[poses]]
name = "bend"
fixed = ["base"]
[[poses.handles]]
region = "tip"
rotate = {{ axis = [0, 1, 0], degrees = {DEGREES} }}
translate = "free"
[[poses]]
name = "push"
fixed = ["base"]
[[poses.handles]]
region = "tip"
rotate = {{ axis = [0, 1, 0], degrees = "free" }}
translate = ["free", 0, {PUSH}]
[[poses]]
name = "twist"
fixed = ["base"]
[[poses.handles]]
region = "tip"
rotate = {{ axis = [1, 0, 0], degrees = {TWIST} }}
translate = "free"
[[poses]]
name = "pull"
fixed = ["base"]
handles = [{{ region = "tip", translate = [{PULL}, 0, 0] }}]
[states]
ramp = [0.5, 1.0]
mixtures = []
held_out = []
[outputs]
markers = 8
[cord]
name = "rubber-2mm"
[design]
sensors = 1
"""


@pytest.fixture(scope="module")
def tips(tmp_path_factory):
    """The forces at the tip of a slender beam, by pose."""
    folder = tmp_path_factory.mktemp("beam")
    write_stl(box_surface([0, -8, -4], [LENGTH, 8, 4]), folder / "beam.stl")
    (folder / "device.toml").write_text(DEVICE)
    device = load_device(folder)
    results = build(device, "simulate").results
    record = pose_forces(device, results.quadratic_mesh, results.fields)
    assert all(p.state.endswith("@1") for p in record.poses)
    return {p.pose: p.held[0] for p in record.poses}


def push_of_elastica(deflection, length):
    """Return the force that moves the end of a cantilever sideways, for large rotations, N.

    The angle of the axis obeys EI theta'' = -F cos(theta), with theta(0) = 0 and theta'(L) = 0.
    """

    def shoot(force, curvature):
        def slope(_, y):
            return [y[1], -force / BENDING * np.cos(y[0]), np.sin(y[0])]

        return solve_ivp(slope, (0, length), [0.0, curvature, 0.0], rtol=1e-8, atol=1e-10).y[:, -1]

    def deflect(force):
        limit = force * length / BENDING
        curvature = brentq(lambda k: shoot(force, k)[1], 0.0, limit)
        return shoot(force, curvature)[2]

    small = 3 * BENDING * deflection / length**3
    return brentq(lambda force: deflect(force) - deflection, 0.5 * small, 3 * small)


def test_a_couple_bends_a_beam_into_an_arc(tips):
    """M = E I angle / L at any angle. The held ends stiffen the beam a little."""
    moment = BENDING * np.deg2rad(DEGREES) / FREE_LENGTH
    assert tips["bend"].moment[1] == pytest.approx(moment, rel=0.06)
    assert np.linalg.norm(tips["bend"].force) < 0.1 * moment / FREE_LENGTH


def test_a_force_bends_a_cantilever_far(tips):
    """The force acts at the middle of the moved region, which turns freely."""
    force = push_of_elastica(PUSH, FREE_LENGTH + HELD / 2)
    linear = 3 * BENDING * PUSH / (FREE_LENGTH + HELD / 2) ** 3
    assert force > 1.05 * linear
    assert tips["push"].force[2] == pytest.approx(force, rel=0.06)


def test_a_torque_twists_a_rectangle(tips):
    """Each held end cannot warp, which shortens the beam by sqrt(E I_w / (G J)) (Vlasov)."""
    warping = YOUNG * WIDTH**3 * HEIGHT**3 / 144
    torque = TORSION * np.deg2rad(TWIST) / (FREE_LENGTH - 2 * np.sqrt(warping / TORSION))
    assert tips["twist"].torque == pytest.approx(torque, rel=0.06)


def test_a_force_stretches_a_beam(tips):
    """A neo-Hookean body of this Poisson's ratio is a little softer than E A d / L at 2 %."""
    force = YOUNG * WIDTH * HEIGHT * PULL / FREE_LENGTH
    assert tips["pull"].force[0] == pytest.approx(force, rel=0.06)
    assert tips["pull"].push == pytest.approx(force, rel=0.06)


def test_the_easier_of_turning_and_pushing_counts():
    twist, bend = (900.0, 0.0, 1500.0), (13.0, 0.0, 3400.0)  # push N, force N, moment N mm
    assert judge_effort(*twist) == judge_effort(*bend) == "fingers"
    assert judge_effort(900.0, 0.0, 2800.0) == "hand"
    assert judge_effort(900.0, 0.0, 5000.0) == "beyond"
    assert [judge_effort(f, f, 0.0) for f in (40.0, 60.0, 100.0)] == ["fingers", "hand", "beyond"]
    assert (FINGERS.force, FINGERS.torque) < (HAND.force, HAND.torque)


def pose(name, push, moment):
    held = HeldRecord("tip", push, np.zeros(3), np.array([moment, 0.0, 0.0]))
    return PoseForces(name, f"{name}@1", moment, (held,))


def test_poses_that_are_too_hard_have_a_warning():
    poses = [("nod", 900.0, 1500.0), ("twist", 230.0, 2800.0), ("wring", 400.0, -5000.0)]
    poses.append(("bend", 49.0, 3400.0))
    record = ForcesRecord(tuple(pose(*values) for values in poses))
    assert [p.effort for p in record.poses] == ["fingers", "hand", "beyond", "hand"]
    assert [p.need for p in record.poses] == ["1.5 N m", "2.8 N m", "5 N m", "49 N"]
    beyond, hand = record.warnings
    for words in ("wring (5 N m)", "85 N", "4.1 N m"):
        assert words in beyond
    for words in ("twist (2.8 N m), bend (49 N)", "48 N", "1.8 N m"):
        assert words in hand
    assert record.poses[0].warning == ""
    assert record.poses[2].warning == beyond
    assert PoseForces("hang", "hang@1", 0.0, ()).warning == ""


def test_a_resultant_force_has_to_be_held():
    held = HeldRecord("tip", 60.0, np.array([0.0, 0.0, 60.0]), np.zeros(3))
    assert (held.effort, held.need) == ("hand", "60 N")
