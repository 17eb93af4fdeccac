"""Experiments as they are written: the package's own, and what is wrong in others."""

from pathlib import Path

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError, ExperimentError
from defsense_fab.workflow.reproduce.experiments.examples import example_names, find_experiments
from defsense_fab.workflow.reproduce.experiments.experiment_file import load_experiment
from tests.places import BAR, ROOT

GOOD = """schema = 1
title = "A grip"
about = "Three cords."

[[layouts]]
name = "full"
title = "optimised"
cords = "optimised"

[[layouts]]
name = "straight"
title = "straight"
cords = "manual"
count = 3

[[numbers]]
layout = "straight"
over = "full"
quantity = "rmse"
at_least = 2
"""


def written(folder, text):
    for name in ("device.toml", "bar.py"):
        (folder / name).write_bytes((BAR / name).read_bytes())
    (folder / "experiment.toml").write_text(text)
    return folder


def test_what_is_left_out_is_as_the_page_says(tmp_path):
    found = load_experiment(written(tmp_path, GOOD))
    assert [c.name for c in found.layouts] == ["full", "straight"]
    assert (found.session.frames, found.session.units, found.edge_length) == (2040, 3, None)
    small = found.at_size(quick=True, units=2)
    assert (small.session.cameras, small.session.units, small.session.frames) == ("", 2, 900)
    assert small.searches == 3
    (number,) = found.numbers
    assert (number.layout, number.over, number.at_least, number.paper) == (
        "straight", "full", 2.0, None,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("count = 3", "", r"experiment.toml:\d+: layouts.2.*count: is missing: manual cords"),
        ("count = 3", "count = 2.5", "must be a whole number from 1 to 50, not 2.5"),
        ('cords = "manual"', 'cords = "manuel"', "did you mean 'manual'"),
        ('name = "straight"', 'name = "full"', "'full' is used already"),
        ('name = "straight"', 'name = "../x"', "names a folder"),
        ('over = "full"', 'over = "fill"', r"experiment.toml:18: numbers.1.over: .*'full'"),
        ('over = "full"', 'over = "straight"', "a ratio of straight to itself is 1"),
        ("at_least = 2", "at_leest = 2", "experiment.toml:20: .*did you mean 'at_least'"),
        ("at_least = 2", "at_least = 2\nat_most = 3", "one bound is enough"),
        ("at_least = 2", "paper = 2", "where in the paper"),
        ('title = "A grip"', "", "title: is missing"),
        ('about = "Three cords."', 'about = "x"\n[session]\ncameras = "film"', "kind of cameras"),
        ('about = "Three cords."', 'about = "x"\n[session]\nside = [0, 0, 0]', "no direction"),
        ("count = 3", 'file = "by-hand.toml"', "manual cords need their number"),
        ('cords = "optimised"', 'cords = "drawn"\nfile = "none.toml"', "there is no none.toml"),
        ("count = 3", "count = 3\ndesign.planez = 2", r":\d+: layouts.2.design: design.*'planes'"),
        ("count = 3", "count = 3\ndesign.planes = -2", r":\d+: layouts.2.design: design.planes"),
        (GOOD[GOOD.index("[[layouts]]"):], "", r"give either \[\[layouts\]\]"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(tmp_path, old, new, told):
    assert old in GOOD
    with pytest.raises(DeviceError, match=told):
        load_experiment(written(tmp_path, GOOD.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("kinds = []", r"experiment.toml:\d+: cords.kinds: give at least one"),
        ("radii = [75, 100]", "cords.radii: must be mm above 0, at least 3"),
        ("radii = [75, 100, -5]", "cords.radii: must be mm above 0"),
        ("lengths = [150, 150]", "cords.lengths: give each length once"),
        ('[[numbers]]\ncord = "etpu"\nquantity = "k_res"', "k_res is of ecord alone"),
    ],
)
def test_what_is_wrong_with_cords_is_told_with_its_place(tmp_path, line, told):
    lengths = "" if "lengths" in line else "lengths = [150]\n"
    text = f'title = "A"\nabout = "B"\n[cords]\nk_res = 2\n{lengths}{line}\n'
    (tmp_path / "experiment.toml").write_text(text)
    with pytest.raises(DeviceError, match=told):
        load_experiment(tmp_path)


def test_unknown_names_are_told_with_the_nearest(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ExperimentError, match=r"baar: is neither .* did you mean bar"):
        find_experiments(["baar"])
    with pytest.raises(ExperimentError, match="bar: is given twice"):
        find_experiments(["bar", "bar"])
    with pytest.raises(ExperimentError, match="no such file"):
        find_experiments([str(tmp_path)])


@pytest.mark.parametrize("name", example_names())
def test_the_packages_examples_are_whole(name):
    """Their devices load, and what they need is there (in wheels: tests/release)."""
    (found,) = find_experiments([name])
    needed = ["experiment.toml", "reproduce.py", "README.md", "picture.png"]
    if found.cords is None:
        device = load_device(found.folder)
        needed += ["device.toml", device.body.path.name, *(c.file for c in found.layouts if c.file)]
        assert device.poses
    for file in needed:
        assert (ROOT / "examples" / name / file).is_file()
    assert found.numbers
    compile(Path(found.folder, "reproduce.py").read_text(encoding="utf-8"), "reproduce.py", "exec")
