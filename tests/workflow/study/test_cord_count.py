"""Studies that are interrupted, resumed, damaged, or asked for other numbers of cords."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.cli.main import main
from defsense_fab.core.curve import Plane
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.workflow.study import cord_count
from defsense_fab.workflow.study.cord_count import (
    FILE,
    Row,
    longest_chain,
    read_rows,
    studied_layouts,
    study_folder,
    study_key,
    write_rows,
)
from tests.support.places import BAR


def row(begun, sensors):
    return Row(sensors, 1.2, 1.0, 0.9, 0.5, "affine", begun, ())


def test_longest_chain_has_no_gaps():
    rows = [row(1, 1), row(1, 2), row(4, 4), row(4, 5), row(1, 4)]
    assert longest_chain(rows, 1) == rows[:2]
    assert longest_chain(rows, 2) == rows[:2]
    assert longest_chain(rows, 3) == []
    assert longest_chain(rows, 5) == rows[2:4]
    assert longest_chain([], 1) == []
    rows = [row(3, 3), row(3, 4), row(3, 5), row(1, 1), row(1, 2), row(1, 3), row(1, 4)]
    assert longest_chain(rows, 3) == rows[:3]
    assert longest_chain(rows, 2) == rows[3:]


def test_layouts_are_read_exactly_as_written(tmp_path, straight):
    path, axes = tmp_path / "study.json", Rotation.random(random_state=1).as_matrix()
    drawn = replace(straight(free=()), plane=Plane(np.array([0.1, 1 / 3, 7.0]), axes))
    write_rows(path, "key", [replace(row(1, 1), layout=(drawn,))])
    (found,) = read_rows(path, "key")[0].layout
    assert (found.plane.axes == axes).all()
    assert (found.plane.origin == drawn.plane.origin).all()
    assert (found.curve.points == drawn.curve.points).all()


def test_damaged_files_give_no_rows(tmp_path):
    path = tmp_path / "study.json"
    assert read_rows(path, "key") == []
    write_rows(path, "key", [row(1, 1), row(1, 2)])
    assert read_rows(path, "key") == [row(1, 1), row(1, 2)]
    assert read_rows(path, "other") == []
    data = json.loads(path.read_text("utf-8"))
    for damage in (
        [],
        {**data, "schema": 1},
        {**data, "rows": [{"sensors": 1}]},
        {**data, "rows": [{**data["rows"][0], "begun": None}]},
        {**data, "rows": [{**data["rows"][0], "rmse": None}]},
        {**data, "rows": [{**data["rows"][0], "layout": None}]},
        {**data, "rows": [{**data["rows"][0], "layout": [{}]}]},
        {"schema": 2, "key": "key"},
    ):
        path.write_text(json.dumps(damage))
        assert read_rows(path, "key") == []
    path.write_text("{")
    assert read_rows(path, "key") == []


def test_layouts_of_a_study_are_only_offered_for_its_device(tmp_path, straight):
    for name in ("bar.py", "device.toml"):
        shutil.copy(BAR / name, tmp_path)
    device, drawn = load_device(tmp_path), (straight(free=()),)
    assert studied_layouts(device, tmp_path / "build") == []
    key = study_key(device, tmp_path / "build")
    study_folder(device).mkdir()
    rows = [replace(row(1, 1), layout=drawn), replace(row(2, 2), unseen=0.9, layout=drawn * 2),
            replace(row(1, 2), layout=drawn)]  # fmt: skip
    write_rows(study_folder(device) / FILE, key, rows)
    found = studied_layouts(device, tmp_path / "build")
    summary = [(one.name, one.error, len(one.sensors), one.parts) for one in found]
    assert summary == [("study, 1 cord", 1.2, 1, None), ("study, 2 cords", 0.9, 2, None)]
    assert studied_layouts(replace(device, planes=2), tmp_path / "build") == []


@pytest.mark.parametrize(
    ("decoder", "how", "searched"),
    [("auto", "held out", "quadratic"), ("auto", "none", "affine"), ("kernel", "none", "kernel")],
)
def test_cords_are_searched_with_the_decoder_that_evaluates_them(
    tmp_path, monkeypatch, decoder, how, searched
):
    for name in ("bar.py", "device.toml"):
        shutil.copy(BAR / name, tmp_path)
    task = SimpleNamespace(unseen=SimpleNamespace(how=how))
    task.with_decoder = lambda kind: SimpleNamespace(unseen=task.unseen, design=kind)

    def layouts_by_count(design, *_, **__):
        raise LayoutError(design)

    monkeypatch.setattr(
        cord_count, "build", lambda *_: SimpleNamespace(folder=tmp_path, results={})
    )
    monkeypatch.setattr(cord_count, "load_task", lambda *_: task)
    monkeypatch.setattr(cord_count, "layouts_by_count", layouts_by_count)
    with pytest.raises(LayoutError, match=searched):
        cord_count.study_cord_count(replace(load_device(tmp_path), decoder=decoder), 1, 2)


@pytest.mark.slow
def test_a_resumed_study_gives_the_results_of_an_uninterrupted_one(tmp_path, capsys):
    text = (BAR / "device.toml").read_text("utf-8")
    text = text.replace("edge_length = 6.0", "edge_length = 12.0")
    text = text.replace("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]")
    found = []
    for name, ranges in (("whole", ["1..2"]), ("resumed", ["1", "1..2"])):
        folder = tmp_path / name
        folder.mkdir()
        shutil.copy(BAR / "bar.py", folder)
        (folder / "device.toml").write_text(text)
        for numbers in ranges:
            capsys.readouterr()
            assert main(["study", str(folder), "--sensors", numbers, "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    whole, resumed = ([r["rmse"] for r in f["rows"]] for f in found)
    assert whole == pytest.approx(resumed, rel=1e-3)
    assert whole[1] < whole[0]
    assert found[0]["decoder"] == "auto"
    assert {r["decoder"] for r in found[0]["rows"]} <= {"affine", "quadratic", "kernel"}
    assert Path(found[0]["picture"]).stat().st_size > 10_000
