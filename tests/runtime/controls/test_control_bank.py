"""The One Euro filter, the shaping of controls, and the bank that combines them."""

import math

import numpy as np
import pytest

from defsense_fab.core.errors import ControlError
from defsense_fab.runtime.controls.control_bank import ControlBank, OneEuro
from defsense_fab.runtime.controls.control_spec import ControlSpec, Shaping, plain_name
from defsense_fab.runtime.controls.pose_amplitudes import PoseBasis, PoseRamp
from tests.runtime.bars import POSES, STEPS, bent, markers, poses
from tests.support.errors import raises

SD = np.full(40, 0.5)


def test_one_euro_is_a_low_pass_without_speed():
    """Without `speed` the step response is that of a first-order low pass: 1 - (1 - w)^n."""
    smooth = OneEuro(cutoff=2.0)
    smooth(0.0, 0.0)
    got = [smooth(1.0, 0.01 * n) for n in range(1, 50)]
    w = 1 / (1 + 1 / (2 * math.pi * 2.0 * 0.01))
    assert got == pytest.approx([1 - (1 - w) ** n for n in range(1, 50)])


def test_one_euro_lags_less_with_speed():
    """Noise at rest is smoothed as without `speed`, but a quick move lags less."""
    rng = np.random.default_rng(0)
    still = rng.normal(0, 0.01, 500)
    time = 0.01 * np.arange(500)
    slow, quick = OneEuro(1.0), OneEuro(1.0, speed=2.0)
    calm = np.array([quick(x, t) for x, t in zip(still, time, strict=True)])
    assert calm[50:].std() < 0.5 * still.std()
    ramp = np.clip(4 * (time - 1), 0, 1)
    lag = [
        np.abs(ramp - [f(x, t + 10) for x, t in zip(ramp, time, strict=True)]).max()
        for f in (slow, quick)
    ]
    assert lag[1] < 0.6 * lag[0]


def test_one_euro_restarts():
    smooth = OneEuro(1.0)
    smooth(0.0, 10.0)
    assert smooth(1.0, 2.0) == 1.0  # the clock went back
    assert 0 < 1 - smooth(0.0, 2.01) < 1
    assert math.isnan(smooth(math.nan, 2.02))
    assert smooth(0.3, 2.03) == 0.3
    assert smooth(0.9, 2.03) == 0.3  # no time has passed
    assert OneEuro(0.0)(0.7, 1.0) == 0.7


@pytest.mark.parametrize(
    ("shaping", "pairs"),
    [
        (Shaping(), {0.5: 0.5, 2: 1, -0.5: 0}),
        (Shaping(dead_zone=0.1, full=0.6), {0.05: 0, 0.1: 0, 0.35: 0.5, 0.6: 1, 0.9: 1}),
        (Shaping(curve=2), {0.5: 0.25, 1: 1}),
        (Shaping(minimum=-1, dead_zone=0.2), {-0.6: -0.5, 0.6: 0.5, -0.1: 0, -3: -1}),
        (Shaping(invert=True), {0: 1, 1: 0, 0.25: 0.75}),
        (Shaping(minimum=-1, invert=True), {0.5: -0.5, -1: 1}),
        (Shaping(minimum=0.2, maximum=0.8), {0: 0.2, 0.5: 0.5, 1: 0.8}),
    ],
)
def test_shaping(shaping, pairs):
    assert {x: shaping(x) for x in pairs} == pytest.approx(pairs)


@pytest.mark.parametrize(
    ("settings", "code", "key"),
    [
        ({"dead_zone": 1.0}, "out-of-range", "dead_zone"),
        ({"dead_zone": -0.1}, "out-of-range", "dead_zone"),
        ({"curve": 0.0}, "out-of-range", "curve"),
        ({"minimum": 1.0}, "out-of-range", "minimum"),
        ({"maximum": 2.0}, "out-of-range", "maximum"),
        ({"smoothing": -1.0}, "out-of-range", "smoothing"),
        ({"full": math.inf}, "not-finite", "full"),
    ],
)
def test_shaping_refuses_invalid_settings(settings, code, key):
    with raises(ControlError, code, key=key):
        Shaping(**settings)


@pytest.fixture(scope="module")
def rest():
    return markers(40, np.random.default_rng(0))


def test_a_control_for_each_pose(rest):
    bank = ControlBank(poses(rest), rest)
    assert bank.names == POSES
    found = bank.update(rest + bent(rest, 0.5), SD, 0.0)
    assert found.values["bend_up"] == pytest.approx(0.5, abs=0.02)
    assert found.values["bend_down"] == 0
    assert found.confidence["bend_up"] > 0.9


def test_controls_of_formulas(rest):
    """Controls are smoothed and shaped one by one; each may use earlier ones."""
    plain = Shaping(smoothing=0, minimum=-1)
    bank = ControlBank(
        poses(rest),
        rest,
        [
            ControlSpec("bend", "bend_up - bend_down", plain),
            ControlSpec("half", "bend / 2", plain),
            ControlSpec("pressed", "bend < -0.4", Shaping(smoothing=0)),
            ControlSpec("slow", "bend", Shaping(minimum=-1, smoothing=1, quickness=0)),
        ],
    )
    bank.update(rest, SD, 0.0)
    found = bank.update(rest + bent(rest, 0.5, -1), SD, 0.01)
    assert found.values["bend"] == pytest.approx(-0.5, abs=0.02)
    assert found.values["half"] == pytest.approx(-0.25, abs=0.01)
    assert found.values["pressed"] == 1
    assert -0.1 < found.values["slow"] < -0.01
    strange = bank.update(rest + np.random.default_rng(0).normal(0, 20, (40, 3)), SD, 0.02)
    assert set(strange.confidence) == {"bend", "half", "pressed", "slow"}
    assert max(strange.confidence.values()) < 0.2


def test_names_of_poses_in_formulas_are_plain(rest):
    ramp = PoseRamp(STEPS, np.array([bent(rest, a) for a in STEPS]))
    bank = ControlBank(
        PoseBasis(("bend-up",), (ramp,)), rest, [ControlSpec("x", "2 * bend_up", Shaping())]
    )
    assert bank.update(rest + bent(rest, 0.25), SD, 0.0).values["x"] == pytest.approx(0.5, abs=0.02)
    assert [plain_name(n) for n in ("3-up", "in", "_a")] == ["pose_3_up", "in_", "pose__a"]


def test_invalid_banks_are_refused(rest):
    basis = poses(rest)
    with raises(ControlError, "unknown-name", control="a", name="b", column=1):
        ControlBank(basis, rest, [ControlSpec("a", "b"), ControlSpec("b", "bend_up")])
    with raises(ControlError, "name-repeated", name="a"):
        ControlBank(basis, rest, [ControlSpec("a", "pull"), ControlSpec("a", "pull")])
    with raises(ControlError, "markers-differ", count=39, expected=40):
        ControlBank(basis, rest[1:])
    for name in ("", "a b", "1a", "in", "ä"):
        with raises(ControlError, "name-invalid", name=name):
            ControlSpec(name, "pull")
