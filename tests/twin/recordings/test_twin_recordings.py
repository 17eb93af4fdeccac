"""Simulated training sessions, as records and as files."""

import json
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.capture.sessions.session import finished_steps, load
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import CaptureError, DefsenseError
from defsense_fab.core.markers import read_markers
from defsense_fab.sensing.built_cord import CordReading
from defsense_fab.store.layout import layout_hash, load_layout, load_prediction
from defsense_fab.training.fitting.model_file import load_model
from defsense_fab.twin.devices.twin_traits import TwinTraits
from defsense_fab.twin.options import TwinOptions
from defsense_fab.twin.recordings.twin_recordings import simulate_runs
from defsense_fab.workflow.sessions.processing import process_session
from defsense_fab.workflow.sessions.twin_sessions import check_free
from tests.support.errors import raises

SECONDS = 24.0


def options(**values):
    """Return options of short sessions."""
    return TwinOptions(minutes=SECONDS / 60, **values)


@pytest.fixture(scope="module")
def device(small_bar):
    return load_device(small_bar)


@pytest.fixture(scope="module")
def runs(device):
    return simulate_runs(device, options())


def test_dataset_is_complete(device, runs):
    data = runs.dataset
    run = data.recordings[0]
    build = device.source / "build"
    assert data.channels == ("cord_1", "cord_2")
    assert data.rest_points == pytest.approx(load_prediction(build).markers)
    assert data.layout == layout_hash(load_layout(build))
    assert data.provenance["response"] == {"model": "line", "coefficients": {"k": 2.0}}
    assert (len(run.time), len(run.sample_time)) == (30 * SECONDS, 60 * SECONDS)
    assert run.sync_error == 0.003
    assert [name for _, name in run.poses] == ["rest", "bend_up", "twist", "free", "rest"]
    assert np.isfinite(run.ohm).all()
    assert 0.01 < np.isnan(run.points).mean() < 0.2
    truth = runs.runs[0].truth
    error = (run.points - truth.points)[run.visible]
    assert np.abs(error).max() < 1.2
    clock_error = run.sample_time - truth.sample_time
    assert np.ptp(clock_error) < 2e-6  # the clock counts whole microseconds
    assert 0 < abs(clock_error[0]) < 0.012
    assert 0.03 < np.ptp(truth.signals, axis=0).max() < 0.3


def test_cords_respond_as_designed_without_any_trait(device):
    names = TwinTraits.for_device(device).names
    runs = simulate_runs(device, options(off=tuple(n for n in names if n != "mechanics")))
    run, truth = runs.dataset.recordings[0], runs.runs[0].truth
    assert run.signals == pytest.approx(truth.signals, abs=1e-5)
    assert run.sample_time == pytest.approx(truth.sample_time, abs=1e-6)
    assert np.array_equal(run.points, truth.points)
    reading, weights = CordReading.from_device(device), runs.fields.space(truth.weights)
    for c, record in enumerate(load_layout(device.source / "build").by_channel()):
        moved = np.tensordot(weights, runs.fields.displacements(record.stretch), 1)
        ideal = reading.signals(record.built, record.stretch + moved)
        assert truth.signals[:, c] == pytest.approx(ideal, abs=1e-9)
        assert run.rest[c] == pytest.approx(reading.resistance(record.built), rel=1e-5)


def test_cords_deviate_from_the_design_with_all_traits(runs):
    run, truth = runs.dataset.recordings[0], runs.runs[0].truth
    assert 0.005 < np.std(run.signals - truth.signals, axis=0).max() < 0.1


def test_same_seed_and_unit_give_the_same_session(device, runs):
    repeated = simulate_runs(device, options()).dataset.recordings[0]
    first = runs.dataset.recordings[0]
    assert np.array_equal(repeated.ohm, first.ohm)
    assert np.array_equal(repeated.points, first.points, equal_nan=True)
    other = simulate_runs(device, options(unit=2))
    assert (other.runs[0].truth.signals != runs.runs[0].truth.signals).any()
    assert other.dataset.recordings[0].unit != first.unit
    assert np.array_equal(other.runs[0].truth.weights, runs.runs[0].truth.weights)
    moved = simulate_runs(device, options(seed=2)).runs[0]
    assert (moved.truth.weights != runs.runs[0].truth.weights).any()
    assert moved.truth.signals[0] == pytest.approx(runs.runs[0].truth.signals[0], abs=1e-9)
    built = [r.truth.ohm[0] for r in (moved, runs.runs[0], other.runs[0])]
    assert built[0] == pytest.approx(built[1], rel=0.02)  # the same pieces with other noise
    assert (np.abs(built[2] / built[1] - 1) > 0.03).any()


def test_cords_of_another_family_move_in_the_same_way(device, runs):
    fitted = simulate_runs(device, options(cords="hysteretic"))
    run, default = fitted.runs[0], runs.runs[0]
    assert fitted.dataset.provenance["cords"] == "hysteretic"
    assert runs.dataset.provenance["cords"] == "viscoelastic"
    assert np.array_equal(run.truth.signals, default.truth.signals)
    assert np.array_equal(run.recording.points, default.recording.points, equal_nan=True)
    assert np.isfinite(run.truth.ohm).all()
    assert np.std(run.truth.ohm / default.truth.ohm) > 1e-3
    repeated = simulate_runs(device, options(cords="hysteretic", sessions=2))
    assert np.array_equal(repeated.runs[0].truth.ohm, run.truth.ohm)
    names = TwinTraits.for_device(device, options(cords="hysteretic")).names
    assert set(names) == set(TwinTraits.for_device(device).names)
    off = tuple(n for n in names if n != "mechanics")
    ideal = simulate_runs(device, options(cords="hysteretic", off=off))
    assert ideal.dataset.recordings[0].signals == pytest.approx(
        ideal.runs[0].truth.signals, abs=1e-5
    )
    with raises(CaptureError, "unknown-choice"):
        options(cords="string")


def test_disabled_traits_leave_the_others_unchanged(device, runs):
    reduced = simulate_runs(device, options(off=("drift", "noise"))).runs[0]
    assert np.array_equal(reduced.truth.weights, runs.runs[0].truth.weights)
    assert np.array_equal(reduced.truth.signals, runs.runs[0].truth.signals)
    assert np.array_equal(
        reduced.recording.points, runs.dataset.recordings[0].points, equal_nan=True
    )
    assert (reduced.truth.ohm != runs.runs[0].truth.ohm).any()


def test_later_sessions_of_a_unit_are_older(device):
    traits = TwinTraits.for_device(device)
    traits = replace(traits, between=240.0, hand=replace(traits.hand, rest=6.0))
    off = tuple(n for n in traits.names if n not in ("ageing", "mechanics"))
    two = simulate_runs(device, options(sessions=2, off=off), traits=traits).dataset
    first, second = (r.rest for r in two.recordings)
    assert second / first == pytest.approx(np.full(2, (1 + 0.004 * 13) / (1 + 0.004 * 3)), rel=1e-4)
    assert [r.session for r in two.recordings] == ["session-1", "session-2"]


def test_traits_have_names_and_assumptions_have_sources(device):
    traits = TwinTraits.for_device(device)
    assert {
        "hysteresis",
        "relaxation",
        "mullins",
        "drift",
        "temperature",
        "ageing",
        "spread",
        "contact",
        "noise",
        "quantisation",
        "placement",
        "prestretch",
        "marker-noise",
        "gaps",
        "wrong-markers",
        "sync",
        "mechanics",
        "tremor",
    } <= set(traits.names)
    assert all(a.source and a.meaning for a in traits.assumptions)
    with raises(CaptureError, "unknown-trait", trait="hysterisis"):
        traits.disable_traits(["hysterisis"])


@pytest.fixture(scope="module")
def written(small_bar, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "session"
    arguments = ["--minutes", str(SECONDS / 60), "--out", str(out), "--json"]
    assert main(["twin", str(small_bar), *arguments]) == 0
    return out


def read_table(path):
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    cells = [[float(x) if x else np.nan for x in row.split(",")[1:]] for row in rows]
    return head.split(","), np.array(cells)


def test_files_are_those_of_a_processed_session(written, runs):
    run = runs.dataset.recordings[0]
    tracks = read_tracks(written / "aligned.csv")
    assert np.array_equal(tracks.ids, runs.dataset.ids)
    assert tracks.time == pytest.approx(run.time, abs=1e-8)
    assert tracks.points == pytest.approx(run.points, abs=1e-6, nan_ok=True)
    assert tracks.sigma == pytest.approx(run.sigma, abs=1e-6, nan_ok=True)
    head, samples = read_table(written / "samples.csv")
    assert head == [
        "run",
        "counter",
        "device_us",
        "time",
        "cord_1",
        "cord_2",
        "cord_1_ohm",
        "cord_2_ohm",
    ]
    assert samples[:, 2] == pytest.approx(run.sample_time, abs=1e-6)
    assert samples[:, 3:5] == pytest.approx(run.signals, abs=1e-6)
    assert samples[:, 5:] == pytest.approx(run.ohm, abs=1e-4)
    head, signals = read_table(written / "signals.csv")
    assert head == ["frame", "time", "cord_1", "cord_2", "alignment_residual"]
    assert len(signals) == len(run.time)
    markers = read_markers(written)
    assert markers.centers == pytest.approx(runs.dataset.rest_points)
    assert markers.anchor.any() == (markers.centers[:, 0] < 10).any()


def test_quality_contains_the_provenance_of_the_twin(written, runs):
    quality = json.loads((written / "quality.json").read_text(encoding="utf-8"))
    run = runs.dataset.recordings[0]
    assert quality["R0"]["run-1"] == pytest.approx(run.rest.tolist())
    assert quality["runs"][0]["sync"]["error_ms"] == 3.0
    assert (quality["layout"], quality["unit"]) == (runs.dataset.layout, run.unit)
    assert quality["twin"]["twin"] is True
    assert quality["twin"]["seed"] == 1
    session = load(written)
    assert [s.name for s in session.steps] == [name for _, name in run.poses]
    assert finished_steps(session) == list(range(len(session.steps)))
    with np.load(written / "truth.npz") as truth:
        assert truth["points"] == pytest.approx(runs.runs[0].truth.points, abs=1e-4)
        assert truth["signals"] == pytest.approx(runs.runs[0].truth.signals)
    page = (written / "assumptions.md").read_text(encoding="utf-8")
    assert all(a.meaning in page for a in runs.traits.assumptions)
    assert "| mullins | recovery | 6.0 | h |" in page


def test_session_without_frames_is_not_processed(written):
    with pytest.raises(CaptureError):
        process_session(written)


def test_several_sessions_have_their_own_folders(small_bar, tmp_path, capsys):
    out = tmp_path / "two"
    arguments = ["--minutes", "0.2", "--sessions", "2", "--off", "gaps, drift", "--json"]
    assert main(["twin", str(small_bar), "--out", str(out), *arguments]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["sessions"] == [str(out / "session-1"), str(out / "session-2")]
    assert data["off"] == ["drift", "gaps"]
    assert data["interpolation_mm"] < 0.1
    assert not list(out.glob(".*"))
    with raises(CaptureError, "folder-not-empty"):
        check_free(out, 2)
    assert main(["twin", str(small_bar), "--out", str(out), *arguments]) == 2
    assert str(out) in capsys.readouterr().err


def test_assumptions_are_listed_without_a_build(small_bar, tmp_path, capsys):
    (tmp_path / "device.toml").write_bytes((small_bar / "device.toml").read_bytes())
    (tmp_path / "bar.py").write_bytes((small_bar / "bar.py").read_bytes())
    words = ["twin", str(tmp_path), "--list-assumptions", "--json"]
    assert main([*words, "--off", "mullins"]) == 0
    assumptions = json.loads(capsys.readouterr().out)
    assert {a["name"]: a["value"] for a in assumptions}["mullins"] == 0.0
    assert main(["twin", str(tmp_path), "--list-assumptions"]) == 0
    assert "mechanics, placement" in capsys.readouterr().out
    assert main(words[:2]) == 2
    assert str(tmp_path) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--minutes", "0.01"], "out-of-range"),
        (["--off", "gravity"], "unknown-trait"),
        (["--sessions", "0"], "out-of-range"),
        (["--wrong", "0.9"], "out-of-range"),
        (["--markers", "none.json"], "file-not-found"),
        (["--cameras", "webcam,seed=2"], "options-conflict"),
        (["--cameras", "film"], "twin-cameras-invalid"),
    ],
)
def test_invalid_options_are_refused(small_bar, words, code):
    with raises(DefsenseError, code):
        run_command(["twin", str(small_bar), *words])


def test_full_disk_leaves_no_partial_session(small_bar, tmp_path, monkeypatch, capsys):
    from defsense_fab.workflow.sessions import twin_sessions

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(twin_sessions, "write_text", full)
    assert main(["twin", str(small_bar), "--minutes", "0.2", "--out", str(tmp_path / "x")]) == 2
    assert str(tmp_path / "x") in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_models_are_trained_on_simulated_sessions_and_recalibrated(small_bar, tmp_path, capsys):
    """Run the commands in the order of a user: `twin`, `train`, `evaluate`, `recalibrate`."""
    sessions, model = tmp_path / "sessions", tmp_path / "model.json"
    words = ["twin", small_bar, "--minutes", 1.5, "--sessions", 2, "--out", sessions]
    assert main([str(w) for w in words]) == 0
    first, second = sessions / "session-1", sessions / "session-2"
    words = ["train", first, "--device", small_bar, "--prior", "no", "--out", model, "--json"]
    capsys.readouterr()
    assert main([str(w) for w in words]) == 0
    data = json.loads(capsys.readouterr().out)
    trained = load_model(model)
    assert set(trained.poses) == {"bend_up", "twist"}
    assert trained.layout == layout_hash(load_layout(small_bar / "build"))
    assert [len(hash_) for hash_ in data["data"].values()] == [64]
    assert (
        main(["evaluate", str(model), str(second), "--out", str(tmp_path / "page"), "--json"]) == 0
    )
    assert json.loads(capsys.readouterr().out)
    assert main(["recalibrate", str(model), str(second), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert set(data["gain"]) == set(trained.channels)
    if data["enough"]:
        again = load_model(tmp_path / "recalibrated.json")
        assert again.metadata["recalibrated"][0]["by"] == [str(second)]
    else:
        assert data["model"] is None
        assert not (tmp_path / "recalibrated.json").exists()
