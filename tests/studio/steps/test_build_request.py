"""Parts are built of cords that the user has decided on, and the page states which ones."""

from __future__ import annotations

import shutil

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.studio.messages import optimize, shell
from defsense_fab.studio.session.built_cords import BuiltCords, built_cords
from defsense_fab.studio.steps.build_request import would_move_cords
from defsense_fab.studio.steps.make.build_state import BuildState
from defsense_fab.studio.steps.make.state_texts import make_state
from defsense_fab.studio.steps.optimize.ghost_cords import are_same
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.results import last_build
from defsense_fab.workflow.design.compare_layouts import ComparedLayout
from tests.studio.steps.test_optimize import optimize_step
from tests.support.errors import raises

TIMEOUT_S = 600.0


@pytest.fixture
def unlocked_app(app):
    """Open a built bar whose cords a search may move."""
    app.browser.ask("unlock-cords")
    return app


def test_a_build_that_would_move_the_drawn_cords_is_refused(unlocked_app):
    app, session = unlocked_app, unlocked_app.session
    with raises(LayoutError, "cords-undecided"):
        app.browser.ask("start-build", stage="report")
    assert not session.jobs.is_running
    assert all(sensor.free for sensor in session.device.sensors)


def test_locked_cords_are_built_without_a_question(app):
    for sensor in app.session.device.sensors:
        app.browser.ask("set-freedoms", cord=sensor.name, free=[])
    assert not would_move_cords(app.session)


def test_cords_of_a_layout_are_locked_when_they_are_used(unlocked_app):
    app, session = unlocked_app, unlocked_app.session
    optimize_step(app).layouts.append(ComparedLayout("simplest", session.device.sensors, 0.5))
    app.browser.ask("use-layout", name="simplest")
    assert not any(sensor.free for sensor in session.device.sensors)
    assert not would_move_cords(session)
    assert "locked now" in app.server.events[shell.Notice].text
    state = optimize_step(app).state
    assert "locked" in state.obstacle
    (taken,) = session.taken_layouts
    assert are_same(taken, session.device.sensors)
    app.browser.ask("unlock-cords")
    assert all(sensor.free == {"path", "plane"} for sensor in session.device.sensors)


@pytest.mark.slow
def test_parts_as_drawn_equal_those_of_the_command_line(unlocked_app, tmp_path):
    app, session = unlocked_app, unlocked_app.session
    app.browser.ask("start-build", stage="report", cords="as-drawn")
    copy = tmp_path / "copy"
    shutil.copytree(session.project.folder, copy, ignore=shutil.ignore_patterns("build*", ".*"))
    assert session.jobs.wait(TIMEOUT_S)
    assert session.build_error is None
    assert not any(sensor.free for sensor in session.device.sensors)
    cords = built_cords(session.results)
    assert not cords.is_moved
    optimize_step(app)
    assert app.server.events[optimize.OptimizeState].standing == "locked"
    assert app.server.events[shell.Pipeline].next.step == "measure"
    build(load_device(copy), "report")
    parts = [
        {path.name: path.read_bytes() for path in (folder / "build" / "parts").glob("*.st*")}
        for folder in (session.project.folder, copy)
    ]
    assert parts[0] == parts[1] != {}
    assert built_cords(last_build(load_device(copy))).error == cords.error


@pytest.mark.parametrize(
    ("is_moved", "parts", "are_drawn", "words"),
    [
        (False, 3, True, ["the drawn cords", "as Sensors shows"]),
        (True, 3, False, ["the optimized layout of 3 parts", "other cords"]),
        (True, None, True, ["the optimized layout,"]),
    ],
)
def test_the_parts_state_their_cords(is_moved, parts, are_drawn, words):
    cords = BuiltCords((), 0.491, (0.8, 0.5, 1.5), parts, is_moved)
    shown = make_state(BuildState(is_built=True, cords=cords, are_cords_drawn=are_drawn), "", None)
    assert (shown.are_cords_drawn, shown.error) == (are_drawn, 0.491)
    assert shown.in_use == [0.8, 0.5, 1.5]
    assert all(word in shown.cords for word in words)
    assert make_state(BuildState(is_built=False, cords=cords), "", None).cords == ""
