"""Test the reading of `experiment.toml`: the package's examples, and problems in other files."""

from pathlib import Path

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import ExperimentError
from defsense_fab.workflow.reproduce.experiment_file import (
    example_names,
    find_experiments,
    load_experiment,
)
from defsense_fab.workflow.reproduce.options import ReproduceOptions
from tests.support.errors import raises
from tests.support.places import BAR, ROOT

ABOUT = 'about = "Three cords."'
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


def test_omitted_keys_have_their_documented_defaults(tmp_path):
    experiment = load_experiment(written(tmp_path, GOOD))
    assert [c.name for c in experiment.file.layouts] == ["full", "straight"]
    assert (experiment.session.frames, experiment.session.units, experiment.edge_length) == (
        2040,
        3,
        None,
    )
    small = experiment.at_size(quick=True, units=2)
    assert (small.session.cameras, small.session.units, small.session.frames) == ("", 2, 900)
    assert (small.quick, experiment.quick) == (True, False)
    (number,) = experiment.file.numbers
    assert (number.layout, number.over, number.at_least, number.paper) == (
        "straight",
        "full",
        2.0,
        None,
    )


@pytest.mark.parametrize(
    ("old", "new", "code", "key"),
    [
        ("count = 3", "", "key-missing", "layouts.2.count"),
        ("count = 3", "count = 2.5", "value-type", "layouts.2.count"),
        ("count = 3", "count = 51", "out-of-range", "layouts.2.count"),
        ('cords = "manual"', 'cords = "manuel"', "value-choice", "layouts.2.cords"),
        ('name = "straight"', 'name = "Full"', "name-repeated", "layouts.2.name"),
        ('name = "straight"', 'name = "../x"', "name-invalid", "layouts.2.name"),
        ('over = "full"', 'over = "fill"', "unknown-layout", "numbers.1.over"),
        ('over = "full"', 'over = "straight"', "ratio-to-itself", "numbers.1.over"),
        ('layout = "straight"', 'cord = "ecord"', "key-not-applicable", "numbers.1.cord"),
        ('quantity = "rmse"', 'quantity = "k_res"', "unknown-quantity", "numbers.1.quantity"),
        ("at_least = 2", "at_leest = 2", "key-unknown", "numbers.1.at_leest"),
        ("at_least = 2", "at_least = 2\nat_most = 3", "keys-exclusive", "numbers.1.at_least"),
        ("at_least = 2", "paper = 2", "key-missing", "numbers.1.where"),
        ('title = "A grip"', "", "key-missing", "title"),
        (ABOUT, f'{ABOUT}\n[session]\ncameras = "film"', "unknown-camera-kind", "session.cameras"),
        (ABOUT, f"{ABOUT}\n[session]\nside = [0, 0, 0]", "zero-vector", "session.side"),
        ("count = 3", 'file = "by-hand.toml"', "key-missing", "layouts.2.count"),
        (
            'cords = "optimised"',
            'cords = "drawn"\nfile = "none.toml"',
            "file-not-found",
            "layouts.1.file",
        ),
        ("count = 3", "count = 3\ndesign.planez = 2", "key-unknown", "layouts.2.design"),
        ("count = 3", "count = 3\ndesign.planes = -2", "out-of-range", "layouts.2.design"),
        (GOOD[GOOD.index("[[layouts]]") :], "", "keys-exclusive", "layouts"),
    ],
)
def test_errors_name_the_line_and_the_key(tmp_path, old, new, code, key):
    assert old in GOOD
    with raises(ExperimentError, code, key=key) as caught:
        load_experiment(written(tmp_path, GOOD.replace(old, new, 1)))
    line = caught.value.data["line"]
    assert (line is None) == (key in ("title", "layouts"))
    assert str(caught.value).startswith("experiment.toml")


@pytest.mark.parametrize(
    ("line", "code", "key"),
    [
        ("kinds = []", "name-repeated", "cords.kinds"),
        ('kinds = ["zzz"]', "value-choice", "cords.kinds"),
        ("radii = [75, 100]", "too-few-radii", "cords.radii"),
        ("radii = [75, 100, -5]", "out-of-range", "cords.radii"),
        ("lengths = [150, 150]", "name-repeated", "cords.lengths"),
        ("lengths = [10]", "out-of-range", "cords.lengths"),
        ('[[numbers]]\ncord = "etpu"\nquantity = "k_res"', "cord-not-bent", "numbers.1.quantity"),
        ('[[numbers]]\ncord = "zzz"\nquantity = "hysteresis"', "unknown-cord", "numbers.1.cord"),
    ],
)
def test_errors_of_cords_name_the_line_and_the_key(tmp_path, line, code, key):
    lengths = "" if "lengths" in line else "lengths = [150]\n"
    text = f'title = "A"\nabout = "B"\n[cords]\nk_res = 2\n{lengths}{line}\n'
    (tmp_path / "experiment.toml").write_text(text)
    with raises(ExperimentError, code, key=key) as caught:
        load_experiment(tmp_path)
    assert caught.value.data["line"] >= 5


def test_unknown_names_are_rejected_with_a_suggestion(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with raises(ExperimentError, "unknown-experiment", suggestion="bar"):
        find_experiments(["baar"])
    with raises(ExperimentError, "name-repeated", name="bar"):
        find_experiments(["bar", "bar"])
    with raises(ExperimentError, "file-not-found"):
        find_experiments([str(tmp_path)])


def test_options_set_the_size():
    (bar,) = find_experiments(["bar"], ReproduceOptions(quick=True, units=4))
    assert (bar.quick, bar.session.units) == (True, 4)
    with raises(ExperimentError, "out-of-range"):
        ReproduceOptions(units=0)


@pytest.mark.parametrize("name", example_names())
def test_examples_of_the_package_are_complete(name):
    """Their devices load, and what they need is there (in wheels: tests/release)."""
    (experiment,) = find_experiments([name])
    needed = ["experiment.toml", "reproduce.py", "README.md", "picture.png"]
    if experiment.file.cords is None:
        device = load_device(experiment.folder)
        needed += [
            "device.toml",
            device.body.path.name,
            *(c.file for c in experiment.file.layouts if c.file),
        ]
        assert device.poses
    for file in needed:
        assert (ROOT / "examples" / name / file).is_file()
    assert experiment.file.numbers
    compile(
        Path(experiment.folder, "reproduce.py").read_text(encoding="utf-8"), "reproduce.py", "exec"
    )
