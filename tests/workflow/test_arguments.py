"""What is no value for an argument is refused by a sentence that names it; NumPy's numbers are
taken as Python's."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import defsense_fab as df
from defsense_fab.workflow.arguments import plain
from tests.workflow.conftest import small_bar


def mesh(faces):
    """With four vertices."""
    return SimpleNamespace(vertices=np.eye(4, 3), faces=np.reshape(np.array(faces, float), (-1, 3)))


WITHIN_ITSELF: list[object] = []
WITHIN_ITSELF.append(WITHIN_ITSELF)
TABLE_WITHIN_ITSELF: dict[str, object] = {}
TABLE_WITHIN_ITSELF["a"] = TABLE_WITHIN_ITSELF


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda la: df.simulate("x"),
            "device: must be a Device, not 'x'; give that of Dev",
        ),
        (lambda la: df.simulate(None), "device: must be a Device, not None"),
        (lambda la: df.simulate(la.poses.device, None), "progress: must be a function"),
        (lambda la: df.optimize(la.poses.device), "poses: must be a Simulation, not a Device"),
        (lambda la: df.fabricate(la.poses.device), "layout: must be a Layout, not a Device"),
        (
            lambda la: df.fabricate(la.poses),
            "layout: must be a Layout, not a Simulation; give",
        ),
        (lambda la: df.predict(la.poses), "layout: must be a Layout, not a Simulation"),
        (lambda la: df.predict(la, la), "poses: must be a Simulation, not a Layout"),
        (lambda la: df.predict(la, decoder=np.zeros(2)), "decoder: must be text, not an array"),
        (lambda la: df.predict(la, noise="x"), "noise: must be a number above 0, not 'x'"),
        (lambda la: df.record_twin(la.poses), "layout: must be a Layout, not a Simulation"),
        (lambda la: df.record_twin(la, seconds="1"), "seconds: must be a number above 0"),
        (lambda la: df.record_twin(la, seconds=1e12), "seconds: .* above 0 and of at most 86400"),
        (lambda la: df.record_twin(la, sessions=1.5), "sessions: must be a whole number of at le"),
        (lambda la: df.record_twin(la, seed=-1), "seed: must be a whole number of at least 0"),
        (lambda la: df.load_sessions(["a"]), r"sessions\[0\]: must be a path, not a list"),
        (lambda la: df.load_sessions(None), r"sessions\[0\]: must be a path, not None"),
        (lambda la: df.train(la), "data: must be a Dataset, not a Layout; make it by load_sess"),
        (lambda la: df.Device.load(None), "folder: must be a path, not None"),
        (lambda la: df.Device.load("\ud800"), "folder: must be a path"),
        (lambda la: df.Device.load(""), "folder: must be a path, not ''"),
        (lambda la: df.Model.load(None), "path: must be a path, not None"),
        (lambda la: la.poses.device.save(None), "folder: must be a path, not None"),
        (lambda la: la.poses.device.changed({5: 1}), "keys are texts as in .*, not 5"),
        (lambda la: la.poses.device.changed({"": 1}), "keys are texts as in .*, not ''"),
        (lambda la: la.poses.device.changed("x"), "values: must be a dict of keys"),
        (lambda la: la.poses.device.changed({"name": "\ud800"}), "name: .* no file can hold"),
        (lambda la: la.poses.device.changed({"cord.noise": {1: 2}}), "cord.noise.: keys are texts"),
        (lambda la: la.poses.index(0), "state: must be text, not 0"),
        (lambda la: la.poses.displaced(None), "points: must be an array of numbers, not None"),
        (
            lambda la: la.poses.displaced(np.zeros((600, 2), complex)),
            r"must be an array of numbers, not an array of complex128 of shape \(600, 2\)",
        ),
        (lambda la: la.poses.displaced(np.zeros((1, 3), bool)), "not an array of bool of shape"),
        (lambda la: la.poses.displaced(np.zeros(3, "M8[s]")), r"an array of datetime64\[s\] of"),
        (lambda la: la.poses.displaced([[np.nan, 0, 0]]), "points: must be finite, in mm"),
        (lambda la: df.Pose(5), "name: must be text, not 5"),
        (lambda la: df.Pose("a", "base"), "fixed: must be a list, not 'base'; write"),
        (lambda la: df.Pose("a", None), "fixed: must be a list, not None"),
        (lambda la: df.Pose("a", [5]), r"fixed\[0\]: must be text, not 5"),
        (lambda la: df.Pose("a", handles=df.Handle("b")), "handles: must be a list, not a Handle"),
        (lambda la: df.Pose("a", handles=["b"]), r"handles\[0\]: must be a Handle, not 'b'"),
        (lambda la: df.Pose("a", drags=[3]), r"drags\[0\]: must be a Drag, not 3"),
        (lambda la: df.Pose("a", gravity=object()).table(), "gravity: give numbers"),
        (lambda la: df.Handle(None), "region: must be text, not None"),
        (lambda la: df.Handle("a", degrees=None).table(), "degrees: give numbers"),
        (lambda la: df.Pressure(1, 2.0), "region: must be text"),
        (lambda la: df.Symmetry(1, (0, 0, 1)), "region: must be text"),
        (lambda la: df.DrawnCord(1, [], [], [], []), "name: must be text"),
    ],
)
def test_what_is_no_such_object_is_told(layout, call, message):
    with pytest.raises(df.DefsenseError, match=message):
        call(layout)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": None}, "name: give numbers, texts, or lists of them, not None"),
        ({"name": 5}, "name: must be a text"),
        ({"poses": df.Pose("a")}, "poses: must be a list, not a Pose"),
        ({"poses": None}, "poses: must be a list, not None"),
        ({"poses": ["bend"]}, r"poses\[0\]: must be a Pose, not 'bend'"),
        ({"cords": [3]}, r"cords\[0\]: must be a DrawnCord, not 3"),
        ({"regions": None}, "regions: must be a dict of shapes by name"),
        ({"regions": {" ": df.sphere([0, 0, 0], 1)}}, "names must be text that is not empty"),
        ({"regions": {3: df.sphere([0, 0, 0], 1)}}, "names must be text that is not empty, not 3"),
        ({"values": 3}, "values: must be a dict"),
        ({"edge_length": None}, "edge_length: give numbers"),
        ({"material": np.zeros(3)}, "name: must be a text"),
        ({"values": {"cord.noise": WITHIN_ITSELF}}, "cord.noise: .* or contains itself"),
        ({"values": {"cord": TABLE_WITHIN_ITSELF}}, "cord.a.*: .* or contains itself"),
        ({"edge_length": 1e-9}, "edge length 1e-09 mm: give one from 0.6"),
        ({"edge_length": 1e9}, r"edge length 1e\+09 mm: .* to 20 mm"),
        ({"edge_length": "12"}, "edge_length: must be a number, not '12'"),
        ({"sensors": 99}, "sensors: must be a whole number from 1 to 16, not 99"),
        ({"body": mesh([[0, 1, 2.5]])}, "faces: must be whole numbers of the 4 vertices"),
        ({"body": mesh([[0, 1, 4]])}, "faces: must be whole numbers of the 4 vertices"),
        ({"body": mesh([])}, "body: has no triangles"),
        ({"name": "\ud800"}, "name: .* no file can hold"),
    ],
)
def test_what_makes_no_device_is_told(changes, message):
    with pytest.raises(df.DefsenseError, match=message):
        small_bar(**changes)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m, la: m.save("none/model.json"), "^none/model.json: No such file"),
        (lambda m, la: m.save(None), "path: must be a path"),
        (lambda m, la: m.save("model.txt"), "a model is a .json file"),
        (lambda m, la: m.surface(None, la), "positions: must be an array of numbers, not None"),
        (lambda m, la: m.surface(np.zeros((1, 10, 3)), None), "layout: must be a Layout, not None"),
        (lambda m, la: m.surface(np.zeros((1, 10, 3)), la, []), "mode: must be text, not a list"),
        (
            lambda m, la: df.live(m, la, port="twin", surface=[]),
            "surface: must be text, not a",
        ),
        (lambda m, la: m.predict(None, [[1.0]], [1.0]), "time: must be an array of numbers"),
        (lambda m, la: la.picture().save("none.jpg"), "none.jpg: a picture is a .png file"),
        (lambda m, la: la.picture().save("none/a.png"), "^none/a.png: No such file"),
        (lambda m, la: la.picture().save(None), "path: must be a path"),
        (lambda m, la: df.live(m, la, port="twin", record=3), "record: must be a path"),
        (lambda m, la: df.live(m, la, port="twin", progress=3), "progress: must be a function"),
    ],
)
def test_what_no_model_takes_is_told_and_leaves_no_file(
    layout, model, call, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(df.DefsenseError, match=message):
        call(model, layout)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"layout": 3}, "layout: must be a Layout, not 3"),
        ({"decoder": None}, "decoder: must be text"),
        ({"test_share": "a"}, "test_share: must be a number"),
        ({"in_step": "no"}, "in_step: must be True or False, not 'no'"),
        ({"shift": "soon"}, "shift: must be a number"),
        ({"without_markers": 3}, "without_markers: must be a list, not 3"),
        ({"without_markers": ["a"]}, "without_markers: must be a whole number"),
    ],
)
def test_what_no_training_takes_is_told(twin, options, message):
    with pytest.raises(df.DefsenseError, match=message):
        df.train(twin, **options)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: df.box([1, 0, 0], [0, 1, 1]), "box: the first corner must be lower"),
        (lambda: df.box([0, 0, np.nan], [1, 1, 1]), "low: must be 3 finite numbers"),
        (lambda: df.box(None, [1, 1, 1]), "low: must be an array of numbers, not None"),
        (lambda: df.sphere([0, 0, 0], 0), "radius: must be a number above 0, not 0"),
        (lambda: df.sphere([0, 0, 0], np.nan), "radius: must be a number above 0, not nan"),
        (lambda: df.sphere([0, 0, 0], None), "radius: must be a number above 0, not None"),
        (lambda: df.half_space([0, 0, 0], [0, 0, 0]), "normal: must not be zero"),
        (lambda: df.cylinder([0, 0, 0], [0, 0, 0], 1), "end: must differ from start"),
        (lambda: df.cylinder([0, 0, 0], [0, 0, 1], True), "radius: must be a number"),
    ],
)
def test_what_is_no_region_is_told(call, message):
    with pytest.raises(df.DefsenseError, match=message):
        call()


@pytest.mark.parametrize(
    ("given", "held"),
    [
        (np.int64(3), 3),
        (np.uint8(3), 3),
        (np.float32(0.5), 0.5),
        (Fraction(1, 2), 0.5),
        (np.bool_(True), True),
        (np.str_("a"), "a"),
        ([np.int32(1), (np.float16(0.5), "free")], [1, [0.5, "free"]]),
        ({"a": np.arange(3, dtype=np.int16)}, {"a": [0, 1, 2]}),
        (np.array(2), 2),
    ],
)
def test_numbers_of_any_kind_are_written_as_python_s(given, held):
    found = plain(given, "value")
    assert found == held
    assert type(found) is type(held)


def test_a_device_takes_the_numbers_of_numpy():
    made = small_bar(
        sensors=np.int64(2),
        edge_length=np.float32(12.0),
        poses=[df.Pose("bend", np.array(["base"]), [
            df.Handle("tip", (0, np.int8(1), 0), np.float32(20), ("free", np.int64(0), 1)),
        ])],
        values={"outputs.markers": np.int32(10), "cord.noise": np.float32(0.5)},
    ).changed({"design.searches": np.int64(2)})  # fmt: skip
    record = made.record
    assert (record.propose, record.searches, record.outputs.markers) == (1, 2, 10)
    assert (record.mesh.edge_length, record.cord.noise) == (12.0, 0.5)


def test_functions_take_the_numbers_of_numpy(layout, twin):
    assert df.predict(layout, noise=np.float32(0.5)) == df.predict(layout, noise=0.5)
    made = df.train(
        twin, decoder="affine", in_step=np.bool_(True), shift=np.float32(0.0),
        test_share=np.float32(0.25), without_markers=np.array([0]),
    )  # fmt: skip
    assert made.rest_positions.shape == (9, 3)
    short = df.record_twin(layout, seconds=np.int64(20), seed=np.int32(3), sessions=np.int8(1))
    assert len(short.recordings) == 1
