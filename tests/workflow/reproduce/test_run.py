"""Experiments from start to end, as small as possible."""

import json
from dataclasses import replace

import pytest
from msgspec import structs

from defsense_fab.core.progress import silent
from defsense_fab.workflow.reproduce import pictures, sessions
from defsense_fab.workflow.reproduce import run as module
from defsense_fab.workflow.reproduce.experiment_file import find_experiments
from defsense_fab.workflow.reproduce.options import ReproduceOptions
from defsense_fab.workflow.reproduce.run import PAGE, RESULTS, reproduce

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def small():
    """Return the twist bar with its drawn cord alone, on a coarse mesh."""
    (experiment,) = find_experiments(["twist-bar"], ReproduceOptions(quick=True))
    file = experiment.file
    session = structs.replace(experiment.session, frames=150, tags=8, tag_size=10.0)
    quick = structs.replace(file.quick, edge_length=18.0)
    file = structs.replace(file, layouts=file.layouts[:1], session=session, quick=quick)
    return replace(experiment, file=file)


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("reproduced")


@pytest.fixture(scope="module")
def done(small, out):
    return reproduce([small], out, silent)


def test_device_is_built_recorded_tested_and_on_the_page(done, out):
    (result,) = done["experiments"]
    straight = result["layouts"]["straight"]
    (unit,) = straight["units"]
    assert straight["design"]["cords"] == 1
    assert unit["frames"]["tested"] >= 140
    assert unit["chosen"]["rmse"] > 1.0  # one cord cannot distinguish left from right
    movement = unit["movement"]["affine"]
    assert movement["design"] == pytest.approx(unit["affine"]["rmse"], rel=0.4)
    assert (
        movement["design"] > 5 * movement["noise"]
    )  # a single even signal has little information even without noise
    rows = {(r["of"], r["over"], r["quantity"]): r for r in result["numbers"]}
    assert rows["straight", None, "rmse"]["ours"] == pytest.approx(unit["chosen"]["rmse"])
    assert rows["refined", None, "rmse"]["ours"] is None
    page = (out / PAGE).read_text("utf-8")
    assert "2.40" in page
    assert f"{unit['chosen']['rmse']:.2f}" in page
    assert json.loads((out / RESULTS).read_text("utf-8")) == done


def test_page_keeps_experiments_of_earlier_runs(done, out, monkeypatch):
    (result,) = done["experiments"]
    other = {**result, "name": "another", "title": "Another device"}
    monkeypatch.setattr(module, "reproduce_one", lambda *_: other)
    (small,) = find_experiments(["sheet"])
    repeated = reproduce([replace(small.at_size(quick=True), name="another")], out, silent)
    assert [e["name"] for e in repeated["experiments"]] == ["another"]
    both = json.loads((out / RESULTS).read_text("utf-8"))["experiments"]
    assert [e["name"] for e in both] == ["another", result["name"]]
    assert "Another device" in (out / PAGE).read_text("utf-8")
    assert (out / "twist-bar" / "pictures" / "twist_left-straight.png").stat().st_size > 3000


def test_results_are_reused_until_their_inputs_change(small, done, out, monkeypatch):
    def fail(*_, **__):
        raise AssertionError("computed again")

    monkeypatch.setattr(sessions, "simulate_runs", fail)
    monkeypatch.setattr(sessions, "train_files", fail)
    monkeypatch.setattr(pictures, "_draw", fail)
    reports = []
    assert reproduce([small], out, lambda *report: reports.append(report)) == done
    assert reports[-1][:2] == ("twist-bar: pictures", 1.0)
    session = structs.replace(small.session, frames=160)
    longer = replace(small, file=structs.replace(small.file, session=session))
    with pytest.raises(AssertionError, match="computed again"):
        reproduce([longer], out, silent)


def test_interrupted_run_leaves_finished_experiments(small, done, tmp_path, monkeypatch):
    other = replace(small, name="other")
    finished = dict(done["experiments"][0])

    def reproduce_one(experiment, folder, steps):
        if experiment.name == "other":
            raise KeyboardInterrupt
        return finished

    monkeypatch.setattr(module, "reproduce_one", reproduce_one)
    with pytest.raises(KeyboardInterrupt):
        reproduce([small, other], tmp_path, silent)
    assert json.loads((tmp_path / RESULTS).read_text("utf-8"))["experiments"] == [finished]
    assert "twist-bar" in (tmp_path / PAGE).read_text("utf-8")
