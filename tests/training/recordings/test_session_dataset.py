"""Datasets of processed sessions."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import TrainingError
from defsense_fab.core.storage import typed_json
from defsense_fab.store.layout import layout_hash
from defsense_fab.training.data.dataset_assembly import join_datasets
from defsense_fab.training.recordings.datasets import match_to_device
from defsense_fab.training.recordings.session_dataset import session_dataset
from defsense_fab.workflow.sessions import processing
from defsense_fab.workflow.sessions.processing import process_session
from tests.store.layouts import layout
from tests.support import memory
from tests.support.errors import raises
from tests.support.places import BAR

SECONDS = 14.0
SAMPLES, FRAMES = 60.0, (30.0, 15.0)  # Hz


@pytest.fixture(scope="module")
def processed(tmp_path_factory):
    """Return a processed session of two runs, between which the cords drifted, and the result.

    Samples are at 60 Hz, frames at 30 and 15 Hz.
    """
    session = memory.create(tmp_path_factory.mktemp("train") / "s", 2, 12)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory, "BOARD_RATE", SAMPLES)
        for k, (ohm, rate) in enumerate(zip((1200.0, 1260.0), FRAMES, strict=True)):
            patch.setattr(memory, "RATE", rate)
            memory.record(session, SECONDS, np.random.default_rng(k), ohm=ohm, led=True)
        patch.setattr(
            processing, "write_report", lambda *_: None
        )  # it takes as long as all other steps
        return session, process_session(session.folder)


def changed(folder, name, **values):
    """Change keys of one of the folder's JSON files."""
    path = folder / name
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | values))


def test_each_run_becomes_a_recording(processed):
    session, result = processed
    found = session_dataset(session.folder)
    assert found.channels == tuple("abcd")
    assert found.device == "plate"
    np.testing.assert_array_equal(found.ids, session.markers.ids)
    np.testing.assert_array_equal(found.rest_points, session.markers.centers)
    aligned = read_tracks(session.folder / "aligned.csv")
    for k, (r, ohm) in enumerate(zip(found.recordings, (1200.0, 1260.0), strict=True)):
        assert r.name == f"{session.folder}/run-{k + 1}"
        assert r.rest == pytest.approx([ohm] * 4, rel=1e-3)
        # All samples are used, and no frame of the other run or of the pause.
        assert len(r.sample_time) == SECONDS * SAMPLES
        assert np.diff(r.sample_time) == pytest.approx(1 / SAMPLES, rel=1e-2)
        assert len(r.time) == pytest.approx(SECONDS * FRAMES[k], abs=1)
        assert np.diff(r.time) == pytest.approx(1 / FRAMES[k], rel=1e-2)
        assert r.visible.any(axis=1).all()
        at = np.searchsorted(aligned.time, r.time)
        np.testing.assert_array_equal(r.points, aligned.points[at])
        np.testing.assert_array_equal(r.sigma, aligned.sigma[at])
        t = r.sample_time - r.time[0]
        assert r.signals[:, 0] == pytest.approx(0.1 * memory.level(t, SECONDS), abs=5e-3)
        stated = result.quality["runs"][k]["sync"]["error_ms"] / 1e3
        assert r.sync_error == pytest.approx(stated)
        assert [name for _, name in r.poses] == ["rest", "rest"]
        begun = [at - r.time[0] for at, _ in r.poses]
        assert begun == pytest.approx([0.0, SECONDS - memory.RESTS], abs=2e-3)
    (stated,) = found.provenance["sessions"]
    assert stated["cameras"] == ["cam_0", "cam_1"]
    assert stated["version"] == result.quality["version"]
    assert stated["signals"] == "samples.csv"


def test_sessions_of_one_device_are_joined(processed, tmp_path):
    session, _ = processed
    other = shutil.copytree(session.folder, tmp_path / "other")
    changed(other, sessions.FILE, unit="second", layout="abc")
    both = join_datasets([session_dataset(session.folder), session_dataset(other)])
    assert [r.unit for r in both.recordings] == ["plate", "plate", "second", "second"]
    assert len({r.session for r in both.recordings}) == 2
    assert both.layout == "abc"
    assert len(both.provenance["sessions"]) == 2
    changed(other, sessions.FILE, device="bun")
    with raises(TrainingError, "devices-differ", devices=("plate", "bun")):
        join_datasets([session_dataset(session.folder), session_dataset(other)])
    with raises(TrainingError, "devices-differ", devices=("bar", "plate")):
        match_to_device(session_dataset(session.folder), load_device(BAR))


def test_unusable_sessions_are_refused(processed, tmp_path):
    session, _ = processed
    with raises(TrainingError, "not-a-session"):
        session_dataset(tmp_path)
    raw = memory.create(tmp_path / "raw", 2, 12)
    with raises(TrainingError, "session-not-processed", file="quality.json"):
        session_dataset(raw.folder)
    later = shutil.copytree(session.folder, tmp_path / "later")
    shutil.copytree(later / "run-2", later / "run-3")
    with raises(TrainingError, "session-not-processed", run="run-3"):
        session_dataset(later)
    old = shutil.copytree(session.folder, tmp_path / "old")
    quality = json.loads((old / "quality.json").read_text(encoding="utf-8"))
    for run in quality["runs"]:
        del run["begin"]
    changed(old, "quality.json", runs=quality["runs"])
    with raises(TrainingError, "file-damaged"):
        session_dataset(old)
    # A single run needs no start and end.
    changed(
        old,
        "quality.json",
        runs=quality["runs"][:1],
        skipped=[{"run": "run-2", "why": "lost", "ended": ""}],
    )
    assert len(session_dataset(old).recordings) == 1
    (old / "samples.csv").write_text(
        "\n".join((old / "samples.csv").read_text(encoding="utf-8").splitlines()[:1])
    )
    with raises(TrainingError, "no-usable-run") as caught:
        session_dataset(old)
    assert [reason.split(":")[0] for reason in caught.value.data["skipped"]] == ["run-2", "run-1"]


def test_samples_with_decreasing_times_are_left_out(processed, tmp_path):
    session, _ = processed
    back = shutil.copytree(session.folder, tmp_path / "back")
    lines = (back / "samples.csv").read_text(encoding="utf-8").splitlines()
    lines[100], lines[200] = lines[300], lines[200].replace(lines[200].split(",")[3], "")
    (back / "samples.csv").write_text("\n".join(lines) + "\n")
    r = session_dataset(back).recordings[0]
    whole = session_dataset(session.folder).recordings[0]
    # One sample has the time of another, and one has none.
    assert len(whole.sample_time) - len(r.sample_time) == 2
    assert (np.diff(r.sample_time) > 0).all()
    assert session_dataset(back).provenance["sessions"][0]["notes"] == []
    broken = [*lines[:50], "run-1,1,2,3"]
    (back / "samples.csv").write_text("\n".join(broken) + "\n")
    with raises(TrainingError, "cell-count-differs", line=51):
        session_dataset(back)
    (back / "samples.csv").write_text("\n".join([*lines[:50], lines[50] + "x"]) + "\n")
    with raises(TrainingError, "not-a-number", line=51, column="d_ohm"):
        session_dataset(back)


def test_sessions_must_match_the_built_cords(processed, straight, tmp_path):
    session, _ = processed
    known = layout(*(straight(name, y=k) for k, name in enumerate("dcba")))
    bar = shutil.copytree(BAR, tmp_path / "bar", ignore=shutil.ignore_patterns("build"))
    (bar / "build").mkdir()
    typed_json.save(bar / "build" / "layout.json", known)
    device = load_device(bar)
    own = shutil.copytree(session.folder, tmp_path / "own")
    changed(own, sessions.FILE, device=device.name, layout=layout_hash(known))
    found, whole = match_to_device(session_dataset(own), device), session_dataset(own)
    assert found.layout == layout_hash(known)
    assert found.channels == tuple("dcba")
    np.testing.assert_array_equal(found.recordings[0].ohm, whole.recordings[0].ohm[:, ::-1])
    changed(own, sessions.FILE, layout="other")
    with raises(TrainingError, "layouts-differ", layouts=(layout_hash(known), "other")):
        match_to_device(session_dataset(own), device)
    changed(own, sessions.FILE, layout="")
    typed_json.save(bar / "build" / "layout.json", replace(known, sensors=known.sensors[:3]))
    with raises(TrainingError, "channels-differ", missing=(), extra=("a",)):
        match_to_device(session_dataset(own), device)


@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("name", ["signals.csv", "aligned.csv", "samples.csv"])
def test_tables_that_are_cut_off_are_used(processed, tmp_path, name, share):
    session, _ = processed
    whole = {r.name.split("/")[-1]: r for r in session_dataset(session.folder).recordings}
    cut = shutil.copytree(session.folder, tmp_path / "cut")
    data = (cut / name).read_bytes()
    end = data.rindex(b",", 0, int(share * len(data))) + 3  # within a number
    (cut / name).write_bytes(data[:end])
    result = session_dataset(cut)
    for part in result.recordings:
        run = whole[part.name.split("/")[-1]]
        frames, samples = len(part.time), len(part.sample_time)
        np.testing.assert_array_equal(part.time, run.time[:frames])
        np.testing.assert_array_equal(part.points[:-1], run.points[: frames - 1])
        np.testing.assert_array_equal(part.sample_time, run.sample_time[:samples])
        np.testing.assert_array_equal(part.ohm, run.ohm[:samples])
    (session_entry,) = result.provenance["sessions"]
    assert any(name in note for note in session_entry["notes"])


def test_damaged_results_are_refused(processed, tmp_path):
    session, _ = processed
    bad = shutil.copytree(session.folder, tmp_path / "bad")
    quality = json.loads((bad / "quality.json").read_text(encoding="utf-8"))
    for R0 in ([1000.0], ["high"] * 4):
        changed(bad, "quality.json", R0={"run-1": R0})
        with raises(TrainingError, "file-damaged", run="run-1"):
            session_dataset(bad)
    changed(bad, "quality.json", R0=quality["R0"])
    text = (bad / "quality.json").read_text(encoding="utf-8")
    (bad / "quality.json").write_text(text[: len(text) // 2])
    with raises(TrainingError, "not-json"):
        session_dataset(bad)
