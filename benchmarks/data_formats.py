"""One session in every form that training takes: is it the same model?

    python -m benchmarks.data_formats my-device/twin-1-1 --device my-device

The session, of one run, is written as a dataset, as tables with tracks of each format, and as XDF,
into a folder that is deleted again (`--keep FOLDER`: is not), and trained on as `defsense train`
does. Told are, for each form: the decoder that was chosen; the largest difference of its weights
from those of the session's own model, relative to the largest weight; the largest distance (mm)
between both models' predictions at the last 30 % of the pictures, each by its own form's signals.

C3D, TRC and XDF have no standard deviations of places: markers then count alike. So their models
are also compared with that of the session without its standard deviations (column `no sigma`).
`signals.csv` has the signals at the pictures, half as many as the samples in `samples.csv`: other
data, of which a memory knows less.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from defsense_fab.capture.files.formats import read_tracks, write_tracks
from defsense_fab.capture.sessions.result_files import ALIGNED, SAMPLES, SIGNALS
from defsense_fab.core.arrays import Float
from defsense_fab.core.device.device import Device
from defsense_fab.core.device.device_file import load_device
from defsense_fab.decoding.trained_model import TrainedModel
from defsense_fab.training.data.dataset import Dataset
from defsense_fab.training.fitting.train_model import TrainingOptions
from defsense_fab.training.models.prepare import prepare
from defsense_fab.training.models.train_device import train_dataset
from defsense_fab.training.recordings.datasets import DataFiles
from defsense_fab.training.recordings.dataset_parquet import write_dataset
from tests.training.recordings.xdf_writer import stream, write_xdf

SESSION, PLAIN = "session", "session without sigma"
_TEST = 0.3


def forms(session: Path, data: Dataset, folder: Path) -> dict[str, DataFiles]:
    """The session's data in `folder`, by what it is written as."""
    (r,) = data.recordings
    markers = session / "markers.json"
    tracks = read_tracks(session / ALIGNED)
    shutil.copy(session / SAMPLES, folder / SAMPLES)
    shutil.copy(session / SIGNALS, folder / SIGNALS)
    write_dataset(folder / "dataset", data)
    bare = replace(data, recordings=(replace(r, sigma=np.full(r.sigma.shape, np.nan)),))
    write_dataset(folder / "plain", bare)
    out = {
        SESSION: DataFiles((session,)),
        PLAIN: DataFiles((folder / "plain",)),
        "dataset in Parquet": DataFiles((folder / "dataset",)),
    }
    for suffix in (".csv", ".npz", ".parquet", ".c3d", ".trc"):
        path = folder / f"take{suffix}"
        write_tracks(path, tracks)
        name = f"samples.csv, tracks {suffix}"
        out[name] = DataFiles((), folder / SAMPLES, path, markers)
    out["signals.csv, tracks .csv"] = DataFiles((), folder / SIGNALS, folder / "take.csv", markers)
    labels = [f"tag_{i}_{a}" for i in data.ids.tolist() for a in "xyz"]
    places = r.points.reshape(len(r.time), -1)
    mocap = stream(2, "Cameras", "MoCap", labels, r.time, places, units="mm")
    names = list(data.channels)
    for what, kind, values in (("signals", "Cords", r.signals), ("ohm", "Resistance", r.ohm)):
        cords = stream(1, "Board", kind, names, r.sample_time, values)
        path = write_xdf(folder / f"{what}.xdf", cords, mocap)
        out[f"XDF, {what}"] = DataFiles((path,), markers=markers)
    return out


def predicted(model: TrainedModel, data: Dataset) -> Float:
    """Of the last pictures (t, m, 3) mm."""
    (r,) = data.recordings
    last = r.time[-round(_TEST * len(r.time)) :]
    return model.decode(r.sample_time, r.signals, last).points


def apart(a: Float, b: Float) -> float:
    """Largest distance, mm."""
    return float(np.nanmax(np.linalg.norm(a - b, axis=2)))


def weights(a: TrainedModel, b: TrainedModel) -> float | None:
    """Largest difference, relative to the largest weight; None of decoders of other features."""
    ours, theirs = a.main.decoder.weights, b.main.decoder.weights
    if ours.shape != theirs.shape:
        return None
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


@contextmanager
def place(keep: Path | None) -> Iterator[Path]:
    if keep is None:
        with tempfile.TemporaryDirectory() as made:
            yield Path(made)
    else:
        keep.mkdir(parents=True)
        yield keep


def table(session: Path, device: Device, options: TrainingOptions, folder: Path) -> None:
    files = forms(session, DataFiles((session,)).load(device), folder)
    made: dict[str, tuple[TrainedModel, Float]] = {}
    print(f"{'form':30}{'decoder':32}{'weights':>9}{'mm':>9}{'no sigma':>10}")
    for name, given in files.items():
        data, prior, _ = prepare(given.load(device), device)
        model = train_dataset(data, options, prior).model
        made[name] = model, predicted(model, data)
        of, found = made[name]
        told = [weights(of, made[SESSION][0]), apart(found, made[SESSION][1])]
        told.append(apart(found, made[PLAIN][1]) if PLAIN in made else None)
        cells = ["-" if x is None else f"{x:.2g}" for x in told]
        print(f"{name:30}{of.kind:32}{cells[0]:>9}{cells[1]:>9}{cells[2]:>10}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--device", type=Path, required=True)
    parser.add_argument("--decoder", default="auto")
    parser.add_argument("--no-memory", action="store_true")
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    how = TrainingOptions(options.decoder, not options.no_memory)
    with place(options.keep) as folder:
        table(options.session, load_device(options.device), how, folder)


if __name__ == "__main__":
    main()
