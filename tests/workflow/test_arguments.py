"""Test that invalid arguments are refused with a code, and that NumPy's numbers are accepted."""

import threading
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import defsense_fab as df
from defsense_fab.workflow.arguments import plain
from tests.support.errors import raises
from tests.workflow.conftest import small_bar, with_record

pytestmark = pytest.mark.slow


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
        (lambda la: df.predict(la, decoder="best"), "unknown-decoder", "decoder"),
        (lambda la: df.predict(la, noise="x"), "not-a-number", "noise"),
        (lambda la: df.predict(la, noise=-1.0), "not-a-number", "noise"),
        (lambda la: df.record_twin(la.simulation), "wrong-kind", "layout"),
        (lambda la: df.record_twin(la, minutes="1"), "wrong-kind", "minutes"),
        (lambda la: df.record_twin(la, sessions=1.5), "wrong-kind", "sessions"),
        (lambda la: df.record_twin(la, seconds=20), "argument-unknown", "seconds"),
        (lambda la: df.record_twin(la, cameras="webcam"), "options-conflict", "cameras"),
        (lambda la: df.load_sessions(), "sessions-missing", "sessions"),
        (lambda la: df.load_sessions(["a"]), "not-a-path", "sessions[0]"),
        (lambda la: df.load_sessions(None), "not-a-path", "sessions[0]"),
        (lambda la: df.train(la), "wrong-kind", "data"),
        (lambda la: df.evaluate(la, la), "wrong-kind", "model"),
        (lambda la: df.recalibrate(la, "session"), "wrong-kind", "model"),
        (lambda la: df.export_dataset(la), "wrong-kind", "data"),
        (lambda la: df.record(None, ["none"], "none"), "not-a-path", "device"),
        (lambda la: df.record("bar", "twin", "twin"), "not-a-list", "cameras"),
        (lambda la: df.record("bar", ["twin"], 3), "wrong-kind", "port"),
        (lambda la: df.record("bar", ["twin"], "twin", side=1), "argument-unknown", "side"),
        (lambda la: df.process(3), "not-a-path", "session"),
        (lambda la: df.process("session", align=3), "wrong-kind", "align"),
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
        (lambda la: la.simulation.index("bent"), "unknown-state", "state"),
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
        ({"body": mesh([[0, 1, 2.5]])}, "unknown-vertex", "body.faces"),
        ({"body": mesh([[0, 1, 4]])}, "unknown-vertex", "body.faces"),
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
        ({"edge_length": 1e-9}, "out-of-range", "mesh.edge_length"),
        ({"edge_length": 1e9}, "out-of-range", "mesh.edge_length"),
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
        (lambda m, la: df.recalibrate(m), "sessions-missing", {"argument": "sessions"}),
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
        (lambda m, la: df.live(m, la, port="twin", record=3), "wrong-kind", {"argument": "record"}),
        (lambda m, la: df.live(m, la, port="twin", rate=50.5), "wrong-kind", {"argument": "rate"}),
        (
            lambda m, la: df.live(m, la, port="twin", progress=3),
            "not-callable",
            {"argument": "progress"},
        ),
        (
            lambda m, la: m.surface(np.zeros((10, 3)), la),
            "wrong-shape",
            {"argument": "positions", "shape": (10, 3)},
        ),
        (lambda m, la: m.surface([["a"]], la), "not-an-array", {"argument": "positions"}),
        (
            lambda m, la: m.surface(np.full((1, 10, 3), np.inf), la),
            "not-finite",
            {"argument": "positions"},
        ),
        (
            lambda m, la: m.surface(np.zeros((1, 10, 3)), la, "soft"),
            "unknown-mode",
            {"argument": "mode"},
        ),
        (
            lambda m, la: m.surface(np.zeros((1, 10, 3)), la.simulation),
            "wrong-kind",
            {"argument": "layout"},
        ),
        (
            lambda m, la: df.live(with_record(m, device="cube"), la, port="twin"),
            "model-misfit",
            {"reason": "device"},
        ),
        (
            lambda m, la: df.live(with_record(m, layout="0"), la, port="twin"),
            "model-misfit",
            {"reason": "cords"},
        ),
        (lambda m, la: df.live("model.json", la, port="twin"), "wrong-kind", {"argument": "model"}),
        (lambda m, la: df.live(m, port="twin"), "layout-missing", {"argument": "layout"}),
        (lambda m, la: df.live(m, la, port="twin:speed=2"), "unknown-twin-option", {}),
        (lambda m, la: df.live(m, la, port="/dev/none"), "port-not-found", {}),
        (lambda m, la: df.live(m, la, port="replay:none.csv"), "file-not-found", {}),
        (lambda m, la: df.live(m, la, port=3), "not-a-port", {"argument": "port"}),
        (
            lambda m, la: df.live(m, la, port="twin", rate=5),
            "out-of-range",
            {"value": 5},
        ),
        (
            lambda m, la: df.live(m, la, port="twin", surface="soft"),
            "unknown-choice",
            {"value": "soft"},
        ),
        (
            lambda m, la: df.live(m, la, port="twin:minutes=1", rest=[1, 2]),
            "resistance-count-differs",
            {"count": 2},
        ),
        (lambda m, la: df.train(3, la), "wrong-kind", {"argument": "data"}),
        (lambda m, la: df.load_sessions("none"), "file-not-found", {}),
    ],
)
def test_invalid_call_of_a_model_is_refused_and_leaves_no_file_and_no_thread(
    layout, model, call, code, data, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    before = threading.active_count()
    with raises(df.DefsenseError, code, **data):
        call(model, layout)
    assert threading.active_count() == before
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "code", "argument"),
    [
        ({"layout": 3}, "wrong-kind", "layout"),
        ({"decoder": None}, "wrong-kind", "decoder"),
        ({"test_share": "a"}, "wrong-kind", "test_share"),
        ({"is_synchronized": "no"}, "not-a-bool", "is_synchronized"),
        ({"time_shift": "soon"}, "not-a-number", "time_shift"),
        ({"without_markers": 3}, "wrong-kind", "without_markers"),
        ({"without_markers": ["a"]}, "wrong-kind", "without_markers"),
        ({"marker": 3}, "argument-unknown", "marker"),
    ],
)
def test_invalid_option_of_training_is_refused(twin, options, code, argument):
    with raises(df.DefsenseError, code, argument=argument):
        df.train(twin, **options)


@pytest.mark.parametrize(
    ("function", "options"),
    [
        (df.train, {"test_share": 1.0}),
        (df.train, {"folds": 1}),
        (df.train, {"level": np.float32("nan")}),
        (df.record_twin, {"minutes": 1e12}),
        (df.record_twin, {"seed": -1}),
    ],
)
def test_option_out_of_range_is_refused(twin, layout, function, options):
    with raises(df.DefsenseError, "out-of-range") as caught:
        function(twin if function is df.train else layout, **options)
    assert [caught.value.where] == list(options)


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
        without_markers=np.array([0]),
    )
    assert model.rest_positions.shape == (9, 3)
    short = df.record_twin(layout, minutes=np.float32(0.25), seed=np.int32(3), sessions=np.int8(1))
    assert len(short.recordings) == 1
