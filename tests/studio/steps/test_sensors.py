"""Cords are drawn, dragged and edited; the expected error follows."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from defsense_fab.core.errors import DefsenseError, DeviceError, LayoutError
from defsense_fab.studio.messages.sensors import Prediction, ProposalProgress, SmoothCord
from defsense_fab.studio.messages.shell import DeviceState, Pipeline, Undo
from defsense_fab.studio.steps import propose as propose_module
from defsense_fab.studio.steps import sensors as sensors_module
from defsense_fab.studio.steps.makeable_proposal import Proposal
from defsense_fab.workflow.device import load_device
from tests.support.errors import raises

LONG = 240.0


def step(app):
    return next(s for s in app.steps if type(s).__name__ == "SensorsStep")


def prediction(app):
    assert step(app).wait(LONG)
    return app.server.events[Prediction]


def cords(app):
    return {cord.name: cord for cord in app.server.events[DeviceState].cords}


def written(app):
    return {s.name: s for s in load_device(app.session.project.folder).sensors}


def test_drawn_cords_are_judged(app):
    found = prediction(app)
    assert found.is_ready
    assert not found.is_computing
    assert 0 < found.drawn.error < 20
    names = list(cords(app))
    assert [c.name for c in found.drawn.cords] == names
    assert {p.pose for p in found.drawn.poses} == set(app.server.events[DeviceState].poses)
    assert all(len(p.signals) == len(names) for p in found.drawn.poses)


def test_drag_is_judged_and_written_at_its_end_only(app):
    name, cord = next(iter(cords(app).items()))
    before, text = prediction(app).drawn, app.session.project.text
    x, y = cord.points[1]
    moved = app.browser.ask("drag-point", cord=name, index=1, to=[x + 1.0, y + 2.0], snap=False)
    assert moved.points[1] == [x + 1.0, y + 2.0]
    assert moved.judgement.error != before.error
    assert app.session.project.text == text
    app.browser.ask("drag-point", cord=name, index=1, to=[x + 1.0, y + 2.0], snap=False, write=True)
    np.testing.assert_allclose(written(app)[name].curve.points[1], [x + 1.0, y + 2.0], atol=1e-3)
    assert prediction(app).drawn.error == pytest.approx(moved.judgement.error, rel=1e-3)
    app.browser.ask("undo")
    assert app.session.project.text == text


def test_point_snaps_to_the_surface(app):
    name, cord = next(iter(cords(app).items()))
    outline = app.browser.ask("outline-of", origin=cord.origin, axes=cord.axes)
    edge = np.array(outline.segments).reshape(-1, 2)
    target = edge[np.abs(edge[:, 0]) == np.abs(edge[:, 0]).max()][0] + 0.4
    moved = app.browser.ask("drag-point", cord=name, index=0, to=target.tolist())
    assert moved.snapped_to
    assert moved.points[0] != target.tolist()


@pytest.mark.parametrize("to", [[1.0], [1.0, 2.0, 3.0], []])
def test_point_needs_as_many_coordinates_as_its_path(app, to):
    name = next(iter(cords(app)))
    with raises(DeviceError, "invalid-point", cord=name):
        app.browser.ask("drag-point", cord=name, index=1, to=to)


def drag(app, name, index, by, kind="drag-point"):
    """Move a control point or its tangent, and write it."""
    curve = written(app)[name].curve
    start = curve.points if kind == "drag-point" else curve.tangents
    to = (start[index] + by).tolist()
    more = {"snap": False} if kind == "drag-point" else {}
    app.browser.ask(kind, cord=name, index=index, to=to, write=True, **more)


def broken(app, name):
    return {v.code: v for v in prediction(app).drawn.violations if name in v.cords}


def test_broken_cords_are_repaired_in_one_step_of_undo(app):
    first, second = list(cords(app))[:2]
    for name, by in ((first, [0.0, 9.0]), (second, [0.0, -16.0])):
        drag(app, name, 3, by)
    assert broken(app, first)
    assert broken(app, second)
    text = app.session.project.text
    found = app.browser.ask("repair-cords", cords=[])
    assert set(found.cords) == {first, second}
    assert 0 < found.largest_move < 16
    assert not found.remaining
    assert not prediction(app).drawn.violations
    app.browser.ask("undo")
    assert app.session.project.text == text


def test_one_cord_is_repaired_alone(app):
    first, second = list(cords(app))[:2]
    for name, by in ((first, [0.0, 9.0]), (second, [0.0, -16.0])):
        drag(app, name, 3, by)
    app.browser.ask("repair-cords", cords=[first])
    assert not broken(app, first)
    assert broken(app, second)


def test_nothing_to_repair_and_no_repair_are_reported(app):
    with raises(LayoutError, "nothing-to-repair"):
        app.browser.ask("repair-cords", cords=[])
    name = next(iter(cords(app)))
    cord = cords(app)[name]
    far = [x + 500 for x in cord.origin]
    app.browser.ask("drag-plane", cord=name, origin=far, axes=cord.axes, write=True)
    with raises(LayoutError, "repair-failed", cord=name):
        app.browser.ask("repair-cords", cords=[name])


def test_smoothing_breaks_no_limit(app):
    name = next(iter(cords(app)))
    count = len(cords(app)[name].points)
    for index, side in ((2, 4.0), (3, -4.0), (4, 4.0)):
        drag(app, name, index, [-4.0 * (index == 4), side])
    drag(app, name, count - 3, [-40.0, 0.0], kind="drag-tangent")
    app.browser.ask("repair-cords", cords=[name])
    assert not broken(app, name)
    app.browser.ask("smooth-cord", cord=name)
    assert cords(app)[name].is_smooth
    assert not broken(app, name)


def meanwhile(monkeypatch, name, action):
    """Let another user act as soon as a function of the step has computed its result."""
    compute = getattr(sensors_module, name)

    def computed(*arguments):
        result = compute(*arguments)
        action()
        return result

    monkeypatch.setattr(sensors_module, name, computed)


def test_a_repair_does_not_overwrite_what_was_drawn_meanwhile(app, monkeypatch):
    name, other = list(cords(app))[:2]
    drag(app, name, 3, [0.0, 9.0])
    meanwhile(monkeypatch, "repair_cords", lambda: drag(app, name, 5, [0.0, 3.0]))
    with raises(DeviceError, "changed-meanwhile"):
        app.browser.ask("repair-cords", cords=[name])
    assert app.session.project.undo_name == f"move control point 6 of `{name}`"
    monkeypatch.undo()
    free = {"cord": other, "free": ["path"]}
    meanwhile(monkeypatch, "repair_cords", lambda: app.browser.ask("set-freedoms", **free))
    assert app.browser.ask("repair-cords", cords=[name]).cords == [name]
    assert written(app)[other].free == {"path"}


def test_repairs_end_with_their_page_or_when_their_time_is_over(app, monkeypatch):
    name = next(iter(cords(app)))
    drag(app, name, 3, [0.0, 9.0])
    text, browser = app.session.project.text, app.browser
    monkeypatch.setattr(sensors_module, "REPAIR_S", 0.0)
    with raises(LayoutError, "takes-too-long"):
        browser.ask("repair-cords", cords=[name])
    monkeypatch.undo()
    browser.is_open = False
    with raises(DefsenseError, "cancelled"):
        browser.ask("repair-cords", cords=[name])
    browser.is_open = True
    assert app.session.project.text == text


def test_a_cord_that_was_moved_meanwhile_is_not_smoothed(app, monkeypatch):
    name = next(iter(cords(app)))
    drag(app, name, 1, [9.0, 3.0], kind="drag-tangent")
    meanwhile(monkeypatch, "smooth_cord", lambda: drag(app, name, 3, [0.0, 1.0]))
    with raises(DeviceError, "changed-meanwhile"):
        app.browser.ask("smooth-cord", cord=name)
    assert app.session.project.undo_name == f"move control point 4 of `{name}`"


def test_undo_after_smooth_reverts_it_even_if_it_takes_a_while(app, monkeypatch):
    name = next(iter(cords(app)))
    drag(app, name, 1, [9.0, 3.0], kind="drag-tangent")
    app.browser.ask("rename-device", name="other")
    text, is_undone = app.session.project.text, threading.Event()
    meanwhile(monkeypatch, "smooth_cord", lambda: is_undone.wait(1.0))
    lanes = {lane: ThreadPoolExecutor(1) for lane in (SmoothCord.lane, Undo.lane)}

    def undo():
        app.browser.ask("undo")
        is_undone.set()

    smoothing = lanes[SmoothCord.lane].submit(app.browser.ask, "smooth-cord", cord=name)
    undoing = lanes[Undo.lane].submit(undo)
    smoothing.result()
    undoing.result()
    assert app.session.project.text == text
    assert app.session.project.redo_name == f"smooth `{name}`"


def test_tangent_and_plane_are_dragged(app):
    name, cord = next(iter(cords(app).items()))
    app.browser.ask("drag-tangent", cord=name, index=1, to=[9.0, 3.0], write=True)
    np.testing.assert_allclose(written(app)[name].curve.tangents[1], [9.0, 3.0], atol=1e-3)
    assert not cords(app)[name].is_smooth
    app.browser.ask("smooth-cord", cord=name)
    assert cords(app)[name].is_smooth
    origin = [cord.origin[0], cord.origin[1], cord.origin[2] + 2.0]
    app.browser.ask("drag-plane", cord=name, origin=origin, axes=cord.axes, write=True)
    np.testing.assert_allclose(written(app)[name].plane.origin, origin, atol=1e-3)
    for axes in ([[1, 0, 0]], [[0, 0, 0]] * 3):
        with raises(LayoutError, "invalid-plane"):
            app.browser.ask("drag-plane", cord=name, origin=origin, axes=axes)


def test_values_of_the_wrong_shape_are_refused(app):
    plane = {"origin": [0.0] * 3, "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
    for axes in ([], [[1, 0], [0, 1, 0], [0, 0, 1]], [[1, 0, 0]] * 2, [[]] * 3):
        with raises(LayoutError, "invalid-plane"):
            app.browser.ask("outline-of", origin=[0.0] * 3, axes=axes)
    for stroke in ([[1], [2, 3]], [[1, 2, 3]]):
        with raises(LayoutError, "invalid-point"):
            app.browser.ask("add-stroke", **plane, stroke=stroke)
    with raises(LayoutError, "stroke-too-long"):
        app.browser.ask("add-stroke", **plane, stroke=[[0, 0], [1e8, 0]])


def test_cords_are_added_copied_mirrored_renamed_and_deleted(app):
    ask, before = app.browser.ask, set(cords(app))
    straight = ask("add-straight").name
    copy = ask("duplicate-cord", cord=straight).name
    mirrored = ask("mirror-cord", cord=straight, axis="y").name
    assert set(cords(app)) == before | {straight, copy, mirrored}
    ask("rename-cord", cord=copy, name=" spine ")
    assert "spine" in written(app)
    ask("delete-cords", cords=[straight, mirrored, "spine"])
    assert set(cords(app)) == before
    ask("undo")  # one step brings all of them back
    assert set(cords(app)) == before | {straight, mirrored, "spine"}
    with raises(DeviceError, "not-in-device", name="gone"):
        ask("delete-cords", cords=["gone"])


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31m", "", "\u202ex"])
def test_names_are_one_line_of_letters(app, name):
    before = app.session.project.text
    for kind, values in (
        ("rename-device", {}),
        ("rename-cord", {"cord": next(iter(cords(app)))}),
    ):
        with pytest.raises(DeviceError, match="name"):
            app.browser.ask(kind, name=name, **values)
    assert app.session.project.text == before


def test_points_are_inserted_and_deleted(app):
    name, cord = next(iter(cords(app).items()))
    count = len(cord.points)
    middle = ((np.array(cord.points[0]) + cord.points[1]) / 2).tolist()
    app.browser.ask("insert-point", cord=name, before=1, at=middle)
    assert len(written(app)[name].curve.points) == count + 1
    app.browser.ask("delete-point", cord=name, index=1)
    assert len(written(app)[name].curve.points) == count
    with raises(DeviceError, "no-control-point"):
        app.browser.ask("delete-point", cord=name, index=99)


def test_cord_is_locked_and_freed(app):
    name = next(iter(cords(app)))
    app.browser.ask("set-freedoms", cord=name, free=["path"])
    assert written(app)[name].free == {"path"}
    app.browser.ask("set-freedoms", cord=name, free=[])
    assert cords(app)[name].free == []


def test_stroke_becomes_a_cord_and_replaces_a_path(app):
    cord = next(iter(cords(app).values()))
    outline = app.browser.ask("outline-of", origin=cord.origin, axes=cord.axes)
    edge = np.array(outline.segments).reshape(-1, 2)
    (left, low), (right, high) = edge.min(axis=0), edge.max(axis=0)
    line = np.linspace([left + 1, (low + high) / 2 + 1], [right - 1, (low + high) / 2 + 1], 40)
    plane = {"origin": cord.origin, "axes": cord.axes}
    name = app.browser.ask("add-stroke", stroke=line.tolist(), **plane).name
    assert name in written(app)
    again = (line + np.array([0.0, 1.0])).tolist()
    assert app.browser.ask("add-stroke", stroke=again, replaces=name, **plane).name == name
    assert written(app)[name].curve.points[:, 1].mean() > (low + high) / 2 + 1.5
    with raises(LayoutError, "stroke-too-short"):
        app.browser.ask("add-stroke", stroke=[[0.0, 0.0]], **plane)
    other = {"origin": cord.origin, "axes": [cord.axes[1], cord.axes[2], cord.axes[0]]}
    with raises(LayoutError, "other-plane"):
        app.browser.ask("add-stroke", stroke=line.tolist(), replaces=name, **other)


@pytest.mark.slow
def test_broken_limit_has_a_place_and_makes_the_step_stale(app):
    name, cord = next(iter(cords(app).items()))
    x, _ = cord.points[1]
    app.browser.ask("drag-point", cord=name, index=1, to=[x, 400.0], snap=False, write=True)
    found = prediction(app).drawn
    violation = next(v for v in found.violations if name in v.cords)
    assert len(violation.at) == 3
    assert found.broken
    status = {s.name: s.state for s in app.server.events[Pipeline].steps}
    assert status["sensors"] == "stale"


@pytest.mark.slow
def test_proposed_cord_lowers_the_error(app):
    before = prediction(app).drawn.error
    found = app.browser.ask("propose")
    assert prediction(app).drawn.error < before
    assert found.error < found.error_before


def test_a_canceled_proposal_adds_no_cord_and_another_one_can_start(app):
    names, send = list(cords(app)), app.browser.send

    def cancel_at_the_first_report(event):
        send(event)
        if isinstance(event, ProposalProgress) and event.share is not None:
            app.browser.ask("cancel-proposal", search=1)

    app.browser.send = cancel_at_the_first_report
    app.browser.ask("cancel-proposal", search=2)  # it waits for other work
    for number in (1, 2):
        with raises(DefsenseError, "cancelled"):
            app.browser.ask("propose", search=number)
        assert app.browser.events[-1] == ProposalProgress(share=None)
    assert list(written(app)) == names
    assert app.browser.ask("propose", search=3).name not in names


def test_a_proposal_is_not_added_to_other_cords_or_to_a_closed_device(app, monkeypatch):
    found = Proposal(app.session.device.sensors[0], 1.0, 2.0)

    def propose_while(action):
        monkeypatch.setattr(propose_module, "makeable_proposal", lambda *_: (action(), found)[1])

    propose_while(lambda: app.browser.ask("add-straight"))
    with raises(DeviceError, "changed-meanwhile", changed=("cords",)):
        app.browser.ask("propose")
    names = list(written(app))
    propose_while(app.close)
    app.close = lambda: None  # it is closed once
    with raises(DefsenseError, "cancelled"):
        app.browser.ask("propose")
    assert list(written(app)) == names


def test_two_cords_are_compared(app):
    names = list(cords(app))
    if len(names) < 2:
        names.append(app.browser.ask("duplicate-cord", cord=names[0]).name)
    found = app.browser.ask("compare-cords", first=names[0], second=names[1])
    assert found.names == names[:2]
    assert -1 <= found.correlation <= 1


def test_optimized_cords_without_parts_are_not_called_built(app):
    assert prediction(app).built > 0
    assert not prediction(app).has_built_parts


def test_built_error_is_told_apart_from_the_drawn_one(made_app):
    found = prediction(made_app)
    assert found.built > 0
    assert found.has_built_parts
    made_app.browser.ask("add-straight")
    assert not prediction(made_app).is_built_drawn
