"""A pose that is renamed keeps its simulation."""

from __future__ import annotations

import shutil

import numpy as np

from defsense_fab.core.device.device_file import DEVICE
from defsense_fab.studio.messages import poses, shell
from defsense_fab.workflow.build.build import freshness
from defsense_fab.workflow.build.results import last_build

TIMEOUT_S = 120.0


def simulated_names(app):
    assert app.session.wait(TIMEOUT_S)
    return [state.name for state in app.server.events[poses.SimulatedStates].states]


def test_a_new_name_follows_into_the_simulation_and_back(made_app):
    session = made_app.session
    fields = dict(
        zip(simulated_names(made_app), last_build(session.device).fields.displacements, strict=True)
    )
    made_app.browser.ask("rename-pose", pose="twist", name="turn")
    names = simulated_names(made_app)
    assert names == [name.replace("twist", "turn") for name in fields]
    assert freshness(session.device)["simulate"] == "current"
    assert made_app.server.events[poses.SimulatedStates].is_current
    assert session.judge is not None
    for moved, name in zip(last_build(session.device).fields.displacements, fields, strict=True):
        np.testing.assert_array_equal(moved, fields[name])
    steps = {step.name: step.state for step in made_app.server.events[shell.Pipeline].steps}
    assert steps["poses"] == steps["inside"] == "done"

    session.project.undo()
    assert simulated_names(made_app) == list(fields)
    assert set(freshness(session.device).values()) == {"current"}  # also the parts


def test_other_changes_make_the_simulation_outdated(made_app):
    session = made_app.session
    path = session.project.folder / DEVICE
    text = path.read_text(encoding="utf-8")
    path.write_text(
        text.replace('"twist"', '"turn"').replace("degrees = 45", "degrees = 40"), encoding="utf-8"
    )
    session.project.refresh()
    assert session.wait(TIMEOUT_S)
    assert freshness(session.device)["simulate"] == "old"


def test_a_rename_without_a_build_changes_nothing(made_app):
    session = made_app.session
    shutil.rmtree(session.project.folder / "build")
    made_app.browser.ask("rename-pose", pose="twist", name="turn")
    assert [pose.name for pose in session.device.poses] == ["bend_up", "turn"]
    assert freshness(session.device)["simulate"] == "missing"
