"""What a unit's test tells: its errors by decoder, what was predicted of them, what they come from,
and whether poses are told apart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Bool, Float
from ....core.device.device import Device
from ....decoding.trained_model import TrainedModel
from ....report.evaluation.tables import as_data
from ....runtime.controls.pose_amplitudes import RADIUS_90, PoseAmplitudes
from ....runtime.live.live_device import live_device
from ....training.evaluation.decoded_frames import DecodedFrames
from ....training.evaluation.evaluate_models import evaluate_files
from ....training.evaluation.predicted_error import DesignPrediction, predict_error
from ....training.fitting.train_model import Training, measure_errors
from ....training.models.model_file import load_model
from ....training.recordings.datasets import DataFiles
from ....training.regression.candidates import AFFINE
from ....twin.recordings.run_files import TRUTH
from .movement import DesignedMovement, MovementError
from .movement import recording_of, true_weights

#: Of a pose's amplitude, from which on a picture shows it; of others beside it, at most.
SHOWN, BESIDE = 0.5, 0.2


def measure_unit(
    device: Device, session: Path, model_file: Path, training: Training
) -> dict[str, Any]:
    """Of the pictures that the model was not trained on, in plain values; lengths in mm, squares in
    mm^2: errors of the `affine` decoder and of the `chosen` one against where the cameras saw the
    markers, of the latter against where they were (`truth`), by pose; what was `predicted` of the
    design's own states, and of the `movement` that was tested; the
    `causes` of its mean square, also `by_truth`; and how often poses were `told_apart`."""
    found = evaluate_files([model_file], DataFiles((session,)), device)
    (told,) = as_data(found)["models"].values()
    affine = next(a for a in training.candidates if a.name == AFFINE)
    assert affine.test is not None
    frames = found.models[0].evaluation.frames
    designed = DesignedMovement(device, session, training.model, training.training_frames.time, frames)
    moved = {AFFINE: designed.error(AFFINE), "chosen": designed.error(training.selected)}
    return {
        "decoder": training.selected,
        "frames": {"trained": len(training.training_frames), "tested": told["errors"]["frames"]},
        "markers": len(training.model.ids),
        "affine": {
            "rmse": affine.test.rmse,
            "deviation": float(affine.test.per_state.std()),
            "peak": affine.test.peak,
            "average_peak": affine.test.average_peak,
        },
        "chosen": {k: told["errors"][k] for k in ("rmse", "deviation", "peak", "average_peak")},
        "truth": _against_truth(device, session, training.model, frames.time),
        "poses": told["poses"],
        "camera_noise": told["camera_noise"],
        "predicted": told["predicted"],
        "movement": {
            AFFINE: _as_row(moved[AFFINE], moved[AFFINE].rmse, affine.test.rmse),
            "chosen": _movement_row(moved["chosen"], training, frames),
        },
        "causes": told["error_budget"],
        "causes_by_truth": told["error_budget_by_truth"],
        "told_apart": _told_apart(device, session, model_file, frames.time),
        "notes": list(found.notes),
    }


def _movement_row(
    moved: MovementError, training: Training, frames: DecodedFrames
) -> dict[str, Any]:
    """With what the training tells of how well the cords repeat, where it does."""
    measured = float(np.sqrt((frames.frame_error**2).mean()))
    if training.repeatability is None:
        return _as_row(moved, moved.rmse, measured)
    promise = DesignPrediction(moved.rmse, moved.noise, moved.rmse, moved.rmse)
    p = predict_error(training.repeatability, frames, promise)
    return {**_as_row(moved, p.predicted, measured), "mean_squares": p.shares}


def _as_row(moved: MovementError, predicted: float, measured: float) -> dict[str, Any]:
    return {
        **vars(moved), "design": moved.rmse, "rmse": predicted, "ratio": predicted / measured
    }  # fmt: skip


def _against_truth(
    device: Device, session: Path, model: TrainedModel, tested: Float
) -> dict[str, float]:
    """At the pictures' true times, which the twin alone knows."""
    with np.load(session / TRUTH) as truth:
        order = [truth["ids"].tolist().index(n) for n in model.ids.tolist()]
        time, points = truth["time"], truth["points"][:, order].astype(float)
    last = time >= tested[0] - 0.5 * float(np.median(np.diff(time)))
    r = recording_of(device, session)
    decoded = model.decode(r.sample_time, r.signals, time[last]).points
    known = np.isfinite(decoded).all(axis=(1, 2))
    e = measure_errors(decoded[known], points[last][known])
    return {"rmse": e.rmse, "peak": e.peak, "average_peak": e.average_peak}


def _told_apart(
    device: Device, session: Path, model_file: Path, tested: Float
) -> dict[str, Any] | None:
    """Of pictures that show one pose, and hardly another, the share in which that pose's amplitude
    is found to be the largest, as the live loop finds them; None where there are none."""
    weights = true_weights(session, tested)
    shown, pose = _one_pose(weights)
    if weights.shape[1] != len(device.poses) or not shown.any():
        return None
    basis = live_device(model_file, device.source).poses
    if basis is None or basis.names != tuple(p.name for p in device.poses):
        return None
    model = load_model(model_file)
    amplitudes = PoseAmplitudes(basis, len(model.channels))
    r = recording_of(device, session)
    decoded = model.decode(r.sample_time, r.signals, tested)
    deviation = np.nan_to_num(decoded.radius, nan=1.0) / RADIUS_90
    found = np.array(
        [
            int(amplitudes(u, sd).values.argmax())
            for u, sd in zip(decoded.points - model.rest_points, deviation, strict=True)
        ]
    )
    right = found[shown] == pose[shown]
    by_pose = {
        name: float(right[pose[shown] == k].mean())
        for k, name in enumerate(basis.names)
        if (pose[shown] == k).any()
    }
    return {"share": float(right.mean()), "frames": int(shown.sum()), "by_pose": by_pose}


def _one_pose(weights: Float) -> tuple[Bool, Any]:
    """Which pictures (t,) show one pose alone, and which pose is largest in each."""
    order = np.sort(np.abs(weights), axis=1)
    largest = order[:, -1]
    second = order[:, -2] if weights.shape[1] > 1 else np.zeros(len(weights))
    return (largest >= SHOWN) & (second <= BESIDE * largest), np.abs(weights).argmax(axis=1)
