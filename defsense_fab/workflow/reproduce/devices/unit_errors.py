"""Results of the test of a unit: errors by decoder, predictions, causes, and pose recognition."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Bool, Float, Int
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
from .movement import DesignedMovement, MovementError, load_true_weights, load_unit_recording

MIN_POSE_LEVEL = 0.5  # from which on a frame shows a pose
MAX_OTHER_POSE = 0.2  # largest level of another pose, relative to that pose


def measure_unit(
    device: Device, session: Path, model_file: Path, training: Training
) -> dict[str, Any]:
    """Measure the errors of a unit in frames that the model was not trained on.

    Args:
        device: The built device.
        session: Session of its twin.
        model_file: File of the trained model.
        training: The training.

    Returns:
        Plain values; lengths in mm, squares in mm^2. `affine` and `chosen` are errors of these
        decoders against the measured markers, `truth` those of the chosen one against the true
        markers, `poses` errors by pose, `predicted` the prediction for the design's own states,
        `movement` that for the tested movement, `causes` and `causes_by_truth` the parts of the
        mean square error, and `told_apart` how often poses are recognized.
    """
    evaluation = evaluate_files([model_file], DataFiles((session,)), device)
    (tables,) = as_data(evaluation)["models"].values()
    affine = next(a for a in training.candidates if a.name == AFFINE)
    assert affine.test is not None
    frames = evaluation.models[0].evaluation.frames
    trained_times = training.training_frames.time
    design = DesignedMovement(device, session, training.model, trained_times, frames)
    affine_movement, chosen_movement = design.error(AFFINE), design.error(training.selected)
    return {
        "decoder": training.selected,
        "frames": {"trained": len(trained_times), "tested": tables["errors"]["frames"]},
        "markers": len(training.model.ids),
        "affine": {
            "rmse": affine.test.rmse,
            "deviation": float(affine.test.per_state.std()),
            "peak": affine.test.peak,
            "average_peak": affine.test.average_peak,
        },
        "chosen": {k: tables["errors"][k] for k in ("rmse", "deviation", "peak", "average_peak")},
        "truth": _errors_against_truth(device, session, training.model, frames.time),
        "poses": tables["poses"],
        "camera_noise": tables["camera_noise"],
        "predicted": tables["predicted"],
        "movement": {
            AFFINE: _as_row(affine_movement, affine_movement.rmse, affine.test.rmse),
            "chosen": _movement_row(chosen_movement, training, frames),
        },
        "causes": tables["error_budget"],
        "causes_by_truth": tables["error_budget_by_truth"],
        "told_apart": _recognize_poses(device, session, model_file, frames.time),
        "notes": list(evaluation.notes),
    }


def _movement_row(
    movement: MovementError, training: Training, frames: DecodedFrames
) -> dict[str, Any]:
    """Return the prediction for a movement, with the repeatability of the cords if it is known."""
    measured = float(np.sqrt((frames.frame_error**2).mean()))
    if training.repeatability is None:
        return _as_row(movement, movement.rmse, measured)
    design = DesignPrediction(movement.rmse, movement.noise, movement.rmse, movement.rmse)
    prediction = predict_error(training.repeatability, frames, design)
    row = _as_row(movement, prediction.predicted, measured)
    return {**row, "mean_squares": prediction.shares}


def _as_row(movement: MovementError, predicted: float, measured: float) -> dict[str, Any]:
    return {
        **vars(movement),
        "design": movement.rmse,
        "rmse": predicted,
        "ratio": predicted / measured,
    }


def _errors_against_truth(
    device: Device, session: Path, model: TrainedModel, tested: Float
) -> dict[str, float]:
    """Return the errors at the true times of the frames, against the true positions."""
    with np.load(session / TRUTH) as truth:
        order = [truth["ids"].tolist().index(n) for n in model.ids.tolist()]
        time, points = truth["time"], truth["points"][:, order].astype(float)
    is_tested = time >= tested[0] - 0.5 * float(np.median(np.diff(time)))
    recording = load_unit_recording(device, session)
    decoded = model.decode(recording.sample_time, recording.signals, time[is_tested]).points
    is_decoded = np.isfinite(decoded).all(axis=(1, 2))
    errors = measure_errors(decoded[is_decoded], points[is_tested][is_decoded])
    return {"rmse": errors.rmse, "peak": errors.peak, "average_peak": errors.average_peak}


def _recognize_poses(
    device: Device, session: Path, model_file: Path, tested: Float
) -> dict[str, Any] | None:
    """Return how often the live loop recognizes the pose in frames that show one pose.

    A pose is recognized if its amplitude is the largest. The result is None without such frames.
    """
    weights = load_true_weights(session, tested)
    is_shown, pose = _find_single_poses(weights)
    if weights.shape[1] != len(device.poses) or not is_shown.any():
        return None
    basis = live_device(model_file, device.source).poses
    if basis is None or basis.names != tuple(p.name for p in device.poses):
        return None
    model = load_model(model_file)
    amplitudes = PoseAmplitudes(basis, len(model.channels))
    recording = load_unit_recording(device, session)
    decoded = model.decode(recording.sample_time, recording.signals, tested)
    deviation = np.nan_to_num(decoded.radius, nan=1.0) / RADIUS_90
    largest = np.array(
        [
            int(amplitudes(u, sd).values.argmax())
            for u, sd in zip(decoded.points - model.rest_points, deviation, strict=True)
        ]
    )
    is_right = largest[is_shown] == pose[is_shown]
    by_pose = {
        name: float(is_right[pose[is_shown] == k].mean())
        for k, name in enumerate(basis.names)
        if (pose[is_shown] == k).any()
    }
    return {"share": float(is_right.mean()), "frames": int(is_shown.sum()), "by_pose": by_pose}


def _find_single_poses(weights: Float) -> tuple[Bool, Int]:
    """Return which frames (t,) show one pose alone, and the largest pose in each (t,)."""
    order = np.sort(np.abs(weights), axis=1)
    largest = order[:, -1]
    second = order[:, -2] if weights.shape[1] > 1 else np.zeros(len(weights))
    is_single = (largest >= MIN_POSE_LEVEL) & (second <= MAX_OTHER_POSE * largest)
    return is_single, np.abs(weights).argmax(axis=1)
