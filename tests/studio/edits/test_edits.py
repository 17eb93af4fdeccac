"""Edits change their part of the file and nothing else."""

from __future__ import annotations

import difflib

import numpy as np
import pytest
import tomlkit

from defsense_fab.core.curve import REST_FRAME, Hermite, Plane, catmull_rom
from defsense_fab.core.device.device_file import parse_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.studio.edits import body, cords, poses
from tests.studio.devices import TEXT, write_device
from tests.support.errors import raises


@pytest.fixture
def folder(tmp_path):
    return write_device(tmp_path / "grip")


def done(edit, text=TEXT):
    document = tomlkit.parse(text)
    edit.change(document)
    return tomlkit.dumps(document)


def changed(edit, text=TEXT):
    """Return the removed and added lines."""
    lines = difflib.unified_diff(text.splitlines(), done(edit, text).splitlines(), n=0, lineterm="")
    return [x for x in lines if x[0] in "+-" and x[:3] not in ("+++", "---")]


def test_a_control_point_moves_and_nothing_else_in_the_file(folder):
    edit = cords.move_point("top", 2, np.array([80.00049, -3.25]))
    assert edit.name == "move control point 3 of `top`"
    assert changed(edit) == [
        "-control_points = [[2, 0], [10, 0], [75, 4.5], [140, 0], [148, 0]]",
        "+control_points = [[2, 0], [10, 0], [80, -3.25], [140, 0], [148, 0]]",
    ]


def test_points_come_and_go_with_their_tangents(folder):
    curve = Hermite(np.array([[0.0, 0], [10, 0], [20, 5], [30, 0]]), np.full((4, 2), 7.0))
    text = done(cords.set_path("side", curve))
    assert "tangents = [[7, 7], [7, 7], [7, 7], [7, 7]]" in text
    text = done(cords.insert_point("side", 2, np.array([15.0, 2.0])), text)
    text = done(cords.insert_point("side", 5, np.array([40.0, 0.0])), text)
    (side,) = [s for s in parse_device(text, folder).sensors if s.name == "side"]
    assert side.curve.points.tolist() == [[0, 0], [10, 0], [15, 2], [20, 5], [30, 0], [40, 0]]
    assert side.curve.tangents[2].tolist() == [5, 2.5]
    text = done(cords.delete_point("side", 2), text)
    assert len(parse_device(text, folder).sensors[1].curve.tangents) == 5
    smooth = Hermite(curve.points, catmull_rom(curve.points))
    assert "tangents" not in done(cords.set_path("side", smooth), text)


def test_a_cord_is_drawn_renamed_locked_and_deleted(folder):
    tilted = Plane.from_normal(np.array([1.0, 2, 3]), np.array([0.3, 0, 1]), np.array([1.0, 0, 0]))
    points = np.array([[2.0, 0], [10, 0], [60, 3], [70, 3]])
    text = done(cords.add_cord("low", tilted, Hermite(points, catmull_rom(points)), ["path"]))
    assert text.startswith(TEXT.rstrip("\n"))
    low = parse_device(text, folder).sensors[2]
    np.testing.assert_allclose(low.plane.axes, tilted.axes, atol=2e-6)
    assert low.free == {"path"}
    text = done(cords.rename_cord("low", "bottom"), text)
    text = done(cords.set_freedoms("bottom", []), text)
    assert parse_device(text, folder).sensors[2].free == frozenset()
    text = done(cords.set_freedoms("side", ["plane", "path"]), text)
    assert 'free = ["path", "plane"]' in text.split("side")[1]
    assert done(cords.remove_cord("bottom"), text).count("[[sensors]]") == 2


def test_all_cords_are_deleted_and_one_is_added(folder):
    text = done(cords.remove_cord("top"), done(cords.remove_cord("side")))
    assert "[[sensors]]" not in text
    points = np.array([[2.0, 0], [10, 0], [60, 3], [70, 3]])
    plane = Plane(np.zeros(3), np.eye(3))
    text = done(cords.add_cord("new", plane, Hermite(points, catmull_rom(points))), text)
    assert [s.name for s in parse_device(text, folder).sensors] == ["new"]


def test_a_mirrored_cord_is_the_reflection(folder):
    text = done(cords.mirror_cord("top", "low", np.zeros(3), np.array([0.0, 0, 2])))
    top, _, low = parse_device(text, folder).sensors
    seen = top.plane.to_world(top.curve.sample(8)) * [1, 1, -1]
    np.testing.assert_allclose(low.plane.to_world(low.curve.sample(8)), seen, atol=1e-6)
    tilted = done(cords.mirror_cord("side", "other", np.array([0, 1.0, 0]), np.array([0, 1, 1])))
    side, other = (s for s in parse_device(tilted, folder).sensors if s.name != "top")
    n = np.array([0, 1, 1]) / np.sqrt(2)
    at = side.plane.to_world(side.curve.sample(8))
    there = at - 2 * np.outer((at - [0, 1, 0]) @ n, n)
    np.testing.assert_allclose(other.plane.to_world(other.curve.sample(8)), there, atol=2e-3)


def test_poses_keep_their_states_and_regions_in_step(folder):
    text = done(poses.rename_pose("twist", "wring"))
    assert "mixtures = [{ bend = 0.5, wring = 0.5 }]" in text
    assert "# about its length" in text
    parse_device(text, folder)
    text = done(poses.remove_pose("bend"))
    device = parse_device(text, folder)
    assert [p.name for p in device.poses] == ["twist"]
    assert device.states.mixtures == device.states.held_out == ()
    text = done(poses.rename_region("base", "foot"))
    device = parse_device(text, folder)
    assert {p.fixed for p in device.poses} == {("foot",)}
    assert device.outputs.anchor == "foot"
    with raises(DeviceError, "region-in-use", region="tip", poses=("bend", "twist")):
        done(poses.remove_region("tip"))


def test_poses_are_added_copied_turned_and_pulled(folder):
    text = done(poses.add_pose("push", ["base"], "tip", np.eye(3)[2]))
    text = done(poses.shift_handle("push", "tip", [0, 0, -4.5]), text)
    text = done(poses.turn_handle("push", "tip", np.array([0, 0, 3.0]), 12.0), text)
    text = done(poses.turn_handle("twist", "tip", np.array([1.0, 0, 0]), 50.0), text)
    text = done(poses.duplicate_pose("twist", "twist_back"), text)
    text = done(poses.drag_point("bend", np.array([75.0, 0, 15]), np.array([0, 0, 5.0]), 2.0), text)
    text = done(poses.drag_point("bend", np.array([75.0, 0, 0]), np.array([0, 5.0, 0]), 1.0), text)
    text = done(poses.set_box("middle", np.array([60.0, -20, -20]), np.array([90, 20, 20])), text)
    text = done(poses.set_role("push", "middle", "held"), text)
    device = parse_device(text, folder)
    bend, twist, push, back = device.poses
    assert (push.handles[0].translation == [0, 0, -4.5]).all()
    assert np.rad2deg(push.handles[0].rotation).tolist() == pytest.approx([0, 0, 12])
    assert push.fixed == ("base", "middle")
    assert np.rad2deg(twist.handles[0].rotation[0]) == pytest.approx(50)
    assert (back.handles[0].about == [145, 0, 0]).all()
    assert [d.stiffness for d in bend.drags] == [2.0, 1.0]


def test_added_tables_are_separated_by_one_empty_line():
    text = done(poses.add_pose("push", ["base"], "tip", np.eye(3)[2]))
    text = done(cords.mirror_cord("top", "low", np.zeros(3), np.array([0.0, 0, 1])), text)
    text = done(cords.mirror_cord("top", "lower", np.zeros(3), np.array([0.0, 0, 1])), text)
    for head in ("[[poses]]", "[states]", "[[sensors]]"):
        for before in text.split("\n" + head)[:-1]:
            assert before.endswith("\n")
            assert not before.endswith("\n\n")
    assert not text.endswith("\n\n")


def test_values_are_written_where_they_belong(folder):
    assert changed(body.set_parameter("length", 160.0)) == [
        "-parameters = { length = 150, width = 30 }  # mm",
        "+parameters = { length = 160, width = 30 }  # mm",
    ]
    text = done(body.set_value("fabrication", "wall", 2.5))
    assert parse_device(text, folder).fabrication.wall == 2.5
    assert "wall" not in done(body.reset_value("fabrication", "wall"), text)
    assert 'name = "paw"  # as on the box' in done(body.rename_device("paw"))


def test_edits_of_missing_parts_raise(folder):
    for edit, code, data in (
        (
            cords.move_point("left", 0, np.zeros(2)),
            "not-in-device",
            {"table": "sensor", "name": "left", "names": ("top", "side")},
        ),
        (cords.delete_point("side", 4), "no-control-point", {"number": 5, "count": 4}),
        (
            poses.turn_handle("bend", "base", np.ones(3), 3.0),
            "region-not-moved",
            {"pose": "bend", "region": "base"},
        ),
        (
            poses.rename_region("mid", "x"),
            "not-in-device",
            {"table": "region", "name": "mid", "names": ("base", "tip")},
        ),
        (poses.rename_region("tip", "base"), "name-repeated", {"name": "base"}),
    ):
        with raises(DeviceError, code, **data):
            done(edit)


def test_lists_in_one_line_stay_in_one_line(folder):
    one = (
        TEXT[: TEXT.index("[[sensors]]")]
        .replace(
            "[cord]",
            'sensors_are = "above"\n\n[cord]',
        )
        .replace('sensors_are = "above"\n\n', "")
    )
    inline = (
        'sensors = [{ name = "top", plane = { origin = [0, 0, 8], normal = [0, 0, 1],'
        " x_axis = [1, 0, 0] }, control_points = [[2, 0], [10, 0], [140, 0], [148, 0]] }]\n"
    )
    text = one.replace("[body]", inline + "\n[body]", 1)
    text = done(cords.mirror_cord("top", "low", np.zeros(3), np.array([0.0, 0, 1])), text)
    text = done(cords.move_point("low", 1, np.array([11.0, 1.0])), text)
    assert "[[sensors]]" not in text
    assert [s.name for s in parse_device(text, folder).sensors] == ["top", "low"]


def test_a_chosen_material_or_cord_replaces_all_previous_values():
    text = TEXT.replace(
        'name = "ninjaflex-85a"',
        'name = "own"  # measured\nshore = "30A"\ndensity = 1.0\npoisson_ratio = 0.4',
    )
    assert changed(body.choose_material("tpu-95a"), text) == [
        '-name = "own"  # measured',
        '-shore = "30A"',
        "-density = 1.0",
        "-poisson_ratio = 0.4",
        '+name = "tpu-95a"  # measured',
    ]
    text = TEXT.replace(
        'name = "rubber-2mm"', 'name = "rubber-2mm"\nnoise = 0.001\nresponse = "r.json"'
    )
    assert changed(body.choose_cord("rubber-1.7mm"), text) == [
        '-name = "rubber-2mm"',
        '+name = "rubber-1.7mm"',
        '-response = "r.json"',
    ]


def test_a_material_and_a_printer_that_do_not_exist_together_are_not_chosen(folder):
    cast = parse_device(done(body.choose_material("dragon-skin-20")), folder)
    assert cast.fabrication.process == "cast-silicone"
    resin = done(body.choose_printer("polyjet"))
    assert parse_device(resin, folder).material.name == "tango-black-plus"
    custom = TEXT.replace('"ninjaflex-85a"', '"own"\nyoung_modulus = 2.0\npoisson_ratio = 0.48')
    kept = parse_device(done(body.choose_printer("polyjet"), custom), folder)
    assert (kept.material.name, kept.fabrication.process) == ("own", "polyjet")


def test_an_edge_length_takes_the_place_of_an_accuracy():
    text = TEXT.replace("edge_length = 6.0", "accuracy = 0.01  # of signals")
    assert changed(body.set_edge_length(7.25), text) == [
        "-accuracy = 0.01  # of signals",
        "+edge_length = 7.25  # of signals",
    ]
    assert changed(body.set_edge_length(7), TEXT) == ["-edge_length = 6.0", "+edge_length = 7"]


def test_the_number_of_cords_includes_drawn_cords(folder):
    text = done(body.set_cord_count(4))
    assert parse_device(text, folder).propose == 2
    assert "sensors = 4" in text
    assert body.set_cord_count(1).name == "set the number of cords to 1"
    back = parse_device(done(body.set_cord_count(1), text), folder)
    assert (len(back.sensors), back.propose) == (2, 0)


def test_small_values_keep_their_digits():
    assert body.shorten(0.0004) == 0.0004
    assert body.shorten(0.00123456) == 0.001235
    assert body.shorten(0.0) == 0
    assert body.shorten(12.34567) == 12.346


def test_traces_in_space_are_written_moved_and_mirrored(folder):
    printed = TEXT.replace('name = "rubber-2mm"', 'process = "printed"\ntrace = "eel"')
    assert printed.count("printed") == 1
    points = np.array([[2.0, 0, 0], [40, 5, 5], [80, -5, 0], [110, 0, 5]])
    curve = Hermite(points, 1.2 * catmull_rom(points))
    text = done(cords.add_cord("loop", REST_FRAME, curve, ("path", "ends")), printed)
    text = done(cords.move_point("loop", 1, np.array([41.0, 6, 7])), text)
    text = done(cords.mirror_cord("loop", "twin", np.zeros(3), np.array([0.0, 3, 0])), text)
    sensors = {s.name: s for s in parse_device(text, folder).sensors}
    points[1] = [41, 6, 7]
    assert sensors["loop"].curve.points == pytest.approx(points)
    assert sensors["loop"].curve.tangents == pytest.approx(curve.tangents, abs=1e-3)
    assert sensors["twin"].curve.points == pytest.approx(points * [1, -1, 1])
    assert sensors["twin"].free == {"path", "ends"}
    taken = done(cords.take_cords([sensors["loop"]]), text)
    assert [s.curve.is_planar for s in parse_device(taken, folder).sensors] == [False]
