"""What the memory of cords leaves after training, by the table of residuals."""

import csv
from importlib.resources import files

import numpy as np
import pytest

from benchmarks import memory_residuals as benchmark
from defsense_fab.core.device.filaments import read_filaments
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.sensing.memory_residual import (
    AFFINE,
    TRAINED,
    MemoryResidual,
    known_family,
    memory_residuals,
)


@pytest.mark.parametrize("count", [1, 2, 8])
@pytest.mark.parametrize("cord", [*read_rows("cords.csv"), "custom"])
def test_each_cord_has_residuals_of_both_families(cord, count):
    for decoder in (TRAINED, AFFINE):
        families = [r.family for r in memory_residuals(cord, decoder, count)]
        assert families == ["viscoelastic", "hysteretic"]


@pytest.mark.parametrize("filament", sorted(read_filaments()))
def test_printed_traces_also_have_residuals_of_their_network(filament):
    families = [r.family for r in memory_residuals(filament, TRAINED, 3)]
    assert families == ["viscoelastic", "hysteretic", "network"]
    assert known_family(filament) == "network"


def test_cords_of_the_table_are_bound_to_families_with_a_source():
    rows = read_rows("cord_families.csv")
    assert set(read_rows("cords.csv")) <= set(rows)
    for row in rows.values():
        assert row["family"] in ("", "viscoelastic", "hysteretic", "network")
        assert bool(row["family"]) == (row["basis"] != "unknown")
        assert row["source"]


@pytest.mark.parametrize("count", [1, 2])
def test_training_removes_part_of_the_memory(count):
    rows = (memory_residuals("any", decoder, count) for decoder in (TRAINED, AFFINE))
    for trained, affine in zip(*rows, strict=True):
        assert 0 <= trained.low < trained.median < trained.high
        assert trained.median < affine.median


def test_every_row_states_basis_and_source():
    text = (files("defsense_fab") / "data" / "memory_residuals.csv").read_text(encoding="utf-8")
    for row in csv.DictReader(text.splitlines()):
        assert row["basis"] in ("simulated", "measured")
        assert row["relative_to"] in ("largest signal", "R0")
        assert row["source"]
        assert float(row["low"]) <= float(row["median"]) <= float(row["high"])


@pytest.mark.parametrize("largest", [0.1, 0.5])
@pytest.mark.parametrize("is_absolute", [False, True])
def test_drawn_errors_have_the_quantiles_of_the_row(is_absolute, largest):
    residual = MemoryResidual("row", 0.02, 0.05, 0.12, is_absolute)
    errors = residual.draw(np.full(20000, largest), np.random.default_rng(0))
    expected = np.array([residual.low, residual.median, residual.high])
    expected *= 1 if is_absolute else largest
    assert np.quantile(errors, [0.05, 0.5, 0.95]) == pytest.approx(expected, rel=0.05)
    assert errors.min() >= 0


def test_residuals_of_traces_alone_do_not_grow_with_the_signal():
    residuals = memory_residuals("eel", TRAINED, 3)
    assert [r.family for r in residuals if r.is_absolute] == ["network"]


@pytest.mark.slow
@pytest.mark.parametrize("largest", [0.06, 0.4])
def test_residuals_of_traces_contain_those_of_other_prints(largest, monkeypatch):
    """Signals of 6 and 40 % leave errors in the range of the table, but not the same share."""
    monkeypatch.setattr(benchmark, "LARGEST_RANGE_OF_TRACES", (largest, largest))
    monkeypatch.setattr(benchmark, "KINDS", {TRAINED: benchmark.KINDS[TRAINED]})
    seeds = [seed for seed in range(1001, 1008) if seed % benchmark.MAX_CORDS]
    noise = np.concatenate([benchmark.residuals("network", s, 10.0)[1][TRAINED] for s in seeds])
    (row,) = (r for r in memory_residuals("eel", TRAINED, 3) if r.family == known_family("eel"))
    assert 0.75 < np.median(noise) / row.median < 1.33
    assert np.mean((noise >= row.low) & (noise <= row.high)) > 0.7
