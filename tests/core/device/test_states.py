"""Test the default states of a device."""

import os
from dataclasses import replace

import numpy as np

from defsense_fab.core.device.device import Handle, PointDrag, Pose, RegionPressure
from defsense_fab.core.device.pose_tables import repeated_states
from defsense_fab.core.device.states import DEFAULT_RAMP, default_states, state_key

FREE = np.full(3, np.nan)


def turn(name, x=0.0, y=0.0, z=0.0, region="tip", translation=FREE, fixed=("base",)):
    return Pose(name, fixed, (Handle(region, np.deg2rad([x, y, z]), np.asarray(translation)),))


UP, DOWN, TWIST = turn("up", y=-30), turn("down", y=30), turn("twist", x=45)


def test_pairs_that_are_not_opposite_are_mixed_fully_and_half():
    states = default_states([UP, DOWN, TWIST])
    assert not states.mixtures_given
    assert not states.held_out_given
    assert states.ramp == DEFAULT_RAMP
    assert {tuple(sorted(m.items())) for m in states.mixtures} == {
        (("twist", w), (pose, w)) if pose > "twist" else ((pose, w), ("twist", w))
        for pose in ("up", "down")
        for w in (0.5, 1.0)
    }
    assert len(states.held_out) == 4
    assert not [m for m in states.held_out if m in states.mixtures]


def test_three_poses_that_can_mix_are_held_out_at_once():
    states = default_states([UP, TWIST, turn("sway", z=30)])
    assert {"up": 0.7, "twist": 0.7, "sway": 0.7} in states.held_out
    assert len(states.held_out) == 2 * 3 + 1


def test_amplitudes_are_held_out_where_no_poses_can_mix():
    assert default_states([UP, DOWN]).held_out == ({"up": 0.875}, {"down": 0.875})
    assert default_states([UP], (1.0,)).held_out == ({"up": 0.5},)
    assert default_states([UP, DOWN]).mixtures == ()


def test_poses_that_cannot_mix_are_not_mixed():
    pulled = turn("pull", translation=[10, 0, 0])
    other = turn("other", x=20, region="base", fixed=("tip",))
    aside = Pose("aside", UP.fixed, (replace(UP.handles[0], about=np.array([75.0, 0, 0])),))
    assert default_states([UP, aside]).mixtures == ()
    assert default_states([aside, pulled]).mixtures  # a handle that does not rotate has no pivot
    assert default_states([UP, pulled]).mixtures  # free in one pose, moved by the other
    assert default_states([UP, other]).mixtures == ()
    assert default_states([pulled, turn("push", translation=[-10, 0, 0])]).mixtures == ()
    assert default_states([pulled, turn("lift", translation=[0, 0, 10])]).mixtures


def test_states_of_many_poses_are_limited_but_include_each_pose():
    poses = [turn(f"p{k}", x=np.cos(k) * 30, y=np.sin(k) * 30, region=f"r{k}") for k in range(12)]
    states = default_states(poses)
    assert len(states.mixtures) == 30
    assert {name for m in states.mixtures for name in m} == {p.name for p in poses}


def test_opposite_loads_are_not_mixed():
    def loaded(name, sign):
        return Pose(name, ("base",), (), gravity=np.array([0, 0, sign]))

    def pressed(name, value):
        return Pose(name, ("base",), (), pressures=(RegionPressure("top", value),))

    def dragged(name, by):
        return Pose(name, ("base",), (), drags=(PointDrag(np.ones(3), np.array(by), 1.0),))

    for a, b in (
        (loaded("a", 1.0), loaded("b", -1.0)),
        (pressed("a", 0.1), pressed("b", -0.1)),
        (dragged("a", [5.0, 0, 0]), dragged("b", [-5.0, 0, 0])),
    ):
        assert default_states([a, b]).mixtures == ()
        assert default_states([a, UP]).mixtures


def test_no_state_exceeds_the_largest_fraction():
    states = default_states([UP, TWIST], (0.25, 0.5))
    assert {w for m in (*states.mixtures, *states.held_out) for w in m.values()} == {0.25, 0.5}
    for ramp in ((0.0005,), (0.1, 0.1004), (0.999, 1.0)):
        ((amplitude,),) = [m.values() for m in default_states([UP], ramp).held_out]
        assert 0 < amplitude < ramp[-1]
        assert amplitude not in ramp


SWAY = turn("sway", z=30)


def test_a_given_list_replaces_only_that_list():
    proposed = default_states([UP, DOWN, TWIST])
    held_out = ({"up": 0.6, "twist": 0.3}, {"down": 0.9})
    states = default_states([UP, DOWN, TWIST], held_out=held_out)
    assert (states.mixtures, states.held_out) == (proposed.mixtures, held_out)
    assert (states.mixtures_given, states.held_out_given) == (False, True)
    mixtures = ({"up": 0.9, "twist": 0.8},)
    states = default_states([UP, DOWN, TWIST], mixtures=mixtures)
    assert (states.mixtures, states.held_out) == (mixtures, proposed.held_out)
    assert (states.mixtures_given, states.held_out_given) == (True, False)


def test_an_empty_list_is_none():
    states = default_states([UP, DOWN, TWIST], mixtures=(), held_out=())
    assert (states.mixtures, states.held_out) == ((), ())
    assert states.mixtures_given
    assert states.held_out_given


def test_proposed_states_are_not_among_given_ones():
    full, half = {"twist": 1.0, "up": 1.0}, {"up": 0.5, "twist": 0.5}
    states = default_states([UP, TWIST], held_out=[full])
    assert states.mixtures == (half,)
    taken = [{"up": 1.0, "twist": 0.5}, {"twist": 1.0, "up": 0.5}]
    states = default_states([UP, TWIST], mixtures=taken)
    assert states.held_out == ({"up": 0.875}, {"twist": 0.875})  # no pair is left
    states = default_states([UP, TWIST], mixtures=[*taken, {"up": 0.875}])
    assert states.held_out == ({"twist": 0.875},)


def variants(count):
    """Yield random lists of mixtures, as given in a file; None is a list that is not given."""
    rng = np.random.default_rng(53)
    poses = [UP, DOWN, TWIST, SWAY]
    for _ in range(count):
        chosen = [poses[k] for k in rng.permutation(4)[: rng.integers(1, 5)]]
        ramp = tuple(np.unique(rng.choice([0.25, 0.5, 0.7, 0.75, 1.0], rng.integers(1, 4))))
        known, lists = {state_key({p.name: w}) for p in chosen for w in ramp}, []
        for _ in range(2):
            rows = []
            for _ in range(rng.integers(0, 6)):
                names = [p.name for p in chosen if rng.random() < 0.6] or [chosen[0].name]
                row = {n: float(rng.choice([0.0, 0.5, 0.7, 0.875, 1.0])) for n in names}
                if any(row.values()) and state_key(row) not in known:
                    known.add(state_key(row))
                    rows.append(row)
            lists.append(rows if rng.random() < 0.6 else None)
        yield chosen, ramp, *lists


def test_completed_states_never_repeat_and_keep_the_given_lists():
    for poses, ramp, mixtures, held_out in variants(int(os.environ.get("STATE_VARIANTS", "100"))):
        states = default_states(poses, ramp, mixtures, held_out)
        assert not list(repeated_states(states, [p.name for p in poses]))
        alone = default_states(poses, ramp)
        if mixtures is None:
            tested = set(map(state_key, held_out or ()))
            expected = [m for m in alone.mixtures if state_key(m) not in tested]
            assert list(states.mixtures) == expected
        else:
            assert list(states.mixtures) == mixtures
        assert held_out is None or list(states.held_out) == held_out
