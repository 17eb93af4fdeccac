"""The step Poses, driven by requests; a fake server keeps what it publishes."""

from __future__ import annotations

import shutil
import threading

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DefsenseError, DeviceError
from defsense_fab.studio.messages import pose_edits, poses
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from defsense_fab.studio.session.device_session import DeviceSession
from defsense_fab.studio.steps.poses.poses_step import PosesStep
from tests.support.errors import raises

TIMEOUT_S = 300.0


class FakePage:
    """A server or a browser: the newest event of each kind, and the newest arrays by name."""

    is_open = True

    def __init__(self):
        self.events, self.arrays, self.phases = {}, {}, []

    def publish(self, event):
        self.events[type(event)] = event

    def publish_arrays(self, arrays):
        self.arrays[arrays.name] = arrays

    def send(self, event):
        self.publish(event)
        if isinstance(event, poses.PoseShape):
            self.phases.append(event.phase)

    def send_arrays(self, arrays, reply_to=None):
        self.publish_arrays(arrays)


class Bench:
    """A step on a copy of a built bar, with one browser."""

    def __init__(self, folder):
        self.server, self.client = FakePage(), FakePage()
        self.project = Project(folder)
        self.session = DeviceSession(self.server, self.project, Agreement(trusted=True))
        self.step = PosesStep(self.session)
        self.session.on_device_changed.append(self.step.on_device_changed)
        self.session.on_build_loaded.append(self.step.on_build_loaded)
        self.session.on_freshness.append(self.step.on_freshness)
        self.session.load()
        self.step.on_device_changed()
        self.wait()

    def ask(self, kind, client=None, **content):
        return self.step.handlers[kind](client or self.client, kind(id=1, **content))

    def wait(self):
        assert self.step.wait(TIMEOUT_S)

    @property
    def state(self):
        return self.server.events[poses.PosesState]

    @property
    def device(self):
        return load_device(self.project.folder, complete=False)

    def pose(self, name):
        return next(pose for pose in self.state.poses if pose.name == name)

    def region(self, name):
        return next(region for region in self.state.regions if region.name == name)

    def shape(self):
        self.wait()
        return self.client.arrays["pose-shape"].arrays["vertices"]

    def close(self):
        self.step.close()
        self.session.close()


@pytest.fixture
def bench(live_bar, tmp_path):
    shutil.copytree(live_bar.folder, tmp_path / "bar")
    opened = Bench(tmp_path / "bar")
    yield opened
    opened.close()


@pytest.fixture
def unmeshed(live_bar, tmp_path):
    folder = tmp_path / "bar"
    shutil.copytree(live_bar.folder, folder, ignore=shutil.ignore_patterns("build"))
    opened = Bench(folder)
    yield opened
    opened.close()


def turn_about_y(degrees):
    return [0.0, float(np.deg2rad(degrees)), 0.0]


def drag(bench, degrees, *, write=False):
    (handle,) = bench.pose("bend_up").handles
    bench.ask(
        poses.MoveGrip,
        pose="bend_up",
        region="tip",
        pull=-1,
        position=handle.center,
        rotation=turn_about_y(degrees),
        write=write,
    )


def test_regions_and_poses_are_published_with_their_numbers(bench):
    state = bench.state
    assert state.mesh != "missing"
    assert [region.name for region in state.regions] == ["base", "tip"]
    tip = bench.region("tip")
    assert (tip.shape, tip.problems, tip.poses[0]) == ("box", [], "bend_up")
    assert tip.count > 3
    bend = bench.pose("bend_up")
    assert bend.roles == ["held", "turned"]
    (handle,) = bend.handles
    assert (handle.turn, handle.axis, handle.degrees) == ("angle", [0, 1, 0], -30)
    assert handle.shift == [None, None, None]
    body = bench.server.arrays["pose-body"].arrays
    assert len(body["vertices"]) > 8
    assert body["faces"].max() < len(body["vertices"])


def test_without_a_mesh_regions_are_edited_and_poses_are_not_solved(unmeshed):
    assert unmeshed.state.mesh == "missing"
    assert unmeshed.region("tip").count == 0
    with raises(DefsenseError, "not-meshed"):
        unmeshed.ask(poses.ShowPose, pose="bend_up")
    unmeshed.ask(pose_edits.ShiftRegion, region="tip", by=[-1.0, 0, 0])
    assert unmeshed.region("tip").points[0] == [139, -16, -16]


def test_regions_of_every_shape_are_added_and_changed(bench):
    for shape in ("box", "sphere", "half-space", "cylinder"):
        result = bench.ask(pose_edits.AddRegion, shape=shape)
        assert result.count > 3, shape
        assert bench.region(result.name).shape == shape
        assert not bench.region(result.name).poses
    changed = bench.ask(
        pose_edits.SetRegion, region="region", shape="sphere", points=[[75, 0, 0]], radius=25.0
    )
    assert changed.name == "region"
    assert bench.region("region").radius == 25
    box = bench.ask(pose_edits.ConvertRegion, region="region")
    assert bench.region("region").shape == "box"
    assert box.count == bench.region("region").count
    with raises(DeviceError, "not-in-device"):
        bench.ask(pose_edits.SetRegion, region="no", shape="sphere", points=[[0, 0, 0]], radius=1.0)


def test_a_box_is_fitted_to_chosen_points_and_undone(bench):
    text = bench.project.text
    result = bench.ask(pose_edits.FitRegion, region="", low=[61, -15, -15], high=[90, 15, 15])
    box = bench.device.regions[result.name]
    assert (box.low <= [61, -15, -15]).all()
    assert (box.low >= [59, -17, -17]).all()
    bench.project.undo()
    assert bench.project.text == text


def test_regions_are_copied_renamed_and_deleted(bench):
    copy = bench.ask(pose_edits.DuplicateRegion, region="tip").name
    bench.ask(pose_edits.RenameRegion, region=copy, name=" end ")
    assert [region.name for region in bench.state.regions] == ["base", "tip", "end"]
    assert bench.region("end").problems  # it shares points with the tip
    with raises(DeviceError, "name-invalid"):
        bench.ask(pose_edits.RenameRegion, region="end", name="a\nb")
    bench.ask(pose_edits.RenameRegion, region="end", name="left end, étage 2")
    assert bench.region("left end, étage 2").problems
    assert '"left end, étage 2" = {' in bench.project.text
    bench.ask(pose_edits.RenameRegion, region="left end, étage 2", name="end")
    with raises(DeviceError, "region-in-use"):
        bench.ask(pose_edits.DeleteRegions, regions=["end", "tip"])
    bench.ask(pose_edits.DeleteRegions, regions=["end"])
    assert [region.name for region in bench.state.regions] == ["base", "tip"]


def test_poses_are_added_copied_renamed_and_deleted_in_one_step(bench):
    text, name = bench.project.text, bench.ask(pose_edits.AddPose).name
    assert bench.pose(name).roles == ["held", "turned"]
    copy = bench.ask(pose_edits.DuplicatePose, pose=name).name
    bench.ask(pose_edits.RenamePose, pose=copy, name="lean")
    bench.ask(pose_edits.DeletePoses, poses=[name, "lean"])
    assert [pose.name for pose in bench.state.poses] == [p.name for p in bench.device.poses]
    assert name not in [pose.name for pose in bench.state.poses]
    for _ in range(4):
        bench.project.undo()
    assert bench.project.text == text


def test_a_new_pose_turns_as_no_other_does_and_bends_before_it_twists(bench):
    bench.ask(pose_edits.DeletePoses, poses=[pose.name for pose in bench.device.poses])
    names = [bench.ask(pose_edits.AddPose).name for _ in range(4)]
    turns = np.abs([pose.handles[0].rotation for pose in bench.device.poses]).argmax(axis=1)
    assert list(zip(names, turns, strict=True)) == [
        ("bend", 1), ("bend_2", 2), ("twist", 0), ("bend_3", 1)]  # fmt: skip


def test_turns_shifts_and_pivots_are_set_by_numbers(bench):
    tip = {"pose": "bend_up", "region": "tip"}
    bench.ask(pose_edits.SetTurn, **tip, turn="angle", axis=[0, 0, 2.0], degrees=12.5)
    bench.ask(pose_edits.SetShift, **tip, shift=[1.0, None, 0.0])
    bench.ask(pose_edits.SetPivot, **tip, about=[140.0, 0, 0])
    (handle,) = bench.pose("bend_up").handles
    assert (handle.axis, handle.degrees) == ([0, 0, 1], 12.5)
    assert handle.shift == [1, None, 0]
    assert handle.about == handle.center == [140, 0, 0]
    bench.ask(pose_edits.SetTurn, **tip, turn="hinge", axis=[1.0, 0, 0], degrees=0.0)
    (handle,) = bench.pose("bend_up").handles
    assert (handle.turn, handle.axis, handle.about) == ("hinge", [1, 0, 0], [140, 0, 0])
    bench.ask(pose_edits.SetPivot, **tip, about=None)
    assert bench.pose("bend_up").handles[0].about is None
    with raises(DeviceError, "edit-not-possible"):
        bench.ask(pose_edits.SetTurn, **tip, turn="angle", axis=[0.0, 0, 0], degrees=5.0)
    with raises(DefsenseError, "region-not-moved"):
        bench.ask(
            pose_edits.SetTurn, pose="bend_up", region="base", turn="free", axis=[], degrees=0.0
        )


def test_loads_are_added_changed_and_removed(bench):
    text, pose = bench.project.text, {"pose": "bend_up"}
    bench.ask(pose_edits.AddPull, **pose, at=[75, 0, 15], normal=[0, 0, 2.0])
    (pull,) = bench.pose("bend_up").pulls
    assert pull.by == [0, 0, pytest.approx(0.15 * bench.state.size)]
    bench.ask(pose_edits.SetPull, **pose, index=0, at=[75, 0, 15], by=[0, 0, 9], stiffness=0.4)
    assert bench.pose("bend_up").pulls == [
        poses.PullState(at=[75, 0, 15], by=[0, 0, 9], stiffness=0.4)
    ]
    bench.ask(pose_edits.SetPressure, **pose, region="tip", value=0.0004)
    bench.ask(pose_edits.SetSymmetry, **pose, region="tip", normal=[0.0, 1, 0])
    bench.ask(pose_edits.SetGravity, **pose, gravity=[0.0, 0, -1])
    loaded = bench.pose("bend_up")
    assert [(p.region, p.value) for p in loaded.pressures] == [("tip", 0.0004)]
    assert [(s.region, s.normal) for s in loaded.symmetry] == [("tip", [0, 1, 0])]
    assert loaded.gravity == [0, 0, -1]
    bench.ask(pose_edits.DeletePull, **pose, index=0)
    bench.ask(pose_edits.SetPressure, **pose, region="tip", value=None)
    bench.ask(pose_edits.SetSymmetry, **pose, region="tip", normal=None)
    bench.ask(pose_edits.SetGravity, **pose, gravity=[0.0, 0, 0])
    assert not bench.pose("bend_up").pulls
    for _ in range(9):
        bench.project.undo()
    assert bench.project.text == text
    with raises(DeviceError, "point-not-pulled"):
        bench.ask(pose_edits.DeletePull, **pose, index=0)


def test_the_shape_follows_a_drag_which_is_one_step_of_undo(bench):
    bench.ask(poses.ShowPose, pose="bend_up")
    shown = bench.shape()
    assert bench.client.phases[-1] == "checked"
    rest = bench.server.arrays["pose-body"].arrays["vertices"]
    assert np.abs(shown - rest).max() > 10
    before = bench.project.text
    for degrees in (-31, -33, -35):
        drag(bench, degrees)
    dragged = bench.shape()
    assert bench.client.events[poses.PoseShape].phase == "solved"
    assert bench.project.text == before
    drag(bench, -35, write=True)
    written = bench.shape()
    assert bench.client.events[poses.PoseShape].phase == "checked"
    assert np.abs(written - dragged).max() < 0.5
    assert bench.pose("bend_up").handles[0].degrees == -35
    bench.project.undo()
    assert bench.project.text == before
    assert np.abs(bench.shape() - shown).max() < 0.01  # the browser follows the undo


def test_a_drag_that_changes_nothing_is_solved_and_not_written(bench):
    bench.ask(poses.ShowPose, pose="bend_up")
    bench.wait()
    steps = bench.project.step_count
    drag(bench, -31)
    drag(bench, -30, write=True)
    bench.wait()
    assert bench.project.step_count == steps
    assert bench.client.events[poses.PoseShape].phase == "checked"


def test_each_browser_gets_only_its_own_pose(bench):
    other = FakePage()
    bench.ask(poses.ShowPose, pose="bend_up")
    bench.ask(poses.ShowPose, other, pose="twist")
    bench.wait()
    assert bench.client.events[poses.PoseShape].pose == "bend_up"
    assert other.events[poses.PoseShape].pose == "twist"
    assert other.phases[-1] == bench.client.phases[-1] == "checked"
    assert "pose-shape" not in bench.server.arrays
    seen = len(bench.client.phases)
    bench.ask(poses.HidePose)
    bench.ask(poses.ShowPose, other, pose="twist", share=0.5)
    bench.wait()
    assert len(bench.client.phases) == seen
    assert other.events[poses.PoseShape].share == 0.5


@pytest.mark.slow
def test_a_pose_that_is_not_reached_has_a_warning_until_it_is_changed(bench):
    bench.ask(poses.ShowPose, pose="bend_up")
    shown = bench.shape()
    tip = {"pose": "bend_up", "region": "tip"}
    bench.ask(pose_edits.SetShift, **tip, shift=[-160.0, 0, 0])
    bench.wait()
    event = bench.client.events[poses.PoseShape]
    assert event.phase in ("not-reached", "invalid")
    warning = bench.pose("bend_up").warning
    assert warning is not None
    assert warning.code == f"pose-{event.phase}"
    if event.phase == "not-reached":
        assert 0 <= warning.share < 1
        assert np.abs(bench.shape() - shown).max() < 0.01  # the last shape stays
    bench.project.undo()
    bench.wait()
    assert bench.pose("bend_up").warning is None


def test_a_role_keeps_the_region_where_it_is_shown(bench):
    bench.ask(poses.ShowPose, pose="bend_up")
    bench.wait()
    center = bench.client.events[poses.PoseShape].centers["tip"]
    (handle,) = bench.pose("bend_up").handles
    bench.ask(pose_edits.SetRole, pose="bend_up", region="tip", role="moved", center=center)
    (moved,) = bench.pose("bend_up").handles
    assert moved.shift == pytest.approx(np.subtract(center, handle.center), abs=0.051)
    assert moved.degrees == handle.degrees


def test_the_ramp_starts_at_rest_and_ends_in_the_pose(bench):
    bench.ask(poses.ShowPose, pose="bend_up")
    shown = bench.shape()
    ramp = bench.ask(poses.FollowRamp, pose="bend_up")
    frames = ramp.arrays["frames"]
    rest = bench.server.arrays["pose-body"].arrays["vertices"]
    assert ramp.facts["end"] == 1
    assert not ramp.facts["isSimulated"]  # the fields of this bar are made up
    assert np.abs(frames[0]).max() < 1e-6
    assert np.abs(rest + frames[-1] - shown).max() < 0.5


def test_a_newer_request_ends_a_ramp(bench):
    bench.ask(poses.ShowPose, pose="bend_up")
    bench.wait()
    errors = []

    def follow():
        try:
            bench.ask(poses.FollowRamp, pose="bend_up")
        except DefsenseError as error:
            errors.append(error.code)

    thread = threading.Thread(target=follow)
    thread.start()
    while bench.step.shapes.queue.is_idle and thread.is_alive():
        pass
    drag(bench, -33)
    thread.join(TIMEOUT_S)
    bench.wait()
    assert errors in ([], ["canceled"])  # it may have been faster
    assert bench.client.events[poses.PoseShape].phase == "solved"


def test_pictures_of_all_poses_are_solved_while_nothing_else_is(bench):
    while bench.step.shapes.queue.work.is_preparing:
        pass
    bench.step.poll()
    bench.wait()
    pictures = bench.server.arrays["pose-pictures"]
    assert pictures.facts["poses"] == [pose.name for pose in bench.device.poses]
    assert pictures.facts["digests"] == [pose.picture for pose in bench.state.poses]
    assert all(np.abs(moved).max() > 5 for moved in pictures.arrays.values())
    assert not bench.server.events[poses.PosePictures].is_computing


def test_simulated_states_are_listed_and_shown(bench):
    states = bench.server.events[poses.SimulatedStates]
    assert [state.name for state in states.states] == [
        "bend_up@0.5",
        "bend_up@1",
        "twist@0.5",
        "twist@1",
    ]
    half = bench.ask(poses.StateShape, state="bend_up@0.5").arrays["moved"]
    full = bench.ask(poses.StateShape, state="bend_up@1").arrays["moved"]
    assert 0 < np.abs(half).max() < np.abs(full).max()
    with raises(DefsenseError, "unknown-state"):
        bench.ask(poses.StateShape, state="../../etc/passwd")


def test_numbers_that_are_not_finite_are_refused(bench):
    text = bench.project.text
    for kind, content in (
        (pose_edits.ShiftRegion, {"region": "tip", "by": [float("nan"), 0, 0]}),
        (pose_edits.SetGravity, {"pose": "bend_up", "gravity": [0.0, 0, float("inf")]}),
        (pose_edits.SetRegion, {"region": "tip", "shape": "box", "points": [[0, 0, 0]]}),
        (poses.ShowPose, {"pose": "bend_up", "share": 7.0}),
        (poses.ShowPose, {"pose": "no"}),
        (pose_edits.SetShift, {"pose": "bend_up", "region": "tip", "shift": [1.0]}),
    ):
        with pytest.raises(DefsenseError):
            bench.ask(kind, **content)
    assert bench.project.text == text


def test_the_queue_goes_on_after_the_mesh_is_gone(bench):
    bench.ask(poses.ShowPose, pose="bend_up")
    bench.wait()
    shutil.rmtree(bench.project.folder / "build")
    bench.session.load()
    bench.wait()
    assert bench.state.mesh == "missing"
    assert bench.server.arrays["pose-body"].arrays == {}
    with raises(DefsenseError, "not-meshed"):
        bench.ask(poses.FollowRamp, pose="bend_up")


def test_the_body_conforms_to_a_region_that_is_added(bench):
    region = bench.ask(
        pose_edits.AddRegion, shape="box", points=[[63.3, -16, -16], [91.7, 16, 16]]
    ).name
    bench.wait()
    vertices = bench.server.arrays["pose-body"].arrays["vertices"]
    assert np.abs(vertices[:, 0] - 63.3).min() < 1e-3
    assert np.abs(vertices[:, 0] - 91.7).min() < 1e-3
    assert bench.region(region).count == int(
        bench.device.regions[region].contains(bench.step.points).sum()
    )
