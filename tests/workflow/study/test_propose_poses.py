"""Proposed poses as text of `device.toml`, and appended to an existing file."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.regions import HalfSpace
from defsense_fab.core.errors import DeviceError
from defsense_fab.mechanics.solver.linear_response import Mode, ProposedPose
from defsense_fab.workflow.study.propose_poses import (
    Proposal,
    _end_region,
    append_poses,
    as_toml,
    extend_text,
)
from tests.support.errors import raises
from tests.support.places import BAR

MODE = Mode(12.345, np.zeros((1, 3)), "bend", 1)
ORIGIN, AXIS, FREE = (
    np.array([120.00001, -0.00001, 1 / 3]),
    np.array([1.0, 0, 0]),
    np.full(3, np.nan),
)
POSES = [
    ProposedPose("bend", MODE, ORIGIN, AXIS, np.array([0, -np.pi / 6, 0]), FREE),
    ProposedPose("stretch", MODE, ORIGIN, AXIS, np.zeros(3), np.array([15.0, 0, 0.25])),
]
HEAD = """schema = 1  # of the file
[body]
length = 1.50e+2   # mm
"""


def appended(tmp_path, before, fixed="base"):
    path = tmp_path / "device.toml"
    path.write_text(before)
    append_poses(path, Proposal((), tuple(POSES), as_toml(POSES, fixed), Path()), ())
    return path.read_text("utf-8")


def test_poses_are_written_with_short_numbers():
    text = as_toml(POSES, 'my "base"')
    data = tomllib.loads(text)
    space = data["regions"]["far_end"]["half_space"]
    assert space == {"origin": [120, 0, 0.3333], "normal": [1, 0, 0]}
    bend, stretch = data["poses"]
    assert (bend["name"], bend["fixed"]) == ("bend", ['my "base"'])
    assert bend["handles"] == [
        {"region": "far_end", "rotate": {"axis": [0, -1, 0], "degrees": 30}, "translate": "free"}
    ]
    assert stretch["handles"] == [{"region": "far_end", "translate": [15, 0, 0.25]}]
    assert "degrees = 30}" in text
    assert "translate = [15, 0, 0.25]\n" in text
    assert text.count("# mode of 12.3 Hz") == 2
    # A free end is moved starting from its position after the bend.
    assert data["states"] == {
        "ramp": [0.25, 0.5, 0.75, 1],
        "mixtures": [{"bend": 0.5, "stretch": 0.5}, {"bend": 1, "stretch": 1}],
        "held_out": [{"bend": 1, "stretch": 0.5}, {"bend": 0.5, "stretch": 1}],
    }
    assert as_toml([], "base") == ""


def test_existing_text_is_kept(tmp_path):
    before = (
        HEAD + '[regions]  # named\nbase = { box = 1 }\n\n# the rest\n[[poses]]\nname="up"  # !\n'
    )
    text = appended(tmp_path, before)
    assert text.startswith(before + "\n[regions.far_end]\n")
    data = tomllib.loads(text)
    assert list(data["regions"]) == ["base", "far_end"]
    assert [p["name"] for p in data["poses"]] == ["up", "bend", "stretch"]
    assert "states" not in data  # those of the new poses alone are not the device's
    assert "states" in tomllib.loads(appended(tmp_path, HEAD))


def test_tables_and_arrays_in_one_line_are_extended_inside(tmp_path):
    before = (
        'poses = [\n  { name = "up" },  # one\n]\nregions = { base = { box = 1 } }  # two\n' + HEAD
    )
    text = appended(tmp_path, before)
    data, alone = tomllib.loads(text), tomllib.loads(as_toml(POSES, "base"))
    assert data["poses"] == [{"name": "up"}, *alone["poses"]]
    assert data["regions"] == {"base": {"box": 1}, **alone["regions"]}
    for part in ('  { name = "up" },  # one\n', "}  # two\n", HEAD.rstrip("\n")):
        assert part in text
    assert appended(tmp_path, HEAD + "regions = { base = { box = 1 } }\n").startswith(HEAD)


def test_a_file_that_cannot_be_extended_is_unchanged(tmp_path):
    before = 'poses = "none"\n' + HEAD
    with raises(DeviceError, "file-not-extendable"):
        appended(tmp_path, before)
    assert (tmp_path / "device.toml").read_text("utf-8") == before


def test_an_existing_region_is_reused(tmp_path):
    """Poses can be added one after the other."""
    device = load_device(BAR, complete=False)
    text = as_toml(POSES, "base", "tip")
    shape = tomllib.loads(text)["regions"]["tip"]["half_space"]
    end = HalfSpace(np.array(shape["origin"], float), np.array(shape["normal"], float))
    assert _end_region(device, POSES) == "far_end"
    known = replace(device, regions={**device.regions, "far_end": end})
    assert _end_region(known, POSES) == "far_end"
    other = replace(end, origin=end.origin + 1.0)
    moved = replace(device, regions={**device.regions, "far_end": other})
    assert _end_region(moved, POSES) == "far_end_new"
    before = (BAR / "device.toml").read_text(encoding="utf-8")
    after = tomllib.loads(extend_text(before, text))
    assert after["regions"] == tomllib.loads(before)["regions"]
    assert len(after["poses"]) == len(device.poses) + len(POSES)
