"""Cords, regions and poses are judged by the newest body, and can follow its bounding box."""

import numpy as np
import pytest

from defsense_fab.core.curve import sample_path
from defsense_fab.core.device.regions import Cylinder, HalfSpace, Sphere
from defsense_fab.core.errors import DeviceError, LayoutError
from defsense_fab.core.mesh import Surface
from defsense_fab.studio.messages.body import BodyFit
from defsense_fab.studio.messages.poses import PosesState
from defsense_fab.studio.messages.sensors import Prediction
from defsense_fab.studio.messages.shell import Pipeline
from defsense_fab.studio.steps import body_fit as body_fit_module
from defsense_fab.studio.steps.body_fit import describe_misfits
from defsense_fab.workflow.design.body_fit import BoxMap, Misfit, fit_cords
from defsense_fab.workflow.device import load_device
from tests.support.errors import raises

LONG = 60.0


def wait(app):
    assert app.session.wait(LONG)
    for step in app.steps:
        if type(step).__name__ in ("BodyFitStep", "SensorsStep"):
            assert step.wait(LONG)


def scale_body(app, share):
    """Let the body be made again with a share of its length along x."""
    wait(app)
    surface = app.session.surface
    vertices = surface.vertices.copy()
    low = vertices[:, 0].min()
    vertices[:, 0] = low + share * (vertices[:, 0] - low)
    app.session.show_preview(Surface(vertices, surface.faces))
    wait(app)


def fit(app):
    return app.server.events[BodyFit]


def names(app, kind):
    return {misfit.name for misfit in fit(app).misfits if misfit.kind == kind}


def test_all_fits_the_built_body(app):
    wait(app)
    assert fit(app) == BodyFit(text="", can_fit=False, misfits=[])


def test_a_shorter_body_is_what_cords_regions_and_poses_are_judged_by(app):
    device = app.session.device
    scale_body(app, 0.6)
    assert names(app, "cord") == {sensor.name for sensor in device.sensors}
    assert names(app, "region") == {"tip"}
    assert names(app, "pose") == {pose.name for pose in device.poses}
    cords = len(device.sensors)
    assert fit(app).text.startswith(f"{cords} cord")
    assert fit(app).can_fit
    prediction = app.server.events[Prediction]
    assert not prediction.is_ready
    assert {v.code for v in prediction.drawn.violations} == {"path-leaves-body"}
    problems = {r.name: r.problems for r in app.server.events[PosesState].regions}
    assert problems["tip"]
    assert not problems["base"]
    states = {step.name: step.state for step in app.server.events[Pipeline].steps}
    assert (states["poses"], states["sensors"]) == ("stale", "stale")
    assert app.server.events[Pipeline].next.step == "poses"
    app.session.show_preview(None)
    wait(app)
    assert not fit(app).misfits
    assert app.server.events[Prediction].is_ready


def test_all_is_fitted_to_the_body_in_one_step_of_undo(app):
    text, folder = app.session.project.text, app.session.project.folder
    before = load_device(folder)
    scale_body(app, 0.6)
    app.browser.ask("fit-to-body")
    wait(app)
    after = load_device(folder)
    assert not fit(app).misfits
    low = app.session.surface.vertices[:, 0].min()
    for old, new in zip(before.sensors, after.sensors, strict=True):
        x = sample_path(old)
        moved = np.column_stack([low + 0.6 * (x[:, 0] - low), x[:, 1:]])
        assert np.linalg.norm(sample_path(new) - moved, axis=1).max() < 5
    assert not app.server.events[Prediction].drawn.violations
    assert after.regions["tip"].high[0] < before.regions["tip"].low[0]
    app.browser.ask("undo")
    wait(app)
    assert app.session.project.text == text
    assert fit(app).can_fit  # the body that they were made for is still known
    app.browser.ask("redo")
    wait(app)
    assert not fit(app).misfits


def test_a_fit_is_not_applied_to_what_was_changed_meanwhile(app, monkeypatch):
    def fit_while(action):
        def fit_slowly(*arguments):
            result = fit_cords(*arguments)
            action()
            return result

        monkeypatch.setattr(body_fit_module, "fit_cords", fit_slowly)

    scale_body(app, 0.6)
    pose = app.session.device.poses[0].name
    fit_while(lambda: app.browser.ask("delete-poses", poses=[pose]))
    with raises(DeviceError, "changed-meanwhile", changed=("poses",)):
        app.browser.ask("fit-to-body")
    assert app.session.project.undo_name.startswith("delete")
    text = app.session.project.text
    fit_while(lambda: app.session.show_preview(None))
    with raises(DeviceError, "changed-meanwhile", changed=("body",)):
        app.browser.ask("fit-to-body")
    assert app.session.project.text == text


def test_cords_that_were_moved_since_stay(app):
    scale_body(app, 0.6)
    moved, *others = [sensor.name for sensor in app.session.device.sensors]
    app.browser.ask("delete-cords", cords=[moved])
    app.browser.ask("undo")
    app.browser.ask("rename-cord", cord=moved, name="renamed")  # another arrangement
    wait(app)
    base = app.session.device.regions["base"]
    app.browser.ask("fit-to-body")
    wait(app)
    assert not fit(app).misfits
    np.testing.assert_array_equal(app.session.device.regions["base"].high, base.high)
    assert {sensor.name for sensor in app.session.device.sensors} == {"renamed", *others}


def test_bends_of_fitted_cords_keep_the_limits(app):
    cord = app.session.device.sensors[0]
    for index, side in ((3, -8.0), (5, -8.0)):
        to = cord.curve.points[index] + [0, side]
        app.browser.ask(
            "drag-point", cord=cord.name, index=index, to=to.tolist(), snap=False, write=True
        )
    app.browser.ask("delete-cords", cords=[s.name for s in app.session.device.sensors[1:]])
    app.browser.ask("repair-cords", cords=[])
    wait(app)
    assert not app.server.events[Prediction].drawn.violations
    scale_body(app, 0.35)
    app.browser.ask("fit-to-body")
    wait(app)
    assert not app.server.events[Prediction].drawn.violations


def test_a_region_that_was_corrected_stays(app):
    scale_body(app, 0.6)
    box = [[80, -16, -16], [91, 16, 16]]
    app.browser.ask("set-region", region="tip", shape="box", points=box)
    wait(app)
    assert not names(app, "region")
    app.browser.ask("fit-to-body")
    wait(app)
    np.testing.assert_array_equal(app.session.device.regions["tip"].low, box[0])
    assert not fit(app).misfits


def test_a_region_follows_a_longer_body_only_if_it_holds_another_part(app):
    wait(app)
    base = app.session.device.regions["base"]
    scale_body(app, 1.5)
    assert names(app, "region") == {"tip"}  # it is no longer at the end of the body
    app.browser.ask("fit-to-body")
    wait(app)
    assert app.session.device.regions["tip"].low[0] == pytest.approx(210, abs=0.1)
    np.testing.assert_array_equal(app.session.device.regions["base"].high, base.high)
    assert not fit(app).misfits


def test_a_half_space_follows_the_body(app):
    half_space = [[140, 0, 0], [1, 0, 0]]
    app.browser.ask("set-region", region="tip", shape="half-space", points=half_space)
    wait(app)
    scale_body(app, 0.6)
    assert names(app, "region") == {"tip"}
    app.browser.ask("fit-to-body")
    wait(app)
    assert not fit(app).misfits
    assert app.session.device.regions["tip"].origin[0] == pytest.approx(84, abs=0.1)


def test_undo_names_what_was_fitted(app):
    scale_body(app, 0.6)
    app.browser.ask("fit-to-body")
    name = app.session.project.undo_name
    assert "`tip`" in name
    assert "`base`" not in name


def test_a_cord_outside_an_unchanged_body_is_no_matter_of_the_body(app):
    wait(app)
    name = app.session.device.sensors[0].name
    for _ in range(8):
        name = app.browser.ask("duplicate-cord", cord=name).name
    wait(app)
    assert name in names(app, "cord")
    assert not fit(app).text


def test_nothing_is_fitted_to_the_same_body(app):
    wait(app)
    with raises(LayoutError, "no-earlier-body"):
        app.browser.ask("fit-to-body")


def test_errors_of_the_device_as_it_was_are_forgotten(app):
    session = app.session
    session.build_error = LayoutError("a cord leaves the body", code="path-leaves-body")
    app.browser.ask("rename-device", name="other")
    assert session.build_error is None


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (Sphere(np.array([1.0, 1, 1]), 2.0), Sphere(np.array([2.0, 1, 1]), 8 / 3)),
        (
            HalfSpace(np.array([1.0, 0, 0]), np.array([1.0, 0, 0])),
            HalfSpace(np.array([2.0, 0, 0]), np.array([0.5, 0, 0])),
        ),
        (
            Cylinder(np.zeros(3), np.array([1.0, 0, 0]), 2.0),
            Cylinder(np.zeros(3), np.array([2.0, 0, 0]), 2.0),
        ),
    ],
)
def test_shapes_of_regions_follow_the_box(shape, expected):
    box_map = BoxMap(np.array([[0.0, 0, 0], [1, 1, 1]]), np.array([[0.0, 0, 0], [2, 1, 1]]))
    moved = box_map.region(shape)
    for name, value in vars(expected).items():
        np.testing.assert_allclose(getattr(moved, name), value)


def misfit(kind, *, is_outside=True):
    return Misfit(kind, "a", "", (0.0, 0.0, 0.0), is_outside)


@pytest.mark.parametrize(
    ("misfits", "text"),
    [
        ([], ""),
        ([misfit("cord")], "1 trace is outside the new body"),
        ([misfit("cord", is_outside=False)], "1 trace does not fit the new body"),
        (
            [misfit("cord"), misfit("cord"), misfit("region"), misfit("pose")],
            "2 traces, 1 region and 1 pull are outside the new body",
        ),
    ],
)
def test_misfits_are_counted(misfits, text):
    assert describe_misfits(misfits, "trace") == text
