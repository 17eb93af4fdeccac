"""Predictions for cords while they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.optimization.prediction.as_built import assumed_cords
from defsense_fab.optimization.prediction.predict import predict
from defsense_fab.store.build import Build
from defsense_fab.workflow.design.layout_judge import LayoutJudge
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture


@pytest.fixture(scope="module")
def judge(live_bar):
    return LayoutJudge(load_device(live_bar.folder), Build(live_bar.folder / "build"))


def test_pose_errors_are_those_of_the_largest_state_of_each_pose(judge, live_bar):
    device = load_device(live_bar.folder)
    judged = judge.judge(device.sensors, quick=True)
    assert set(judged.pose_errors) == {pose.name for pose in device.poses}
    weights = judge.task.weights
    for pose, signals in judged.pose_signals.items():
        alone = [
            k for k, state in enumerate(weights) if {n for n, w in state.items() if w} == {pose}
        ]
        largest = max(alone, key=lambda k: weights[k][pose])
        assert signals.tolist() == judged.signals[largest].tolist()
        assert judged.pose_errors[pose] > 0
        moved = np.linalg.norm(judge.task.everything.markers[largest], axis=1)
        assert judged.pose_movements[pose] == pytest.approx(np.sqrt((moved**2).mean()))
        assert judged.pose_travels[pose] == pytest.approx(moved.max())


def test_the_best_of_the_fast_decoders_is_taken(judge, live_bar):
    sensors = load_device(live_bar.folder).sensors
    cords = assumed_cords(judge.task, sensors)
    errors = {
        kind: predict(task, cords).prediction.unseen for kind, task in judge.quick_tasks.items()
    }
    assert len(errors) > 1
    judged = judge.judge(sensors, quick=True)
    assert (judged.error, judged.decoder) == (min(errors.values()), min(errors, key=errors.get))


def test_no_cords_have_no_prediction(judge):
    assert judge.judge(()) is None


def test_new_cords_keep_the_limits(judge):
    cord = judge.new_cord("straight")
    assert judge.check([cord]).violations == ()
    assert np.ptp(cord.curve.points[:, 1]) == 0
