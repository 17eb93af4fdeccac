"""A pose that is renamed keeps its simulation."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace

import numpy as np

from defsense_fab.core.device.device_file import DEVICE
from defsense_fab.store.fields import load_index, save_index
from defsense_fab.studio.messages import optimize, poses, shell
from defsense_fab.workflow.build.build import build_lock, freshness
from defsense_fab.workflow.build.results import last_build
from defsense_fab.workflow.build.stage_files import file_sizes, load_state, save_stage_record
from defsense_fab.workflow.build.stages import STAGES
from tests.studio.steps.test_optimize import optimize_step

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


def test_the_error_map_has_the_new_names(made_app):
    session = made_app.session
    optimize_step(made_app)
    former = made_app.server.events[optimize.ErrorStates].states
    fields = last_build(session.device).fields
    for pose, name in (("twist", "between"), ("bend_up", "twist"), ("between", "bend_up")):
        made_app.browser.ask("rename-pose", pose=pose, name=name)
    optimize_step(made_app)
    swapped = {"twist": "bend_up", "bend_up": "twist"}
    expected = [re.sub("twist|bend_up", lambda m: swapped[m[0]], s.name) for s in former]
    states = made_app.server.events[optimize.ErrorStates].states
    assert [s.name for s in states] == expected
    assert [s.expected for s in states] == [s.expected for s in former]
    present = last_build(session.device).fields
    for new, old in zip(states, former, strict=True):
        made_app.browser.ask("error-map-of", state=new.name)
        np.testing.assert_array_equal(
            present.displacements[present.names.index(new.name)],
            fields.displacements[fields.names.index(old.name)],
        )


def test_a_rename_while_a_build_runs_follows_when_it_ends(made_app):
    session = made_app.session
    assert session.wait(TIMEOUT_S)
    with build_lock(session.device):
        made_app.browser.ask("rename-pose", pose="twist", name="turn")
        made_app.browser.ask("rename-pose", pose="bend_up", name="lift")
        assert session.wait(TIMEOUT_S)
        assert freshness(session.device)["simulate"] == "old"
    session.load()
    assert freshness(session.device)["simulate"] == "current"
    assert {"turn@1", "lift@1"} <= set(last_build(session.device).fields.names)


def test_warnings_of_the_simulation_have_the_new_name(made_app):
    session = made_app.session
    assert session.wait(TIMEOUT_S)
    folder = session.project.folder / "build"
    texts = (
        "bend_up and twist are not mixed: untwisted regions overlap at twist@1",
        "a twist of the body at twist@1: 3 elements are inverted",
    )
    save_index(folder, replace(load_index(folder), warnings=texts))
    stage = next(stage for stage in STAGES if stage.name == "simulate")
    record = load_state(folder)["simulate"]
    save_stage_record(folder, stage, {**record, "files": file_sizes(folder, stage)})
    made_app.browser.ask("rename-pose", pose="twist", name="turn")
    assert session.wait(TIMEOUT_S)
    assert load_index(folder).warnings == (
        "bend_up and turn are not mixed: untwisted regions overlap at turn@1",
        "a twist of the body at turn@1: 3 elements are inverted",
    )
