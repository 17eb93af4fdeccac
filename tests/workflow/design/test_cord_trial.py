"""Cords are made on trial with the checks and the numbers of a build."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DefsenseError
from defsense_fab.optimization.prediction.as_built import fabricate, score_channels
from defsense_fab.store.build import Build
from defsense_fab.workflow.design.compare_layouts import tried_as
from defsense_fab.workflow.design.cord_trial import TrialBench
from defsense_fab.workflow.design.layout_judge import LayoutJudge
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.support.errors import raises
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
    task, errors = judge.task.with_decoder(judged.decoder), []
    for relief in (True, False):
        decided = replace(device, fabrication=replace(device.fabrication, strain_relief=relief))
        parts = fabricate(decided, build.surface, cords, lambda *_: None, bay=build.body.bay)
        errors.append(score_channels(task, parts.channels).prediction.unseen)
        made = TrialBench(decided, build).make(cords)
        assert made.error == pytest.approx(errors[-1])
        assert made.parts == len(parts.parts)
    with_bends, without = errors
    assert with_bends != pytest.approx(without)
    assert trial.error == pytest.approx(with_bends)  # which cost little in this device


def test_a_cord_outside_the_body_has_no_error(device, build):
    left = device.sensors[0]
    away = replace(left.plane, origin=left.plane.origin + np.array([0, 0, 500.0]))
    cords = (replace(left, plane=away), *device.sensors[1:])
    trial = TrialBench(device, build).make(cords)
    assert trial.problem.code == "path-leaves-body"
    assert trial.error is None
    assert np.isnan(trial.drawn_error)
    assert np.isnan(tried_as("outside", trial).error)


def test_later_proposals_differ_from_the_first_one(device, build):
    judge = LayoutJudge(device, build)
    proposals = judge.proposals("new", device.sensors[:1], lambda *_: None)
    first, second = next(proposals), next(proposals)
    assert first.name == second.name == "new"
    assert not np.array_equal(first.curve.points, second.curve.points)


def test_a_later_proposal_can_be_cancelled(device, build):
    judge, is_cancelled = LayoutJudge(device, build), False

    def report(share, message):
        if is_cancelled:
            raise DefsenseError("the search was canceled", code="cancelled")

    proposals = judge.proposals("new", device.sensors[:1], report)
    next(proposals)
    is_cancelled = True
    with raises(DefsenseError, "cancelled"):
        next(proposals)
