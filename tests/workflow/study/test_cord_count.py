"""Test studies of the number of cords: interrupted, resumed and damaged ones."""

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
    read_rows,
    studied_cords,
    studied_layouts,
    study_folder,
    study_key,
    write_rows,
)
from tests.support.body_scripts import write_bar
from tests.support.places import BAR


def row(sensors, **values):
    return replace(Row(sensors, 1.2, 1.0, 0.9, 0.5, "affine", ()), **values)


def test_layouts_are_read_exactly_as_written(tmp_path, straight):
    path, axes = tmp_path / "study.json", Rotation.random(random_state=1).as_matrix()
    drawn = replace(straight(free=()), plane=Plane(np.array([0.1, 1 / 3, 7.0]), axes))
    write_rows(path, "key", [row(1, cords=studied_cords((drawn,)))])
    (result,) = read_rows(path, "key")[0].layout
    assert (result.plane.axes == axes).all()
    assert (result.plane.origin == drawn.plane.origin).all()
    assert (result.curve.points == drawn.curve.points).all()


def test_damaged_files_give_no_rows(tmp_path):
    path = tmp_path / "study.json"
    assert read_rows(path, "key") == []
    write_rows(path, "key", [row(1), row(2)])
    assert read_rows(path, "key") == [row(1), row(2)]
    assert read_rows(path, "other") == []
    data = json.loads(path.read_text("utf-8"))
    for damage in (
        [],
        {**data, "schema": 1},
        {**data, "rows": [{"sensors": 1}]},
        {**data, "rows": [{**data["rows"][0], "rmse": None}]},
        {**data, "rows": [{**data["rows"][0], "cords": None}]},
        {**data, "rows": [{**data["rows"][0], "cords": [{}]}]},
        {"schema": 3, "key": "key"},
    ):
        path.write_text(json.dumps(damage))
        assert read_rows(path, "key") == []
    path.write_text("{")
    assert read_rows(path, "key") == []


def test_layouts_of_a_study_are_only_offered_for_its_device(tmp_path, straight):
    for name in ("bar.py", "device.toml"):
        shutil.copy(BAR / name, tmp_path)
    device, drawn = load_device(tmp_path), studied_cords((straight(free=()),))
    assert studied_layouts(device, tmp_path / "build") == []
    key = study_key(device, tmp_path / "build")
    study_folder(device).mkdir()
    rows = [row(1, cords=drawn), row(2, unseen=0.9, cords=drawn * 2)]
    write_rows(study_folder(device) / FILE, key, rows)
    result = studied_layouts(device, tmp_path / "build")
    summary = [(one.name, one.error, len(one.sensors), one.parts) for one in result]
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
        raise LayoutError(design, code="no-room-for-cords")

    monkeypatch.setattr(
        cord_count, "build", lambda *_: SimpleNamespace(folder=tmp_path, results={})
    )
    monkeypatch.setattr(cord_count, "load_task", lambda *_: task)
    monkeypatch.setattr(cord_count, "layouts_by_count", layouts_by_count)
    with pytest.raises(LayoutError, match=searched):
        cord_count.study_cord_count(replace(load_device(tmp_path), decoder=decoder))


@pytest.mark.slow
def test_a_resumed_study_gives_the_results_of_an_uninterrupted_one(tmp_path, capsys):
    text = (BAR / "device.toml").read_text("utf-8")
    text = text.replace("edge_length = 8.0", "edge_length = 12.0")
    text = text.replace("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]")
    result = []
    for name, ranges in (("whole", ["1..2"]), ("resumed", ["1", "1..2"])):
        folder = tmp_path / name
        folder.mkdir()
        write_bar(folder)
        (folder / "device.toml").write_text(text)
        for numbers in ranges:
            capsys.readouterr()
            assert main(["study", str(folder), "--sensors", numbers, "--json"]) == 0
        result.append(json.loads(capsys.readouterr().out))
    whole, resumed = ([r["rmse"] for r in f["rows"]] for f in result)
    assert whole == pytest.approx(resumed, rel=1e-3)
    assert whole[1] < whole[0]
    assert result[0]["decoder"] == "auto"
    assert {r["decoder"] for r in result[0]["rows"]} <= {"affine", "quadratic", "kernel"}
    assert Path(result[0]["picture"]).stat().st_size > 10_000
