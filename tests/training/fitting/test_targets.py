"""Training, evaluation and decoding of targets that are no markers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.data.dataset_assembly import select_targets
from defsense_fab.training.evaluation.evaluate_models import evaluate_models
from defsense_fab.training.fitting.model_file import load_model, write_model
from defsense_fab.training.fitting.prepare import prepare
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.recordings.table_dataset import table_dataset
from defsense_fab.workflow.train.training import train_dataset
from tests.support.errors import raises
from tests.training.recordings.tables import movements, write, write_pair

OPTIONS = TrainOptions(memory=False)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    pairs = [write_pair(folder, f"run{k}", seed=k, seconds=40) for k in range(3)]
    return table_dataset(*zip(*pairs, strict=True))


@pytest.fixture(scope="module")
def training(data):
    return train_dataset(data, OPTIONS)


def test_errors_are_reported_for_each_unit(training):
    angle, force = training.test
    assert (angle.unit, force.unit) == ("deg", "N")
    assert 0 < angle.rmse < 0.3
    assert 0 < force.rmse < 0.05
    assert 0.7 < angle.coverage <= 1
    assert training.candidates[0].test.rmse == pytest.approx(angle.rmse, rel=0.2)
    units = training.model.metadata["units"]
    assert units["readings"] == "a ohm, b ohm"
    assert "median of the first half of run0" in units["signals"]
    assert training.model.metadata["test"]["by_unit"]["N"]["rmse"] == force.rmse


def test_the_size_of_a_unit_does_not_change_the_choice(data, training):
    points = [r.points * np.array([1.0, 1e3])[:, None] for r in data.recordings]
    recordings = tuple(replace(r, points=p) for r, p in zip(data.recordings, points, strict=True))
    rest = data.rest_points * np.array([1.0, 1e3])[:, None]
    targets = replace(data.targets, units=("deg", "mN"))
    other = train(replace(data, recordings=recordings, rest_points=rest, targets=targets), OPTIONS)
    assert other.selected == training.selected
    assert other.test[0].rmse == pytest.approx(training.test[0].rmse, rel=1e-6)
    assert other.test[1].rmse == pytest.approx(1e3 * training.test[1].rmse, rel=1e-6)
    radii = [t.model.main.intervals(np.array([0.5]))[0] for t in (training, other)]
    np.testing.assert_allclose(radii[1], radii[0] * [1, 1e3], rtol=1e-6)


def test_one_unit_gives_the_same_decoder_alone_and_with_another(data, training):
    one = train(select_targets(data, np.array([True, False])), replace(OPTIONS, weighted=False))
    assert one.model.rest_points.shape == (1, 1)
    assert one.test[0].rmse == pytest.approx(training.test[0].rmse, rel=0.1)


def test_models_are_read_as_they_were_written(training, tmp_path):
    model = training.model
    write_model(tmp_path / "model.json", model)
    loaded = load_model(tmp_path / "model.json")
    assert loaded.targets == model.targets
    assert loaded.readings.units == model.readings.units
    np.testing.assert_array_equal(loaded.readings.scale, model.readings.scale)
    r = training.training_frames.dataset.recordings[0]
    decoded = loaded.decode(r.sample_time, r.signals, r.time[5:50])
    assert decoded.points.shape == (45, 2, 1)
    stream, errors = loaded.stream(), []
    for t, s in zip(r.sample_time[:200], r.signals[:200], strict=True):
        values = stream(float(t), s)
        errors.append(values[0, 0] - movements(np.array([t]), 0)[0][0])
    assert values.shape == (2, 1)
    assert np.sqrt(np.mean(np.square(errors))) < 0.5


def test_whole_runs_are_left_out_by_name(data):
    result = train(data, replace(OPTIONS, leave_out=("run1",)))
    assert set(result.test_frames.recording_index.tolist()) == {1}
    assert set(result.training_frames.recording_index.tolist()) == {0, 2}
    with raises(TrainingError, "unknown-run", run="run9"):
        train(data, replace(OPTIONS, leave_out=("run9",)))


def test_channels_that_hold_nothing_are_left_out(tmp_path):
    time = np.arange(0, 60, 0.05)
    angle, force = movements(time, 3)
    columns = (500 + 3 * angle, np.full(len(time), 7.0), 500 - angle, np.full(len(time), np.nan))
    signals = write(tmp_path / "s.csv", "time,a,same,b,none", time, *columns)
    targets = write(tmp_path / "t.csv", "time,angle_deg", time, angle + 0 * force)
    data = table_dataset([signals], [targets])
    prepared, _, notes = prepare(data, None, is_synchronized=True)
    assert prepared.channels == ("a", "b")
    assert any("same never changes" in note for note in notes)
    assert any("none has no value" in note for note in notes)
    options = TrainOptions(without_channels=("b",))
    assert prepare(data, None, options, is_synchronized=True)[0].channels == ("a",)
    with raises(TrainingError, "unknown-channel", channel="c"):
        prepare(data, None, TrainOptions(without_channels=("c",)))
    with raises(TrainingError, "constant-channel"):
        prepare(data, None, TrainOptions(without_channels=("a", "b")))


def test_evaluation_recognizes_the_test_frames_and_repeats_the_errors(data, training):
    result = evaluate_models([("m", training.model)], data)
    assert [m.name for m in result.models] == ["m (deg)", "m (N)"]
    assert [m.unit for m in result.models] == ["deg", "N"]
    for m, expected in zip(result.models, training.test, strict=True):
        assert m.errors.rmse == pytest.approx(expected.rmse, rel=1e-9)
        assert m.errors.coverage == pytest.approx(expected.coverage)
    assert result.last_share == pytest.approx(0.3, abs=0.01)


def test_evaluation_on_other_tables_uses_the_reference_of_the_model(training, tmp_path):
    pair = write_pair(tmp_path, "new", seed=8, seconds=30)
    new = table_dataset([pair[0]], [pair[1]])
    result = evaluate_models([("m", training.model)], new)
    assert result.models[0].errors.rmse < 0.5
    kilo = write_pair(tmp_path, "f", seed=8, seconds=30, targets="time,angle_deg,force_kN")
    with raises(TrainingError, "units-differ", target="force"):
        evaluate_models([("m", training.model)], table_dataset([kilo[0]], [kilo[1]]))
