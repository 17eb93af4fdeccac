"""Test that invalid arguments are refused with a code, and that NumPy's numbers are accepted."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import defsense_fab as df
from defsense_fab.workflow.arguments import plain
from tests.support.errors import raises
from tests.workflow.conftest import small_bar


def mesh(faces):
    """Return a mesh with four vertices."""
    return SimpleNamespace(vertices=np.eye(4, 3), faces=np.reshape(np.array(faces, float), (-1, 3)))


RECURSIVE_LIST: list[object] = []
RECURSIVE_LIST.append(RECURSIVE_LIST)
RECURSIVE_TABLE: dict[str, object] = {}
RECURSIVE_TABLE["a"] = RECURSIVE_TABLE


@pytest.mark.parametrize(
    ("call", "code", "argument"),
    [
        (lambda la: df.simulate("x"), "wrong-kind", "device"),
        (lambda la: df.simulate(None), "wrong-kind", "device"),
        (lambda la: df.simulate(la.simulation.device, None), "not-callable", "progress"),
        (lambda la: df.optimize(la.simulation.device), "wrong-kind", "simulation"),
        (lambda la: df.fabricate(la.simulation.device), "wrong-kind", "layout"),
        (lambda la: df.fabricate(la.simulation), "wrong-kind", "layout"),
        (lambda la: df.predict(la.simulation), "wrong-kind", "layout"),
        (lambda la: df.predict(la, la), "wrong-kind", "simulation"),
        (lambda la: df.predict(la, decoder=np.zeros(2)), "wrong-kind", "decoder"),
        (lambda la: df.predict(la, decoder="best"), "decoder-unknown", "decoder"),
        (lambda la: df.predict(la, noise="x"), "not-a-number", "noise"),
        (lambda la: df.predict(la, noise=-1.0), "not-a-number", "noise"),
        (lambda la: df.record_twin(la.simulation), "wrong-kind", "layout"),
        (lambda la: df.record_twin(la, seconds="1"), "not-a-number", "seconds"),
        (lambda la: df.record_twin(la, seconds=1e12), "not-a-number", "seconds"),
        (lambda la: df.record_twin(la, sessions=1.5), "not-a-whole-number", "sessions"),
        (lambda la: df.record_twin(la, seed=-1), "not-a-whole-number", "seed"),
        (lambda la: df.load_sessions(), "sessions-missing", "sessions"),
        (lambda la: df.load_sessions(["a"]), "not-a-path", "sessions[0]"),
        (lambda la: df.load_sessions(None), "not-a-path", "sessions[0]"),
        (lambda la: df.train(la), "wrong-kind", "data"),
        (lambda la: df.Device.load(None), "not-a-path", "folder"),
        (lambda la: df.Device.load("\ud800"), "not-a-path", "folder"),
        (lambda la: df.Device.load(""), "not-a-path", "folder"),
        (lambda la: df.Model.load(None), "not-a-path", "path"),
        (lambda la: la.simulation.device.save(None), "not-a-path", "folder"),
        (lambda la: la.simulation.device.changed({5: 1}), "not-a-key", "values"),
        (lambda la: la.simulation.device.changed({"": 1}), "not-a-key", "values"),
        (lambda la: la.simulation.device.changed("x"), "not-a-dict", "values"),
        (lambda la: la.simulation.device.changed({"name": "\ud800"}), "not-encodable", "name"),
        (
            lambda la: la.simulation.device.changed({"cord.noise": {1: 2}}),
            "not-a-key",
            "cord.noise",
        ),
        (
            lambda la: la.simulation.device.changed({"cord.noise": None}),
            "not-plain",
            "cord.noise",
        ),
        (lambda la: la.simulation.index(0), "wrong-kind", "state"),
        (lambda la: la.simulation.index("bent"), "state-unknown", "state"),
        (lambda la: la.simulation.displaced(None), "not-an-array", "points"),
        (lambda la: la.simulation.displaced(np.zeros((6, 2), complex)), "not-an-array", "points"),
        (lambda la: la.simulation.displaced(np.zeros((1, 3), bool)), "not-an-array", "points"),
        (lambda la: la.simulation.displaced(np.zeros(3, "M8[s]")), "not-an-array", "points"),
        (lambda la: la.simulation.displaced([[np.nan, 0, 0]]), "not-finite", "points"),
        (lambda la: la.simulation.displaced([1, 2, 3]), "wrong-shape", "points"),
        (lambda la: df.Pose(5), "wrong-kind", "name"),
        (lambda la: df.Pose("a", "base"), "not-a-list", "fixed"),
        (lambda la: df.Pose("a", None), "not-a-list", "fixed"),
        (lambda la: df.Pose("a", [5]), "wrong-kind", "fixed[0]"),
        (lambda la: df.Pose("a", handles=df.Handle("b")), "not-a-list", "handles"),
        (lambda la: df.Pose("a", handles=["b"]), "wrong-kind", "handles[0]"),
        (lambda la: df.Pose("a", drags=[3]), "wrong-kind", "drags[0]"),
        (lambda la: df.Pose("a", gravity=object()).table(), "not-plain", "gravity"),
        (lambda la: df.Handle(None), "wrong-kind", "region"),
        (lambda la: df.Handle("a", degrees=None).table(), "not-plain", "degrees"),
        (lambda la: df.Pressure(1, 2.0), "wrong-kind", "region"),
        (lambda la: df.Symmetry(1, (0, 0, 1)), "wrong-kind", "region"),
        (lambda la: df.DrawnCord(1, [], [], [], []), "wrong-kind", "name"),
    ],
)
def test_invalid_argument_is_refused(layout, call, code, argument):
    with raises(df.DefsenseError, code, argument=argument):
        call(layout)


@pytest.mark.parametrize(
    ("changes", "code", "argument"),
    [
        ({"name": None}, "not-plain", "name"),
        ({"name": "\ud800"}, "not-encodable", "name"),
        ({"poses": df.Pose("a")}, "not-a-list", "poses"),
        ({"poses": None}, "not-a-list", "poses"),
        ({"poses": ["bend"]}, "wrong-kind", "poses[0]"),
        ({"cords": [3]}, "wrong-kind", "cords[0]"),
        ({"regions": None}, "not-a-dict", "regions"),
        ({"regions": {"base": 3}}, "wrong-kind", "regions.base"),
        ({"regions": {" ": df.sphere([0, 0, 0], 1)}}, "not-a-name", "regions"),
        ({"regions": {3: df.sphere([0, 0, 0], 1)}}, "not-a-name", "regions"),
        ({"values": 3}, "not-a-dict", "values"),
        ({"values": {"cord.noise": RECURSIVE_LIST}}, "nested-too-deeply", "cord.noise"),
        ({"values": {"cord": RECURSIVE_TABLE}}, "nested-too-deeply", "cord" + ".a" * 16),
        ({"edge_length": None}, "not-plain", "mesh.edge_length"),
        ({"edge_length": "12"}, "not-a-number", "edge_length"),
        ({"edge_length": float("nan")}, "not-a-number", "edge_length"),
        ({"sensors": 99}, "not-a-whole-number", "sensors"),
        ({"body": 3}, "not-a-body", "body"),
        ({"body": mesh([[0, 1, 2.5]])}, "vertex-unknown", "body.faces"),
        ({"body": mesh([[0, 1, 4]])}, "vertex-unknown", "body.faces"),
        ({"body": mesh([])}, "mesh-empty", "body"),
        ({"units": 5}, "wrong-kind", "units"),
    ],
)
def test_invalid_argument_of_a_device_is_refused(changes, code, argument):
    with raises(df.DefsenseError, code, argument=argument):
        small_bar(**changes)


@pytest.mark.parametrize(
    ("changes", "code", "key"),
    [
        ({"name": 5}, "value-type", "name"),
        ({"material": np.zeros(3)}, "value-type", "material.name"),
        ({"material": "foam"}, "unknown-material", "material.name"),
        (
            {"cords": [df.DrawnCord("a", [[1, [2]]], [0, 0, 6], [0, 0, 1], [1, 0, 0])]},
            "wrong-shape",
            "sensors.1.control_points",
        ),
        (
            {"poses": [df.Pose("a", ["bse"], [df.Handle("tip", degrees=20)])]},
            "unknown-region",
            "poses.1.fixed",
        ),
        (
            {"poses": [df.Pose("a", ["base"], [df.Handle("tip", (0, 1), 3.0)])]},
            "wrong-shape",
            "poses.1.handles.1.rotate.axis",
        ),
        ({"values": {"cord.noize": 1.0}}, "key-unknown", "cord.noize"),
        ({"edge_length": 1e-9}, "out-of-range", None),
        ({"edge_length": 1e9}, "out-of-range", None),
        ({"body": "none.stl"}, "file-not-found", None),
    ],
)
def test_invalid_value_of_a_device_is_refused(changes, code, key):
    with raises(df.DefsenseError, code, key=key):
        small_bar(**changes)


@pytest.mark.parametrize(
    ("call", "code", "data"),
    [
        (lambda m, la: m.save("none/model.json"), "file-not-found", {}),
        (lambda m, la: m.save(None), "not-a-path", {"argument": "path"}),
        (lambda m, la: m.save("model.txt"), "wrong-suffix", {"suffix": ".txt"}),
        (lambda m, la: m.surface(None, la), "not-an-array", {"argument": "positions"}),
        (
            lambda m, la: m.surface(np.zeros((1, 10, 3)), None),
            "wrong-kind",
            {"argument": "layout"},
        ),
        (
            lambda m, la: m.surface(np.zeros((1, 10, 3)), la, []),
            "wrong-kind",
            {"argument": "mode"},
        ),
        (
            lambda m, la: df.live(m, la, port="twin", surface=[]),
            "wrong-kind",
            {"argument": "surface"},
        ),
        (lambda m, la: m.predict(None, [[1.0]], [1.0]), "not-an-array", {"argument": "time"}),
        (lambda m, la: la.picture().save("none.jpg"), "wrong-suffix", {"suffix": ".jpg"}),
        (lambda m, la: la.picture().save("none/a.png"), "file-not-found", {}),
        (lambda m, la: la.picture().save(None), "not-a-path", {"argument": "path"}),
        (lambda m, la: df.live(m, la, port="twin", record=3), "not-a-path", {"argument": "record"}),
        (
            lambda m, la: df.live(m, la, port="twin", progress=3),
            "not-callable",
            {"argument": "progress"},
        ),
    ],
)
def test_invalid_call_of_a_model_is_refused_and_leaves_no_file(
    layout, model, call, code, data, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with raises(df.DefsenseError, code, **data):
        call(model, layout)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "code", "argument"),
    [
        ({"layout": 3}, "wrong-kind", "layout"),
        ({"decoder": None}, "wrong-kind", "decoder"),
        ({"test_share": "a"}, "not-a-number", "test_share"),
        ({"test_share": 1.0}, "out-of-range", "test_share"),
        ({"is_synchronized": "no"}, "not-a-bool", "is_synchronized"),
        ({"time_shift": "soon"}, "not-a-number", "time_shift"),
        ({"excluded_markers": 3}, "not-a-list", "excluded_markers"),
        ({"excluded_markers": ["a"]}, "not-a-whole-number", "excluded_markers"),
    ],
)
def test_invalid_option_of_training_is_refused(twin, options, code, argument):
    with raises(df.DefsenseError, code, argument=argument):
        df.train(twin, **options)


@pytest.mark.parametrize(
    ("call", "code", "argument"),
    [
        (lambda: df.box([1, 0, 0], [0, 1, 1]), "shape-empty", "box"),
        (lambda: df.box([0, 0], [1, 1, 1]), "not-a-point", "low"),
        (lambda: df.box([0, 0, np.nan], [1, 1, 1]), "not-a-point", "low"),
        (lambda: df.box(None, [1, 1, 1]), "not-an-array", "low"),
        (lambda: df.sphere([0, 0, 0], 0), "not-a-number", "radius"),
        (lambda: df.sphere([0, 0, 0], np.nan), "not-a-number", "radius"),
        (lambda: df.sphere([0, 0, 0], None), "not-a-number", "radius"),
        (lambda: df.half_space([0, 0, 0], [0, 0, 0]), "shape-empty", "normal"),
        (lambda: df.cylinder([0, 0, 0], [0, 0, 0], 1), "shape-empty", "end"),
        (lambda: df.cylinder([0, 0, 0], [0, 0, 1], True), "not-a-number", "radius"),
    ],
)
def test_invalid_region_is_refused(call, code, argument):
    with raises(df.DefsenseError, code, argument=argument):
        call()


@pytest.mark.parametrize(
    ("value", "expected"),
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
def test_numbers_of_any_type_are_written_as_python_numbers(value, expected):
    converted = plain(value, "value")
    assert converted == expected
    assert type(converted) is type(expected)


def test_device_accepts_numbers_of_numpy():
    tip = df.Handle("tip", (0, np.int8(1), 0), np.float32(20), ("free", np.int64(0), 1))
    device = small_bar(
        sensors=np.int64(2),
        edge_length=np.float32(12.0),
        poses=[df.Pose("bend", np.array(["base"]), [tip])],
        values={"outputs.markers": np.int32(10), "cord.noise": np.float32(0.5)},
    ).changed({"design.searches": np.int64(2)})
    record = device.record
    assert (record.propose, record.searches, record.outputs.markers) == (1, 2, 10)
    assert (record.mesh.edge_length, record.cord.noise) == (12.0, 0.5)


def test_functions_accept_numbers_of_numpy(layout, twin):
    assert df.predict(layout, noise=np.float32(0.5)) == df.predict(layout, noise=0.5)
    model = df.train(
        twin,
        decoder="affine",
        is_synchronized=np.bool_(True),
        time_shift=np.float32(0.0),
        test_share=np.float32(0.25),
        excluded_markers=np.array([0]),
    )
    assert model.rest_positions.shape == (9, 3)
    short = df.record_twin(layout, seconds=np.int64(20), seed=np.int32(3), sessions=np.int8(1))
    assert len(short.recordings) == 1
