"""How often a session shows each state."""

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.optimization.prediction.design_task import load_task
from defsense_fab.store.build import Build
from defsense_fab.workflow.design.session_shares import session_shares
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture


def test_a_session_is_often_at_rest_and_shows_every_pose(live_bar):
    device = load_device(live_bar.folder)
    weights = load_task(device, Build(live_bar.folder / "build")).weights
    shares = session_shares(device, weights)
    assert shares.sum() == pytest.approx(1.0)
    rest = [k for k, w in enumerate(weights) if not any(w.values())]
    assert 0.1 < shares[rest].sum() < 0.6
    for pose in device.poses:
        assert sum(s for s, w in zip(shares, weights, strict=True) if w.get(pose.name)) > 0.05
    assert (session_shares(device, weights) == shares).all()
