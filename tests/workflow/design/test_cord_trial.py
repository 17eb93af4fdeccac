"""Cords are made on trial with the checks and the numbers of a build."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.optimization.prediction.as_built import fabricate, score_channels
from defsense_fab.store.build import Build
from defsense_fab.workflow.design.compare_layouts import tried_as
from defsense_fab.workflow.design.cord_trial import TrialBench
from defsense_fab.workflow.design.layout_judge import LayoutJudge
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.support.unmakeable_cord import unmakeable_cord
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture


@pytest.fixture(scope="module")
def device(live_bar):
    return load_device(live_bar.folder)


@pytest.fixture(scope="module")
def build(live_bar):
    return Build(live_bar.folder / "build")


def test_cords_that_keep_all_limits_may_still_not_be_makeable(device, build):
    left = device.sensors[0]
    cords = (left, unmakeable_cord())
    assert LayoutJudge(device, build).check(cords).violations == ()
    trial = TrialBench(device, build).make_with_band(cords)
    assert trial.problem.code == "channel-cuts-part"
    assert set(trial.problem.cords) <= {s.name for s in cords}
    low, high = build.surface.bounds
    assert (np.array(trial.problem.at) > low - 1).all()
    assert (np.array(trial.problem.at) < high + 1).all()
    assert (trial.error, trial.parts, trial.band) == (None, None, None)
    assert trial.drawn_error > 0
    layout = tried_as("crossing", trial)
    assert layout.problem == trial.problem.text
    assert layout.error == layout.drawn_error == trial.drawn_error


def test_the_error_in_the_parts_is_that_of_a_build(device, build):
    cords = device.sensors[:1]
    made = []
    bench = TrialBench(device, build)
    trial = bench.make_with_band(cords, made.append)
    assert trial.problem is None
    assert trial.band.trained.low < trial.band.trained.median < trial.band.trained.high
    assert made == [replace(trial, band=None)]
    judge = LayoutJudge(device, build)
    judged = judge.judge(cords)
    assert trial.drawn_error == pytest.approx(judged.error)
    straight = replace(device, fabrication=replace(device.fabrication, strain_relief=False))
    parts = {
        relief: fabricate(d, build.surface, cords, lambda *_: None, bay=build.body.bay)
        for relief, d in ((True, device), (False, straight))
    }
    task = judge.task.with_decoder(judged.decoder)
    errors = [score_channels(task, p.channels).prediction.unseen for p in parts.values()]
    assert any(trial.error == pytest.approx(error) for error in errors)
    assert trial.parts == len(parts[True].parts)


def test_later_proposals_differ_from_the_first_one(device, build):
    judge = LayoutJudge(device, build)
    proposals = judge.proposals("new", device.sensors[:1], lambda *_: None)
    first, second = next(proposals), next(proposals)
    assert first.name == second.name == "new"
    assert not np.array_equal(first.curve.points, second.curve.points)
