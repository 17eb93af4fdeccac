"""`model.json`: round trip, damage, and an independent reader."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.core.arrays import Float
from defsense_fab.core.errors import TrainingError
from defsense_fab.decoding.input_decoder import InputDecoder, InputFeatures, all_products
from defsense_fab.decoding.signal_history import Past
from defsense_fab.decoding.trained_model import Branch, Intervals, TrainedModel, TrainedRange
from defsense_fab.training.fitting.model_file import load_model, write_model
from tests.support.errors import raises


def made(past: Past | None = None, centers: int = 3) -> TrainedModel:
    rng = np.random.default_rng(0)
    past = past or Past()
    d = 2 * (1 + past.count)
    features = InputFeatures(
        d, all_products(2), rng.normal(size=(centers, 2)), np.array([0.3, 2.0])
    )
    decoder = InputDecoder(features, rng.normal(size=(features.count, 12)), rng.normal(size=12))
    limits = TrainedRange(np.zeros(d), np.eye(d), 1.0, -np.ones(2), np.ones(2))
    intervals = Intervals(0.9, np.full(4, 0.2), 1.0)
    main = Branch((0, 1), past, decoder, limits, intervals)
    return TrainedModel(
        "toy",
        "hash",
        "kernel",
        ("top", "left"),
        np.arange(4),
        rng.normal(size=(4, 3)),
        np.array([1.1, 1.0]),
        np.array([0.0, 0.01]),
        main,
        metadata={"folds": [0.1, 0.2]},
    )


def signals(count: int = 50) -> tuple[Float, Float]:
    rng = np.random.default_rng(1)
    return np.arange(count) / 60, 0.05 * rng.normal(size=(count, 2)).cumsum(0)


@pytest.mark.parametrize("centers", [0, 3])
def test_a_model_round_trip(tmp_path: Path, centers: int) -> None:
    model = made(Past((0.5, 3.0), (9.0,)), centers)
    write_model(tmp_path / "model.json", model)
    again = load_model(tmp_path)
    time, s = signals()
    np.testing.assert_array_equal(
        again.decode(time, s, time).points, model.decode(time, s, time).points
    )
    assert again.metadata == {"folds": [0.1, 0.2]}
    assert again.channels == ("top", "left")


def test_an_edited_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    write_model(path, made())
    path.write_text(path.read_text(encoding="utf-8").replace('"device":"toy"', '"device":"boy"'))
    with raises(TrainingError, "content-changed"):
        load_model(path)


@pytest.mark.parametrize("number", ["NaN", "1e999"])
def test_a_model_with_non_finite_numbers_is_refused(tmp_path: Path, number: str) -> None:
    path = tmp_path / "model.json"
    write_model(path, made())
    path.write_text(path.read_text(encoding="utf-8").replace('"level":0.9', f'"level":{number}'))
    with raises(TrainingError, "content-changed"):
        load_model(path)


def test_a_truncated_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    write_model(path, made())
    path.write_text(path.read_text(encoding="utf-8")[:-500])
    with raises(TrainingError, "not-json"):
        load_model(path)


@pytest.mark.parametrize(
    ("text", "code"),
    [("[]", "not-a-model"), ('{"schema": 99, "sha256": ""}', "wrong-schema")],
)
def test_other_json_is_refused(tmp_path: Path, text: str, code: str) -> None:
    (tmp_path / "model.json").write_text(text)
    with raises(TrainingError, code):
        load_model(tmp_path / "model.json")


def test_ten_lines_of_numpy_read_a_model(tmp_path: Path) -> None:
    """The example in docs/model.md decodes like the project."""
    text = (Path(__file__).parents[3] / "docs/model.md").read_text(encoding="utf-8")
    code = text.split("```python\n")[1].split("```")[0]
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    model = made()
    write_model(tmp_path / "model.json", model)
    time, s = signals()
    names: dict[str, object] = {}
    exec(code.replace("model.json", str(tmp_path / "model.json")), names)
    decode = names["decode"]
    for k in range(len(time)):
        expected = model.decode(time, s, time).points[k]
        np.testing.assert_allclose(decode(s[k]), expected, atol=1e-9)  # type: ignore[operator]


def test_the_file_is_plain_json_with_units(tmp_path: Path) -> None:
    write_model(tmp_path / "model.json", made())
    data = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    assert data["main"]["decoder"]["features"]["products"] == [[0, 0], [0, 1], [1, 1]]
