"""Datasets of tables of signals and targets of any sensor."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.data.dataset_assembly import join_datasets
from defsense_fab.training.data.dataset_checks import check_dataset
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.recordings.dataset_parquet import read_dataset, write_dataset
from defsense_fab.training.recordings.lerobot_export import write_lerobot
from defsense_fab.training.recordings.table_dataset import name_runs, table_dataset
from tests.support.errors import raises
from tests.training.recordings.tables import movements, ohms, write, write_pair


def codes(dataset):
    return {p.code for p in check_dataset(dataset)}


def test_scalars_keep_their_names_units_and_values(tmp_path):
    signals, targets = write_pair(tmp_path)
    data = table_dataset([signals], [targets])
    (r,) = data.recordings
    assert data.channels == ("a", "b")
    assert data.targets.names == ("angle", "force")
    assert data.targets.units == data.units == ("deg", "N")
    assert data.readings.units == ("ohm", "ohm")
    assert r.name == "run"
    assert r.points.shape == (1200, 2, 1)
    np.testing.assert_allclose(r.points[:, 0, 0], movements(r.time, 0)[0], atol=1e-4)
    half = np.median(ohms(r.sample_time, 0)[:750], axis=0)
    np.testing.assert_allclose(data.readings.reference, half, rtol=1e-6)
    np.testing.assert_allclose(r.signals, ohms(r.sample_time, 0) / half - 1, atol=1e-6)
    assert not [p for p in check_dataset(data) if p.is_fatal]


def test_triples_become_points_in_any_order_of_columns(tmp_path):
    time = np.arange(0, 10, 0.05)
    columns = [np.full(len(time), k) + np.sin(time) for k in range(6)]
    header = "time,q_z_cm,p_y_cm,p_x_cm,p_z_cm,q_x_cm,q_y_cm"
    targets = write(tmp_path / "t.csv", header, time, *columns)
    signals = write(tmp_path / "s.csv", "time,a", time, 500 + np.cos(time))
    data = table_dataset([signals], [targets])
    assert data.targets.names == ("q", "p")
    assert data.targets.axes == 3
    assert data.units == ("mm", "mm")
    first = data.recordings[0].points[0]
    np.testing.assert_allclose(first, [[40, 50, 0], [20, 10, 30]], atol=1e-4)


def test_angles_about_axes_are_scalars(tmp_path):
    time = np.arange(0, 10, 0.05)
    signals, _ = write_pair(tmp_path, seconds=10)
    header = "time," + ",".join(f"roll_{axis}_deg" for axis in "xyz")
    targets = write(tmp_path / "angles.csv", header, time, *(np.sin(time + k) for k in range(3)))
    kinds = table_dataset([signals], [targets]).targets
    assert (kinds.names, kinds.axes) == (("roll_x", "roll_y", "roll_z"), 1)


def test_further_clocks_and_row_numbers_are_neither_channels_nor_targets(tmp_path):
    time = np.arange(0, 10, 0.05)
    a, b = ohms(time, 0).T
    rows = np.arange(len(time), dtype=float)
    signals = write(
        tmp_path / "s.csv", "index,time,timestamp_ms,a_ohm,b_ohm", rows, time, 1e3 * time, a, b
    )
    targets = write(tmp_path / "t.csv", "time,t,angle_deg", time, time, np.sin(time))
    data = table_dataset([signals], [targets])
    assert data.channels == ("a", "b")
    assert data.targets.names == ("angle",)
    assert len(data.provenance["sessions"][0]["notes"]) == 2


def test_one_column_that_is_no_axis_makes_all_columns_scalars(tmp_path):
    time = np.arange(0, 10, 0.05)
    targets = write(tmp_path / "t.csv", "time,p_x_mm,p_y_mm,p_z_mm,angle_deg", time, *([time] * 4))
    signals = write(tmp_path / "s.csv", "time,a", time, 500 + np.cos(time))
    data = table_dataset([signals], [targets])
    assert data.targets.axes == 1
    assert data.targets.names == ("p_x", "p_y", "p_z", "angle")
    assert data.units == ("mm", "mm", "mm", "deg")


@pytest.mark.parametrize(
    ("values", "unit"),
    [(lambda t: 500 + 20 * np.sin(t), "counts"), (lambda t: 0.1 * np.sin(t), "(R - R0)/R0")],
)
def test_numbers_without_a_unit_are_noted_as_counts_or_relative_changes(tmp_path, values, unit):
    time = np.arange(0, 20, 0.05)
    signals = write(tmp_path / "s.csv", "time,a,b", time, values(time), values(1.3 * time))
    targets = write(tmp_path / "t.csv", "time,angle", time, np.sin(time))
    data = table_dataset([signals], [targets])
    assert data.readings.units == (unit, unit)
    assert data.units == ("",)
    (note,) = data.provenance["sessions"][0]["notes"]
    assert unit in note
    if unit != "counts":
        np.testing.assert_allclose(data.recordings[0].signals, data.recordings[0].ohm)


def test_signals_that_cross_zero_are_relative_to_their_range(tmp_path):
    time = np.arange(0, 20, 0.05)
    volts = 0.2 + 2 * np.sin(time)
    signals = write(tmp_path / "s.csv", "time,a_mV", time, 1e3 * volts)
    targets = write(tmp_path / "t.csv", "time,angle_deg", time, np.sin(time))
    data = table_dataset([signals], [targets])
    assert data.readings.units == ("V",)
    np.testing.assert_allclose(data.recordings[0].ohm[:, 0], volts, atol=1e-5)
    signal = data.recordings[0].signals
    assert np.isfinite(signal).all()
    assert 0.8 < np.ptp(signal) < 1.3


def test_runs_in_other_units_by_their_headers_are_converted(tmp_path):
    first = write_pair(tmp_path, "one")
    other = write_pair(
        tmp_path,
        "two",
        seed=1,
        signals="time,a_kohm,b_kohm",
        targets="time,angle_rad,force_N",
        units=(1e3, 180 / np.pi),
    )
    data = table_dataset(*zip(first, other, strict=True))
    one, two = data.recordings
    np.testing.assert_allclose(two.ohm, ohms(two.sample_time, 1), rtol=1e-5)
    np.testing.assert_allclose(two.points[:, 0, 0], movements(two.time, 1)[0], atol=1e-3)
    np.testing.assert_array_equal(one.rest, two.rest)
    assert "wrong-unit" not in codes(data)


@pytest.mark.parametrize("units", [(1e3, 1.0), (1.0, 180 / np.pi)])
def test_runs_in_other_units_by_their_values_are_warned_of(tmp_path, units):
    pairs = [write_pair(tmp_path, "one"), write_pair(tmp_path, "two", seed=1, units=units)]
    data = table_dataset(*zip(*pairs, strict=True))
    (problem,) = [p for p in check_dataset(data) if p.code == "wrong-unit"]
    assert not problem.is_fatal
    assert problem.recordings == ("two",)
    assert problem.data["quantity"] == ("readings" if units[0] > 1 else "targets")


def test_runs_with_other_columns_are_refused(tmp_path):
    pairs = [write_pair(tmp_path, "one"), write_pair(tmp_path, "two", signals="time,a_ohm,c_ohm")]
    with raises(TrainingError, "columns-differ", missing=("b",), extra=("c",)):
        table_dataset(*zip(*pairs, strict=True))
    pairs[1] = write_pair(tmp_path, "two", targets="time,angle_deg,force_kN")
    with raises(TrainingError, "units-differ", column="force"):
        table_dataset(*zip(*pairs, strict=True))


def test_joined_datasets_use_the_reference_of_the_first(tmp_path):
    parts = []
    for k in range(2):
        a, b = write_pair(tmp_path, f"run{k}", seed=k)
        parts.append(table_dataset([a], [b]))
    data = join_datasets(parts)
    assert [r.name for r in data.recordings] == ["run0", "run1"]
    for r in data.recordings:
        np.testing.assert_array_equal(r.rest, parts[0].readings.reference)
    a, b = write_pair(tmp_path, "x", targets="time,angle_deg,load_N")
    other = table_dataset([a], [b])
    with raises(TrainingError, "targets-differ", found=("angle", "load")):
        join_datasets([parts[0], other])


@pytest.mark.parametrize("targets", ["time,angle_deg,force_N", "time,p_x_mm,p_y_mm,p_z_mm"])
def test_datasets_in_parquet_keep_targets_and_readings(tmp_path, targets):
    time = np.arange(0, 20, 0.05)
    header = targets.count(",")
    truth = write(tmp_path / "t.csv", targets, time, *[np.sin(k + time) for k in range(header)])
    signals = write(tmp_path / "s.csv", "time,a_pF,b_pF", time, 9 + np.sin(time), 8 + np.cos(time))
    data = table_dataset([signals], [truth])
    write_dataset(tmp_path / "d", data)
    read = read_dataset(tmp_path / "d")
    assert read.targets == data.targets
    assert read.readings.units == ("pF", "pF")
    np.testing.assert_array_equal(read.recordings[0].signals, data.recordings[0].signals)
    np.testing.assert_array_equal(read.recordings[0].points, data.recordings[0].points)
    with raises(TrainingError, "targets-differ"):
        write_lerobot(tmp_path / "lerobot", data)


def test_names_of_runs_are_distinct(tmp_path):
    assert name_runs([tmp_path / "a.csv", tmp_path / "b.csv"]) == ("a", "b")
    paths = [tmp_path / "p" / "s.csv", tmp_path / "q" / "s.csv"]
    assert name_runs(paths) == ("p/s", "q/s")
    assert name_runs([paths[0], paths[0]]) == ("p/s-1", "p/s-2")


def test_bad_tables_are_refused_with_their_reason(tmp_path):
    good, truth = write_pair(tmp_path)
    time = np.arange(0, 5, 0.1)
    untimed = write(tmp_path / "untimed.csv", "a,b", time, time)
    with raises(TrainingError, "column-missing", column="time"):
        table_dataset([untimed], [truth])
    empty = write(tmp_path / "empty.csv", "time,a", time, np.full(len(time), np.nan))
    with raises(TrainingError, "no-samples"):
        table_dataset([empty], [truth])
    twice = write(tmp_path / "twice.csv", "time,a_deg,a_rad", time, time, time)
    with raises(TrainingError, "column-repeated", column="a"):
        table_dataset([good], [twice])
    later = write(tmp_path / "later.csv", "time,angle_deg", 1000 + time, time)
    with raises(TrainingError, "no-common-time"):
        table_dataset([good], [later])
    back = write(tmp_path / "back.csv", "time,a", np.tile(time, 2), np.tile(time, 2))
    with raises(TrainingError, "times-not-increasing"):
        table_dataset([back], [truth])


def test_doubtful_data_are_warned_of_and_not_refused(tmp_path):
    time = np.arange(0, 30, 0.05)
    rng = np.random.default_rng(1)
    angle, force = movements(time, 1)
    good = 500 + 3 * angle
    clipped = np.minimum(good, np.quantile(good, 0.8))
    stuck = np.where((time > 10) & (time < 20), 480, good)
    gaps = np.where(rng.random(len(time)) < 0.9, np.nan, good)
    columns = (good, clipped, stuck, gaps)
    signals = write(tmp_path / "s.csv", "time,good,clipped,stuck,gaps", time, *columns)
    targets = write(tmp_path / "t.csv", "time,angle_deg", time, angle + 0 * force)
    data = table_dataset([signals], [targets])
    problems = {p.code: p for p in check_dataset(data)}
    for code, channel in (
        ("saturated-channel", "clipped"),
        ("stuck-channel", "stuck"),
        ("missing-channel", "gaps"),
    ):
        assert not problems[code].is_fatal
        assert problems[code].data["channels"] == (channel,)
        assert f"--without-channels {channel}" in problems[code].action
    assert "no-rest-pose" not in problems


def test_channels_that_only_increase_and_constant_targets_are_warned_of(tmp_path):
    time = np.arange(0, 70, 0.05)
    a, b = ohms(time, 0).T
    signals = write(tmp_path / "s.csv", "time,a_ohm,b_ohm,beats", time, a, b, 100 + time)
    targets = write(
        tmp_path / "t.csv", "time,angle_deg,force_N", time, movements(time, 0)[0], 0 * time + 3
    )
    found = {p.code: p for p in check_dataset(table_dataset([signals], [targets]))}
    assert found["increasing-channel"].data == {"channels": ("beats",)}
    assert found["constant-target"].data == {"targets": ("force",)}
    assert not any(p.is_fatal for p in found.values())


def test_targets_unknown_in_the_training_are_refused_by_name(tmp_path):
    signals, _ = write_pair(tmp_path, seconds=40)
    time = np.arange(0, 40, 0.05)
    angle, force = movements(time, 0)
    force[time < 30] = np.nan
    targets = write(tmp_path / "t.csv", "time,angle_deg,force_N", time, angle, force)
    with raises(TrainingError, "target-rarely-known", targets=("force",)):
        train(table_dataset([signals], [targets]))


def test_rates_that_are_far_apart_are_warned_of_and_interpolated(tmp_path):
    slow, fast = np.arange(0.0, 90, 1), np.arange(0, 89, 0.01)
    s = write(tmp_path / "s.csv", "time,a", slow, 500 + 50 * np.sin(0.2 * slow))
    t = write(tmp_path / "t.csv", "time,angle_deg", fast, 10 * np.sin(0.2 * fast))
    data = table_dataset([s], [t])
    assert "rates-differ" in codes(data)
    (r,) = data.recordings
    assert np.isfinite(r.signals_at(r.time)).all()
