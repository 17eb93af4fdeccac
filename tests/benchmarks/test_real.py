"""The benchmark on real recordings, with generated ones."""

import json

import numpy as np
import pytest

from benchmarks.peers import regression
from benchmarks.peers.recurrent import Networks
from benchmarks.real.__main__ import main
from benchmarks.real.ours import decode_folds
from benchmarks.real.recordings import Task, find_sources, thirds_of_runs
from benchmarks.real.report import FAMILIES
from benchmarks.real.shifts import SHIFTS_S, judge, measure_shifts
from defsense_fab.training.fitting.train_model import train

pytestmark = pytest.mark.slow


def write_table(path, header, columns):
    np.savetxt(path, np.stack(columns, 1), delimiter=",", header=header, comments="", fmt="%.6g")


def write_run(folder, prefix, seed, seconds=30.0, rate=10.0):
    """Write two noisy signals of an angle, one of which relaxes."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, 1 / rate)
    knots = np.arange(0, seconds + 2, 1.5)
    angle = 20 + 20 * np.interp(time, knots, rng.uniform(-1, 1, len(knots)))
    slow = np.empty_like(angle)
    slow[0] = angle[0]
    for k in range(1, len(time)):
        slow[k] = slow[k - 1] + (angle[k] - slow[k - 1]) / rate
    signals = [100 + angle + 0.01 * angle**2, 80 + angle - 0.3 * slow]
    signals = [s + 0.2 * rng.normal(size=s.shape) for s in signals]
    folder.mkdir(exist_ok=True)
    write_table(folder / f"{prefix}signals.csv", "time,a_ohm,b_ohm", [time, *signals])
    write_table(folder / f"{prefix}targets.csv", "time,angle_deg", [time, angle])


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    write_run(folder / "one", "", 0)
    (folder / "one" / "README.md").write_text("doi 10.1002/aisy.202400124")
    for k in range(3):
        write_run(folder / "several", f"run{k}-", k, seconds=20)
    (folder / "no-recording").mkdir()
    return folder


@pytest.fixture
def quick(monkeypatch):
    """Use few, small models."""
    monkeypatch.setattr(regression, "TREES", 5)
    monkeypatch.setattr(regression, "BOOSTING_ROUNDS", 5)
    monkeypatch.setattr(regression, "STATES", (4,))
    monkeypatch.setattr(regression, "KERNEL_SCALES", (0.1,))
    monkeypatch.setattr(Networks.train, "__defaults__", (10,))


@pytest.mark.parametrize("arguments", [[], ["--data", "missing"]])
def test_without_recordings_the_benchmark_is_skipped(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 0
    assert "Skipped" in capsys.readouterr().out


def test_a_name_that_no_recording_has_is_skipped(data, capsys):
    assert main(["--data", str(data), "--only", "other"]) == 0
    assert "Skipped" in capsys.readouterr().out


def test_one_recording_gives_tables_pictures_and_numbers(data, tmp_path, quick, capsys):
    file = tmp_path / "results.json"
    arguments = ["--data", str(data), "--only", "one", "--out", str(tmp_path), "--json", str(file)]
    assert main(arguments) == 0
    assert (tmp_path / "one.png").stat().st_size > 0
    results = json.loads(file.read_text())
    (row,) = results["recordings"]
    assert results["runs_left_out"] == []
    assert (row["frames"], row["unit"]) == ([210, 90], "deg")
    assert row["ours"]["test"] < 0.5 * row["mean"]
    assert set(row["chosen"]) == set(FAMILIES)
    errors = [p["cross_validated"] for p in row["peers"]]
    assert row["best"]["cross_validated"] == min(errors)
    assert row["ratio"] == pytest.approx(row["ours"]["test"] / row["best"]["test"])
    assert row["ours"]["coverage"]["share"] > 0.5
    assert set(row["ours"]["without"]) == {"a", "b"}
    assert row["published"]
    assert "one" in capsys.readouterr().out


def test_runs_are_read_in_order_and_left_out_by_thirds(data):
    one, several = find_sources(data)
    assert [p.name for p in several.signals] == [f"run{k}-signals.csv" for k in range(3)]
    dataset = several.read()
    assert thirds_of_runs(one.read()) == []
    names = thirds_of_runs(dataset)
    assert sorted(n for third in names for n in third) == sorted(r.name for r in dataset.recordings)
    task = Task.divide(dataset, names[1])
    assert set(task.test.recording_index) == {1}


def test_plain_intervals_are_of_the_folds_of_the_chosen_decoder(data):
    task = Task.divide(find_sources(data, ["one"])[0].read())
    training = train(task.dataset, task.options)
    error = np.abs(decode_folds(training, task) - task.train.points)[..., 0]
    error[training.wrong_markers] = np.nan
    radius = np.nanquantile(error, task.options.level, axis=0)
    assert radius == pytest.approx(training.model.main.intervals.radius, rel=1e-6)


def test_lags_are_signals_from_before_a_frame(data):
    frames = Task.divide(find_sources(data, ["one"])[0].read()).train
    now = regression.inputs_of(frames, regression.STATIC)
    lagged = regression.inputs_of(frames, regression.LAGS)
    assert lagged.shape == (len(frames), 2 * (1 + len(regression.LAGS_S)))
    np.testing.assert_allclose(lagged[:, :2], now)
    np.testing.assert_allclose(lagged[1:, 2:4], now[:-1], atol=1e-9)  # 0.1 s at 10 Hz


def test_gradients_of_networks_match_finite_differences():
    rng = np.random.default_rng(0)
    networks = Networks(rng, 2, 3, 2, 1)
    networks.parameters = [p.astype(float) for p in networks.parameters]
    x, y, w = rng.normal(size=(6, 4, 2)), rng.normal(size=(6, 4, 1)), rng.uniform(size=(2, 6, 4))

    def loss():
        W, U, b, c, V, v = networks.parameters
        h, total = np.zeros((2, 4, 3)), 0.0
        for t in range(len(x)):
            a, u = x[t] @ W + b[:, None], h @ U + c[:, None]
            r, z = (1 / (1 + np.exp(-(a + u)[..., k : k + 3])) for k in (0, 3))
            h = z * h + (1 - z) * np.tanh(a[..., 6:] + r * u[..., 6:])
            shared = np.broadcast_to(x[t], (2, 4, 2))
            out = np.concatenate([h, shared], axis=2) @ V + v[:, None]
            total += (w[:, t] / w.sum(axis=(1, 2))[:, None] * ((out - y[t]) ** 2)[..., 0]).sum()
        return total

    for p, g in zip(networks.parameters, networks.gradients(x, y, w), strict=True):
        index = tuple(rng.integers(n) for n in p.shape)
        value, step = p[index], 1e-6
        p[index] = value + step
        above = loss()
        p[index] = value - step
        below = loss()
        p[index] = value
        assert (above - below) / (2 * step) == pytest.approx(g[index], rel=1e-5, abs=1e-8)


def test_a_shift_of_the_clocks_is_judged(tmp_path):
    write_run(tmp_path / "long", "", 0, seconds=90, rate=30)
    warnings, results = measure_shifts(find_sources(tmp_path)[0].read())
    assert warnings == []
    verdicts = {r.put_in_s: r.verdict for r in results}
    assert verdicts.pop(0.0) == "in step"
    assert set(verdicts) == set(SHIFTS_S)
    assert set(verdicts.values()) <= {"found", "unknown"}
    assert not any(r.is_error for r in results)
    assert judge(None, 0.3) == "unknown"
