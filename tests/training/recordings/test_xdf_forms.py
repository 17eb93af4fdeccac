"""Sound XDF files in the forms that programs write: the same dataset from each of them.

DEFSENSE_XDF_VARIANTS sets the number of random forms.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

from defsense_fab.training.recordings import xdf_dataset as module
from defsense_fab.training.recordings.pair_dataset import RecordingInfo
from defsense_fab.training.recordings.xdf_streams import load_streams
from tests.training.recordings.files_of_others import markers
from tests.training.recordings.xdf_writer import stream, write_xdf
from tests.training.synthetic import CHANNELS, IDS, recording

FORMS = int(os.environ.get("DEFSENSE_XDF_VARIANTS", "30"))
_LENGTHS = {"mm": 1.0, "millimeters": 1.0, "": 1.0, "cm": 0.1, "m": 1e-3, "metres": 1e-3}
_OHMS = {"ohm": 1.0, "ohms": 1.0, "kohm": 1e-3, "Ω": 1.0}
_MARKERS = ("tag_{}_{}", "{}_{}", "tag_{}.{}", "bar:tag_{}_{}", "marker {} {}")


@pytest.fixture(scope="module")
def r():
    return recording(4, 12.0)


def random_file(path, r, rng):
    """Write the recording in a random form; return which samples and positions are in it."""
    points = r.points.copy()
    is_hidden = rng.random(points.shape[:2]) < 0.05
    is_hidden[:90, :3] = False
    points[is_hidden] = 0.0 if rng.random() < 0.5 else np.nan
    pattern = str(rng.choice(_MARKERS))
    axes = "xyz" if rng.random() < 0.7 else "XYZ"
    labels = [pattern.format(i, a) for i in IDS.tolist() for a in axes]
    unit = str(rng.choice(list(_LENGTHS)))
    columns = points.reshape(len(r.time), -1) * _LENGTHS[unit]
    if rng.random() < 0.3 and "tag" in pattern:  # a marker more, before the others
        labels = [f"wand1_{a}" for a in axes] + labels
        columns = np.column_stack([np.full((len(columns), 3), 5.0), columns])
    cords = np.ones(len(r.sample_time), bool)
    if rng.random() < 0.4:
        start = int(rng.integers(250, 500))
        cords[start : start + 90] = False
    parts = [np.flatnonzero(cords)]
    if not cords.all() and rng.random() < 0.5:  # the sender was restarted, or only paused
        parts = [part[cords[part]] for part in np.split(np.arange(len(cords)), [start])]
    quantity = str(rng.choice(list(_OHMS)))
    board = {"units": quantity, "rate": float(rng.choice([0.0, 60.0]))}
    streams = [
        stream(
            10 + k,
            "Board",
            "Cords",
            list(CHANNELS),
            r.sample_time[p] + 500.0,
            r.ohm[p] * _OHMS[quantity],
            clock=float(rng.choice([0.0, -77.5])),
            **board,
        )
        for k, p in enumerate(parts)
    ]
    clock = float(rng.choice([0.0, 731.0]))
    cameras = stream(3, "Cams", "MoCap", labels, r.time + 500.0, columns, units=unit, clock=clock)
    order = rng.permutation(len(streams) + 1)
    chosen = [[*streams, cameras][k] for k in order]
    if rng.random() < 0.3:
        chosen = [(head, samples, b"") for head, samples, _ in chosen]
    write_xdf(path, *chosen)
    return cords, is_hidden


@pytest.mark.parametrize("seed", range(FORMS))
def test_every_form_has_the_same_numbers(tmp_path, r, seed, monkeypatch):
    monkeypatch.setattr(module, "read_streams", lambda path: load_streams(path, 1 << 30))
    path = tmp_path / "take.xdf"
    cords, is_hidden = random_file(path, r, np.random.default_rng(seed))
    dataset = module.xdf_dataset(path, RecordingInfo(markers=markers()))
    (result,) = dataset.recordings
    assert dataset.ids.tolist() == IDS.tolist()
    np.testing.assert_allclose(result.ohm, r.ohm[cords], rtol=1e-12)
    np.testing.assert_allclose(result.sample_time, r.sample_time[cords], atol=1e-3)
    np.testing.assert_allclose(result.time, r.time, atol=1e-3)
    true = np.where(is_hidden[..., None], np.nan, r.points)
    np.testing.assert_allclose(result.points, true, rtol=1e-9, atol=1e-9)
