"""Drawn cords are made on trial in the background; what cannot be made is shown and not offered."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import Hermite
from defsense_fab.core.errors import LayoutError
from defsense_fab.studio.background.background_job import BackgroundJob
from defsense_fab.studio.background.build_job import CandidateLayout
from defsense_fab.studio.edits import cords as edits
from defsense_fab.studio.messages import optimize
from defsense_fab.studio.messages.sensors import Prediction
from defsense_fab.studio.messages.shell import Notice, Pipeline
from defsense_fab.studio.session import cord_check
from defsense_fab.studio.session.cord_check import CordCheck
from defsense_fab.studio.steps import sensors as sensors_module
from defsense_fab.studio.steps.makeable_proposal import makeable_proposal
from defsense_fab.studio.steps.optimize.layout_rows import best_layout
from defsense_fab.workflow.design.compare_layouts import ComparedLayout
from defsense_fab.workflow.design.layout_judge import LayoutJudge
from tests.studio.steps.test_optimize import optimize_step
from tests.support.errors import raises
from tests.support.unmakeable_cord import unmakeable_cord

LONG_S = 240.0


def sensors_step(app):
    return next(s for s in app.steps if type(s).__name__ == "SensorsStep")


def checked(app):
    """Return the prediction once the drawn cords were made on trial."""
    assert sensors_step(app).wait(LONG_S)
    assert app.check.wait(LONG_S)
    return app.server.events[Prediction]


def until(is_true, timeout_s):
    """Wait until something is true; return False after `timeout_s`."""
    deadline = time.monotonic() + timeout_s
    while not (found := is_true()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return found


def states(app):
    return {s.name: s.state for s in app.server.events[Pipeline].steps}


def draw_unmakeable(app):
    """Draw the cord `A` and one that crosses its channel."""
    app.browser.ask("delete-cords", cords=["B"])
    cord = unmakeable_cord()
    app.session.apply(edits.add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))
    return cord


def test_drawn_cords_are_not_called_makeable_before_that_is_known(app):
    found = checked(app)
    history = [e.check.state for e in app.server.history if isinstance(e, Prediction)]
    assert history[0] != "passed"
    assert "checking" in history
    assert found.check.state == "passed"
    assert found.check.error > 0
    assert len(found.check.in_use) == 3
    assert states(app)["sensors"] == "done"
    optimize_step(app)
    (drawn,) = (row for row in app.server.events[optimize.Layouts].rows if row.is_drawn)
    assert drawn.error == found.check.error
    assert drawn.trained == found.check.in_use[0]
    assert drawn.drawn_error == pytest.approx(found.drawn.error)


def test_cords_that_cannot_be_made_are_shown_with_their_place(app):
    draw_unmakeable(app)
    found = checked(app)
    assert found.drawn.violations == []
    assert found.check.state == "failed"
    assert found.check.problem.code == "channel-cuts-part"
    assert set(found.check.problem.cords) <= {"A", "crossing"}
    assert len(found.check.problem.at) == 3
    assert states(app)["sensors"] == "stale"
    optimize_step(app)
    (drawn,) = (row for row in app.server.events[optimize.Layouts].rows if row.is_drawn)
    assert drawn.problem == found.check.problem.text
    with raises(LayoutError, "cords-not-makeable"):
        app.browser.ask("propose")
    app.browser.ask("undo")  # known again at once, without another check
    assert checked(app).check.state == "passed"


@pytest.mark.slow
def test_built_cords_have_one_error_after_a_setting_has_changed(made_app):
    app = made_app
    before = checked(app).check.error
    file = app.session.project.folder / "device.toml"
    text = file.read_text(encoding="utf-8")
    setting = "[fabrication]\nstrain_relief = false\n"
    file.write_text(text.replace("[fabrication]\n", setting), encoding="utf-8")
    app.session.project.refresh()
    assert app.session.wait(LONG_S)
    found = checked(app)
    assert found.is_built_drawn
    assert abs(found.check.error - before) > 0.01
    step = optimize_step(app)
    (drawn,) = (row for row in app.server.events[optimize.Layouts].rows if row.is_drawn)
    assert (drawn.role, drawn.error) == ("built", found.check.error)
    assert step.state.drawn == step.state.built == found.check.error
    assert f"{found.check.error:.2f} mm" in step.state.text


def moved_point(sensors, distance):
    """Return cords of which the first one has another path that keeps the limits."""
    curve = sensors[0].curve
    points = curve.points.copy()
    points[3, 1] += distance
    return (replace(sensors[0], curve=Hermite(points, curve.tangents)), *sensors[1:])


def drag(app, distance):
    cord = app.session.device.sensors[0]
    to = cord.curve.points[3] + [0.0, distance]
    values = {"cord": cord.name, "index": 3, "to": to.tolist(), "snap": False, "write": True}
    app.browser.ask("drag-point", **values)


def test_a_result_is_that_of_the_cords_that_were_checked(app, monkeypatch):
    checked(app)
    first, second = (moved_point(app.session.device.sensors, d) for d in (0.6, 1.2))
    start, others = BackgroundJob.start, [second]

    def start_late(job, *arguments):
        if others:  # other cords are drawn just before the check starts
            other = threading.Thread(target=app.check.request, args=(others.pop(),))
            other.start()
            other.join(1.0)
        return start(job, *arguments)

    monkeypatch.setattr(BackgroundJob, "start", start_late)
    app.check.request(first)
    assert until(lambda: app.check.result(second) is not None, LONG_S)
    np.testing.assert_array_equal(
        app.check.result(second).sensors[0].curve.points, second[0].curve.points
    )
    assert app.check.wait(LONG_S)


def test_nothing_is_checked_or_known_while_a_build_replaces_the_poses(app, monkeypatch):
    checked(app)

    def missing(_):
        raise FileNotFoundError

    with monkeypatch.context() as patch:
        patch.setattr(cord_check, "poses_digest", missing)
        drag(app, 0.6)
        assert checked(app).check.state == "none"
        drawn = app.session.device.sensors
        app.check.make_now(drawn)
        for sensors in (drawn, drawn[:1]):
            assert app.check.result(sensors) is None
            assert app.check.state(sensors) == "none"
    drag(app, -0.1)
    assert checked(app).check.state == "passed"


def run_out_of_memory(*_):
    raise MemoryError("no memory")


def test_a_check_that_fails_is_reported_and_repeated_after_the_next_change(app, monkeypatch):
    checked(app)
    with monkeypatch.context() as patch:
        patch.setattr(cord_check, "run_check", run_out_of_memory)
        drag(app, 0.6)
        assert checked(app).check.state == "aborted"
    assert app.server.events[Notice].problem.code == "job-failed"
    assert states(app)["sensors"] == "ready"
    drag(app, -0.1)
    assert checked(app).check.state == "passed"
    assert states(app)["sensors"] == "done"


def test_a_late_result_does_not_bring_earlier_cords_back(app, monkeypatch):
    checked(app)
    find, is_inside, may_continue = sensors_module.built_cords, threading.Event(), threading.Event()

    def find_slowly(results):
        if threading.current_thread() is late:
            is_inside.set()
            assert may_continue.wait(LONG_S)
        return find(results)

    late = threading.Thread(target=lambda: [callback() for callback in app.check.on_result])
    monkeypatch.setattr(sensors_module, "built_cords", find_slowly)
    late.start()
    assert is_inside.wait(LONG_S)
    app.browser.ask("delete-cords", cords=["B"])
    sensors_step(app).wait(1.0)
    may_continue.set()
    late.join(LONG_S)
    assert sensors_step(app).wait(LONG_S)
    left = [cord.name for cord in app.server.events[Prediction].drawn.cords]
    assert left == [sensor.name for sensor in app.session.device.sensors]


class OneProposal(LayoutJudge):
    """A judge that proposes given cords."""

    def __init__(self, *cords):
        self._cords = cords

    def proposals(self, name, sensors, report):
        yield from (replace(cord, name=name) for cord in self._cords)


def test_the_next_proposal_is_taken_if_one_cannot_be_made(app):
    checked(app)
    left, good = app.session.device.sensors[:2]
    check = CordCheck(app.session)
    proposed = makeable_proposal(
        OneProposal(unmakeable_cord(), good), check, (left,), "new", lambda *_: None
    )
    assert proposed.cord.plane == good.plane
    assert proposed.error_before == check.make_now((left,)).error
    assert proposed.error == check.make_now((left, proposed.cord)).error
    with raises(LayoutError, "no-makeable-proposal") as error:
        makeable_proposal(OneProposal(unmakeable_cord()), check, (left,), "new", lambda *_: None)
    assert len(error.value.data["problems"]) == 1


def test_only_layouts_that_can_be_made_are_used(app):
    step = optimize_step(app)
    left, middle = app.session.device.sensors[:2]
    bad = (left, unmakeable_cord())
    layout = ComparedLayout("bad", bad, 0.1, problem="cannot be made")
    step.layouts.append(layout)
    with raises(LayoutError, "layout-not-makeable"):
        app.browser.ask("use-layout", name="bad")
    good = (left, middle)
    search(app, step, good, bad)
    assert step.watch.search.best == app.session.judge.judge(bad).error  # the most accurate one
    app.browser.ask("use-best")
    assert {s.name for s in app.session.device.sensors} == {left.name, middle.name}
    search(app, step, bad)
    with raises(LayoutError, "layout-not-makeable"):
        app.browser.ask("use-best")


def search(app, step, *layouts):
    """Let the search of a new build find layouts, each better than the one before."""
    for callback in app.session.on_build_started:
        callback()
    folder = app.session.project.folder / "build"
    for layout in layouts:
        for callback in app.session.on_layout_found:
            callback(CandidateLayout(folder, layout, 1.0, is_best=True, seconds=1.0))
    assert step.wait(LONG_S)


def test_the_best_layout_that_can_be_made_is_offered():
    def layout(name, error, **values):
        return ComparedLayout(name, (), error, **values)

    failed = layout("a", 0.5, problem="no", is_built=True)
    assert best_layout([failed]) == ("", "no")
    others = [layout("b", 0.9, parts=4), layout("c", 0.7, parts=5), layout("d", 0.6)]
    assert best_layout([failed, *others]) == ("c", "")
    assert best_layout([replace(failed, problem=None), *others]) == ("a", "")
    assert best_layout(others) == ("", "")
