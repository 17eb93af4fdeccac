"""The step Optimize, asked as browsers do."""

from __future__ import annotations

import shutil
import time
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import Hermite, catmull_rom
from defsense_fab.core.errors import LayoutError, StorageError
from defsense_fab.report.surface_errors import surface_errors
from defsense_fab.store.build import Build
from defsense_fab.store.fields import field_path, load_index
from defsense_fab.studio.background.build_job import CandidateLayout
from defsense_fab.studio.messages import optimize as messages
from defsense_fab.studio.steps.optimize.layout_rows import earlier_layouts
from defsense_fab.studio.steps.optimize.standing import Facts, optimize_state
from defsense_fab.studio.steps.optimize.step import OptimizeStep
from defsense_fab.workflow.design.compare_layouts import ComparedLayout
from tests.support.errors import raises

TIMEOUT_S = 600.0
FACTS = Facts(
    noun="cord",
    has_poses=True,
    has_cords=True,
    can_move=True,
    is_simulated=True,
    is_searching=False,
    best=None,
    drawn=14.731,
    built=None,
    is_built_drawn=False,
    is_built_moved=True,
    is_current=False,
)


def optimize_step(app):
    (step,) = (step for step in app.steps if isinstance(step, OptimizeStep))
    for _ in range(2):  # a result of one worker may be work for another
        assert app.session.wait(TIMEOUT_S)
        assert step.wait(TIMEOUT_S)
    return step


def bent(sensor, distance):
    points = sensor.curve.points.copy()
    points[2:-2, 1] += distance
    return replace(sensor, curve=Hermite(points, sensor.curve.tangents))


def bowed(sensor, height):
    """Return a cord that is bent so gently that it can be made."""
    points = sensor.curve.points.copy()
    points[:, 1] += height * np.sin(np.linspace(0, np.pi, len(points)))
    return replace(sensor, curve=Hermite(points, catmull_rom(points)))


@pytest.mark.parametrize(
    ("changes", "standing", "words"),
    [
        ({"has_poses": False}, "not-ready", "pose"),
        ({"has_cords": False}, "not-ready", "cord"),
        ({}, "never-searched", "14.73 mm"),
        ({"is_searching": True}, "searching", "are found yet"),
        ({"is_searching": True, "best": 0.5}, "searching", "0.50 mm"),
        ({"built": 0.49, "is_simulated": False}, "outdated", "0.49 mm"),
        ({"built": 0.49, "is_built_drawn": True}, "optimized", "0.49 mm"),
        ({"built": 0.49, "is_built_drawn": True, "is_built_moved": False}, "never-searched", "not"),
        ({"can_move": False}, "locked", "14.73 mm"),
        ({"built": 0.49}, "drawn-differ", "14.73 mm"),
        ({"built": 0.49, "is_current": True}, "drawn-differ", "started from"),
        ({"built": 0.49, "drawn": None}, "drawn-differ", "are different."),
    ],
)
def test_the_sentence_says_what_is_true(changes, standing, words):
    state = optimize_state(replace(FACTS, **changes))
    assert state.standing == standing
    assert words in state.text
    is_impossible = standing in ("not-ready", "locked", "searching")
    assert (state.obstacle == "") == (not is_impossible and not changes.get("is_current"))


def test_the_best_layout_of_a_search_is_published_used_and_undone(app):
    step, server = optimize_step(app), app.server
    session = step.session
    text, sensors = session.project.text, session.device.sensors
    with raises(LayoutError, "no-cords-found"):
        app.browser.ask("use-best")
    for callback in session.on_build_started:
        callback()
    folder, better = session.project.folder / "build", tuple(bowed(s, 3.0) for s in sensors)
    for layout, is_best in ((sensors, True), (better, False), (better, True)):
        time.sleep(0.2)  # more than between two published states
        for callback in session.on_layout_found:
            callback(CandidateLayout(folder, layout, 1.0, is_best, 1.0))
        assert step.watch.worker.wait(TIMEOUT_S)
        search = server.events[messages.Search]
        if layout is better and not is_best:  # it may break limits
            assert search.best_cords[0].path != search.current_cords[0].path
    assert server.events[messages.OptimizeState].standing == "searching"
    errors = [session.judge.judge(s, quick=True).error for s in (sensors, better)]
    assert search.best == min(errors)
    assert search.drawn == errors[0]
    assert [pose.pose for pose in search.poses] == ["bend_up", "twist"]
    assert len(search.times) == len(search.currents) == len(search.bests) == 3
    step.on_build_loaded()
    optimize_step(app)
    search = server.events[messages.Search]
    assert (search.state, search.current_cords) == ("ended", [])
    app.browser.ask("use-best")
    assert errors[1] < errors[0]
    for a, b in zip(session.device.sensors, better, strict=True):
        np.testing.assert_allclose(a.curve.points, b.curve.points, atol=1e-3)
    session.project.undo()
    assert session.project.text == text


def test_the_best_layout_is_made_in_the_body_it_was_found_for(app):
    step = optimize_step(app)
    session, sensors = step.session, step.session.device.sensors
    for callback in session.on_build_started:
        callback()
    working = session.project.folder / ".build-next"
    for callback in session.on_layout_found:
        callback(CandidateLayout(working, sensors, 1.0, True, 1.0))
    step.on_build_loaded()
    optimize_step(app)
    working.mkdir()  # another build has started
    app.browser.ask("use-best")
    index = load_index(session.project.folder / "build")
    one, other, *_ = (
        field_path(session.project.folder / "build", state.state) for state in index.states
    )
    shutil.copy2(other, one)
    with raises(LayoutError, "build-outdated"):
        app.browser.ask("use-best")
    shutil.rmtree(session.project.folder / "build")
    with raises(LayoutError, "build-outdated"):
        app.browser.ask("use-best")


def test_the_drawn_cords_are_a_row_with_numbers(app):
    step, server = optimize_step(app), app.server
    (drawn, *_) = server.events[messages.Layouts].rows
    assert drawn.is_drawn
    assert drawn.error == pytest.approx(step.state.drawn)
    assert drawn.length > 100.0
    assert len(drawn.cords) == len(step.session.device.sensors)
    assert all(len(cord.path) <= 80 for cord in drawn.cords)


def test_a_layout_that_does_not_exist_is_refused(app):
    step = optimize_step(app)
    with raises(LayoutError, "no-layout"):
        app.browser.ask("use-layout", name="candidate 7")
    (step.session.project.folder / "build" / "layout.json").unlink()
    step.session.load()
    optimize_step(app)
    with raises(StorageError, "build-outdated"):
        app.browser.ask("compare-layouts")


@pytest.mark.slow
def test_layouts_are_compared_and_one_is_used(made_app):
    app = made_app
    step, server = optimize_step(app), app.server
    (built,) = server.events[messages.Layouts].rows
    assert built.role == "built"
    assert built.is_drawn  # the cords are locked, so that the build has the same ones
    assert built.parts == 2
    assert built.trained_low < built.trained < built.trained_high
    assert server.events[messages.OptimizeState].standing == "locked"
    assert server.events[messages.Layouts].compare_seconds > 0
    app.browser.ask("compare-layouts")
    assert step.session.jobs.wait(TIMEOUT_S)
    optimize_step(app)
    layouts = server.events[messages.Layouts]
    assert layouts.compare_seconds == 0
    rows = {row.role: row for row in layouts.rows}
    assert set(rows) == {"built", "straight"}
    straight = rows["straight"]
    assert straight.trained_low < straight.trained < straight.trained_high
    assert straight.print_hours > 1
    app.browser.ask("use-layout", name="straight")
    optimize_step(app)
    layouts = server.events[messages.Layouts]
    assert [row.role for row in layouts.rows if row.is_drawn] == ["straight"]
    assert server.events[messages.OptimizeState].standing == "drawn-differ"


@pytest.mark.slow
def test_layouts_are_not_compared_after_the_poses_have_changed(made_app):
    app = made_app
    step, server = optimize_step(app), app.server
    project = step.session.project
    text = project.text.replace("degrees = 45", "degrees = 40")
    (project.folder / "device.toml").write_text(text, encoding="utf-8")
    project.refresh()
    optimize_step(app)
    assert server.events[messages.Layouts].obstacle
    with raises(StorageError, "build-outdated"):
        app.browser.ask("compare-layouts")


@pytest.mark.slow
def test_the_error_map_has_the_numbers_of_the_report(made_app):
    app = made_app
    step, server = optimize_step(app), app.server
    errors = surface_errors(Build(step.session.project.folder / "build"))
    names = [state.name for state in server.events[messages.ErrorStates].states]
    assert set(names) == set(errors.names)
    sent = app.browser.ask("error-map-of", state="twist@1")
    k = errors.names.index("twist@1")
    assert sent.facts["mean"] == pytest.approx(errors.mean(k))
    assert sent.facts["high"] == pytest.approx(errors.highest)
    np.testing.assert_allclose(sent.arrays["error"], errors.error[k], atol=1e-5)
    with raises(StorageError, "unknown-state"):
        app.browser.ask("error-map-of", state="wave@1")


def test_layouts_of_an_earlier_build_are_kept_and_marked(app):
    step, server = optimize_step(app), app.server
    session, sensors = step.session, step.session.device.sensors
    searched = [
        ComparedLayout(name, tuple(bent(s, mm) for s in sensors), error, parts=4, is_built=is_built)
        for name, mm, error, is_built in (("simplest", 1.0, 0.8, False), ("best", 2.0, 0.5, True))
    ]
    step.layouts.extend(searched)
    (session.project.folder / "build" / "layout.json").unlink()
    session.load()
    optimize_step(app)
    rows = {row.name: row for row in server.events[messages.Layouts].rows if row.role == "earlier"}
    assert list(rows) == ["earlier: best", "earlier: simplest"]
    assert (rows["earlier: best"].error, rows["earlier: best"].parts) == (0.5, 4)
    app.browser.ask("use-layout", name="earlier: simplest")
    optimize_step(app)
    rows = server.events[messages.Layouts].rows
    assert [row.name for row in rows if row.role == "earlier"] == ["earlier: best"]
    assert rows[0].is_drawn
    assert rows[0].error != 0.8  # that of the present design
    field = next((session.project.folder / "build" / "fields").glob("*.vtu"))
    field.write_bytes(field.read_bytes() + b"\n")  # other poses
    session.load()
    optimize_step(app)
    assert all(row.role != "earlier" for row in server.events[messages.Layouts].rows)


def test_earlier_layouts_have_names_of_their_own(app):
    sensors = app.session.device.sensors
    first, second = (
        ComparedLayout("simplest", tuple(bent(s, mm) for s in sensors), mm) for mm in (1.0, 2.0)
    )
    kept = earlier_layouts([first, second, first], (), ())
    assert [layout.name for layout in kept] == ["earlier: simplest", "earlier: simplest_2"]
    assert earlier_layouts(kept, [second], ()) == kept[:1]
    assert earlier_layouts(kept, (), first.sensors) == kept[1:]
