"""Experiments from beginning to end, as small as they can be."""

import json
from dataclasses import replace

import pytest

from defsense_fab.core.progress import silent
from defsense_fab.workflow.reproduce import run as module
from defsense_fab.workflow.reproduce.devices import sessions
from defsense_fab.workflow.reproduce.experiments.examples import find_experiments
from defsense_fab.workflow.reproduce.run import PAGE, RESULTS, reproduce

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def one_cause():
    """Each cause is another session and training."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sessions, "CAUSES", {"clocks": ("sync",)})
        yield


@pytest.fixture(scope="module")
def small():
    """The twist bar's drawn cord alone, on a coarse mesh."""
    (found,) = find_experiments(["twist-bar"])
    small = found.at_size(quick=True)
    session = replace(small.session, frames=150, tags=8, tag_size=10.0)
    return replace(small, layouts=found.layouts[:1], session=session, edge_length=18.0)


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("reproduced")


@pytest.fixture(scope="module")
def done(small, out):
    return reproduce([small], out, silent)


def test_a_device_is_built_recorded_tested_and_told(done, out):
    (found,) = done["experiments"]
    straight = found["layouts"]["straight"]
    (unit,) = straight["units"]
    assert straight["design"]["cords"] == 1
    assert unit["frames"]["tested"] >= 140
    assert unit["chosen"]["rmse"] > 1.0  # it cannot tell left from right
    moved = unit["movement"]["affine"]
    assert moved["design"] == pytest.approx(unit["affine"]["rmse"], rel=0.4)
    assert moved["design"] > 5 * moved["noise"]  # one even signal tells little, however quiet
    rows = {(r["of"], r["over"], r["quantity"]): r for r in found["numbers"]}
    assert rows["straight", None, "rmse"]["ours"] == pytest.approx(unit["chosen"]["rmse"])
    assert rows["refined", None, "rmse"]["ours"] is None
    page = (out / PAGE).read_text("utf-8")
    assert "2.40" in page
    assert f"{unit['chosen']['rmse']:.2f}" in page
    assert json.loads((out / RESULTS).read_text("utf-8")) == done


def test_the_page_keeps_experiments_that_were_made_there_before(done, out, monkeypatch):
    (found,) = done["experiments"]
    other = {**found, "name": "another", "title": "Another device"}
    monkeypatch.setattr(module, "reproduce_one", lambda *_: other)
    (small,) = find_experiments(["sheet"])
    again = reproduce([replace(small.at_size(quick=True), name="another")], out, silent)
    assert [e["name"] for e in again["experiments"]] == ["another"]
    both = json.loads((out / RESULTS).read_text("utf-8"))["experiments"]
    assert [e["name"] for e in both] == ["another", found["name"]]
    assert "Another device" in (out / PAGE).read_text("utf-8")
    assert (out / "twist-bar" / "pictures" / "twist_left-straight.png").stat().st_size > 3000


def test_what_is_done_is_taken_and_what_changes_is_made_anew(small, done, out, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("made again")

    from defsense_fab.workflow.reproduce.devices import pictures, sessions

    monkeypatch.setattr(sessions, "simulate_runs", refuse)
    monkeypatch.setattr(sessions, "train_files", refuse)
    monkeypatch.setattr(pictures, "_made", refuse)
    told = []
    assert reproduce([small], out, lambda *what: told.append(what)) == done
    assert told[-1][:2] == ("twist-bar: pictures", 1.0)
    longer = replace(small, session=replace(small.session, frames=160))
    with pytest.raises(AssertionError, match="made again"):
        reproduce([longer], out, silent)


def test_a_run_that_is_stopped_leaves_what_was_done(small, done, tmp_path, monkeypatch):
    """The page has the experiments before the one at which it was stopped."""
    other = replace(small, name="other")
    kept = dict(done["experiments"][0])

    def one(experiment, folder, left=None):
        if experiment.name == "other":
            raise KeyboardInterrupt
        return kept

    monkeypatch.setattr(module, "reproduce_one", one)
    with pytest.raises(KeyboardInterrupt):
        reproduce([small, other], tmp_path, silent)
    assert json.loads((tmp_path / RESULTS).read_text("utf-8"))["experiments"] == [kept]
    assert "twist-bar" in (tmp_path / PAGE).read_text("utf-8")
