"""What the memory of cords leaves after training, by the table of residuals."""

import csv
from importlib.resources import files

import numpy as np
import pytest

from defsense_fab.core.device.filaments import read_filaments
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.sensing.memory_residual import (
    AFFINE,
    TRAINED,
    MemoryResidual,
    expected_residuals,
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


@pytest.mark.parametrize("cord", [*read_rows("cord_families.csv"), "custom"])
def test_a_cord_of_known_memory_has_residuals_of_it_alone(cord):
    families = [r.family for r in expected_residuals(cord, TRAINED, 2)]
    known = known_family(cord)
    assert families == ([known] if known else ["viscoelastic", "hysteretic"])


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
        assert row["source"]
        assert float(row["low"]) <= float(row["median"]) <= float(row["high"])


def test_drawn_shares_have_the_quantiles_of_the_row():
    residual = MemoryResidual("row", 0.02, 0.05, 0.12)
    shares = residual.draw(20000, np.random.default_rng(0))
    expected = [residual.low, residual.median, residual.high]
    assert np.quantile(shares, [0.05, 0.5, 0.95]) == pytest.approx(expected, rel=0.05)
    assert shares.min() >= 0
