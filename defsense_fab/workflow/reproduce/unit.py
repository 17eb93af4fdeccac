"""A unit: one built device that its twin moves, its session and model, and its errors.

The prediction of a design is for its own states: each pose at full amplitude, and mixtures. A hand
is closer to rest most of the time and mixes poses differently, so that the error differs even if
all cords are perfect. `DesignedMovement` therefore moves the design alone as the hand moved the
unit: markers and signals are interpolated between its simulated states, a decoder is fitted to some
frames of the training, and its error is measured in frames of the test. Nothing of the unit's
cords, cameras, mesh or material is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...decoding.decoders import fit_decoder
from ...decoding.trained_model import TrainedModel
from ...report.evaluation.data_files import as_data
from ...runtime.controls.pose_amplitudes import RADIUS_90, PoseAmplitudes
from ...sensing.built_cord import BuiltCord, CordReading
from ...store.build import Build
from ...training.data.dataset import Recording
from ...training.evaluation.decoded_frames import DecodedFrames
from ...training.evaluation.predicted_error import DesignPrediction, predict_error
from ...training.fitting.prepare import simulated_prior
from ...training.fitting.train_model import Training, measure_errors
from ...training.recordings.datasets import load_dataset
from ...training.regression.candidates import AFFINE, KERNEL, SIMULATED, parse_form
from ...training.regression.simulated_decoder import fit_simulated_decoder
from ...training.regression.simulation_prior import Prior
from ...twin.devices.pose_samples import pose_axes
from ...twin.recordings.run_files import TRUTH
from ...twin.scenes.pose_space import PoseSpace
from ..run.live_device import live_device
from ..train.evaluation import evaluate_files
from ..train.options import DataFiles

MAX_FRAMES = 400  # of the training and of the test, evenly spread
MAX_KERNEL_FRAMES = 100  # of the training, for kernels, whose widths take long to fit
NOISE_DRAWS, NOISE_SEED = 8, 1  # of the read-out's noise
MIN_POSE_LEVEL = 0.5  # from which on a frame shows a pose
MAX_OTHER_POSE = 0.2  # largest level of another pose, relative to that pose


class Unit:
    """A built device of a layout. Files are read when they are first used.

    Args:
        device: The built device.
        number: Number of the unit, from 1; also the seed of the hand and of the tolerances.

    Attributes:
        device: The built device.
        number: Number of the unit.
        build: The device's build.
        session: Folder of the session.
        model_file: File of the model that is trained on the session.
    """

    def __init__(self, device: Device, number: int = 1) -> None:
        self.device, self.number, self.build = device, number, Build(build_folder(device))
        self.session = device.source / f"unit-{number}"
        self.model_file = device.source / f"unit-{number}.json"

    def file(self, suffix: str) -> Path:
        """Return the path of a file of kept results."""
        return self.session.with_suffix(suffix)

    @cached_property
    def recording(self) -> Recording:
        """The only run of the session, with the channels of the device."""
        return load_dataset(DataFiles((self.session,)), self.device).recordings[0]

    @cached_property
    def truth(self) -> dict[str, Float]:
        """The true values of the twin: `ids`, `time`, `points`, `sample_time` and `weights`."""
        with np.load(self.session / TRUTH) as truth:
            return dict(truth)

    def true_weights(self, time: Float) -> Float:
        """Return the true weights (t, d) of the poses at times (t,) s."""
        samples = self.truth["sample_time"]
        return np.stack([np.interp(time, samples, w) for w in self.truth["weights"].T], axis=1)


@dataclass(frozen=True)
class MovementError:
    """The error of a decoder in the movement of a unit.

    Attributes:
        form: Form of the decoder.
        noise_free: RMSE without noise of the read-out, mm.
        noise: RMSE that the noise adds, mm.
    """

    form: str
    noise_free: float
    noise: float

    @property
    def rmse(self) -> float:
        """RMSE with noise, mm."""
        return float(np.hypot(self.noise_free, self.noise))


class DesignedMovement:
    """The movement of a unit, simulated with the design of its device alone.

    Args:
        unit: The unit.
        model: The model that was trained on the session; its markers and channels are used.
        trained: Times of the training frames (t,) s.
        tested: Frames of the test. Only markers that were visible count, because tags turn away
            from the cameras where the body is bent most.
    """

    def __init__(
        self, unit: Unit, model: TrainedModel, trained: Float, tested: DecodedFrames
    ) -> None:
        cords = {r.name: r.built for r in unit.build.layout.by_channel()}
        reading = CordReading.from_device(unit.device)
        self._prior = simulated_prior(unit.device, model.channels, model.rest_points)
        self._noise = np.array([reading.noise(cords[name]) for name in model.channels])
        simulate = _design_simulator(unit, [cords[n] for n in model.channels], reading, self._prior)
        train = _spread(len(trained), MAX_FRAMES)
        test = _spread(len(tested.time), MAX_FRAMES)
        self._signals, self._points = simulate(trained[train])
        self._test_signals, self._test_points = simulate(tested.time[test])
        self._test_weights = tested.weights[test]

    def error(self, kind: str) -> MovementError:
        """Return the error of a kind of decoder, as training names them."""
        form, s, p = parse_form(kind), self._test_signals, self._test_points
        decode = self._decoder(form)
        noise_free = decode(s).reshape(p.shape)
        rng = np.random.default_rng(NOISE_SEED)
        noise = [
            decode(s + self._noise * rng.standard_normal(s.shape)).reshape(p.shape) - noise_free
            for _ in range(NOISE_DRAWS)
        ]
        weights = np.array([self._test_weights] * NOISE_DRAWS)
        return MovementError(
            form, _rms(noise_free - p, self._test_weights), _rms(np.array(noise), weights)
        )

    def _decoder(self, form: str) -> Callable[[Float], Float]:
        if form == SIMULATED:
            return fit_simulated_decoder(self._prior)
        chosen = _spread(len(self._points), MAX_KERNEL_FRAMES if form == KERNEL else MAX_FRAMES)
        points = self._points[chosen].reshape(len(chosen), -1)
        return fit_decoder(form, self._signals[chosen], points, self._noise)


def _spread(count: int, limit: int) -> Int:
    """Return at most `limit` of `count` indices, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(limit, count)).round().astype(int))


def _rms(vectors: Float, weights: Float) -> float:
    """Return the RMS length of vectors (..., 3) with weights (...)."""
    return float(np.sqrt((weights * (vectors**2).sum(-1)).sum() / weights.sum()))


def _design_simulator(
    unit: Unit, cords: Sequence[BuiltCord], reading: CordReading, prior: Prior
) -> Callable[[Float], tuple[Float, Float]]:
    """Return a function from times (t,) s to signals (t, c) and displacements of the design.

    The displacements (t, m, 3) mm are those of the markers. Grips of the twin's hand are ignored.
    """
    poses, fields, locator = unit.device.poses, unit.build.fields, unit.build.locator
    weights = np.array([[w.get(p.name, 0.0) for p in poses] for w in fields.weights])
    space = PoseSpace(pose_axes(poses), weights)
    displacements = [
        locator.displacement(locator.find(c.path), fields.displacements) for c in cords
    ]

    def simulate(time: Float) -> tuple[Float, Float]:
        states = space(unit.true_weights(time)[:, : len(poses)])
        signals = [
            reading.signals(cord, cord.path + np.tensordot(states, u, 1))
            for cord, u in zip(cords, displacements, strict=True)
        ]
        return np.stack(signals, axis=1), np.tensordot(states, prior.displacements[1:], 1)

    return simulate


def measure_unit(unit: Unit, training: Training) -> dict[str, Any]:
    """Measure the errors of a unit in frames that the model was not trained on.

    Args:
        unit: The unit.
        training: The training of its model.

    Returns:
        Plain values; lengths in mm, squares in mm^2. `affine` and `chosen` are errors of these
        decoders against the measured markers, `truth` those of the chosen one against the true
        markers, `poses` errors by pose, `predicted` the prediction for the design's own states,
        `movement` that for the tested movement, `causes` and `causes_by_truth` the parts of the
        mean square error, and `told_apart` how often poses are recognized.
    """
    evaluation = evaluate_files([unit.model_file], DataFiles((unit.session,)), unit.device)
    (tables,) = as_data(evaluation)["models"].values()
    affine = next(a for a in training.candidates if a.name == AFFINE)
    assert affine.test is not None
    frames = evaluation.models[0].evaluation.frames
    trained_times = training.training_frames.time
    design = DesignedMovement(unit, training.model, trained_times, frames)
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
        "truth": _errors_against_truth(unit, training.model, frames.time),
        "poses": tables["poses"],
        "camera_noise": tables["camera_noise"],
        "predicted": tables["predicted"],
        "movement": {
            AFFINE: _as_row(affine_movement, affine_movement.rmse, affine.test.rmse),
            "chosen": _movement_row(chosen_movement, training, frames),
        },
        "causes": tables["error_budget"],
        "causes_by_truth": tables["error_budget_by_truth"],
        "told_apart": _recognize_poses(unit, training.model, frames.time),
        "notes": list(evaluation.notes),
    }


def _movement_row(
    movement: MovementError, training: Training, frames: DecodedFrames
) -> dict[str, Any]:
    """Return the prediction for a movement, with the cords' repeatability if it was estimated."""
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


def _errors_against_truth(unit: Unit, model: TrainedModel, tested: Float) -> dict[str, float]:
    """Return the errors at the true times of the frames, against the true positions."""
    truth, recording = unit.truth, unit.recording
    order = [truth["ids"].tolist().index(n) for n in model.ids.tolist()]
    time, points = truth["time"], truth["points"][:, order].astype(float)
    is_tested = time >= tested[0] - 0.5 * float(np.median(np.diff(time)))
    decoded = model.decode(recording.sample_time, recording.signals, time[is_tested]).points
    is_decoded = np.isfinite(decoded).all(axis=(1, 2))
    errors = measure_errors(decoded[is_decoded], points[is_tested][is_decoded])
    return {"rmse": errors.rmse, "peak": errors.peak, "average_peak": errors.average_peak}


def _recognize_poses(unit: Unit, model: TrainedModel, tested: Float) -> dict[str, Any] | None:
    """Return how often the live loop recognizes the pose in frames that show one pose.

    A pose is recognized if its amplitude is the largest. The result is None without such frames.
    """
    device, weights = unit.device, unit.true_weights(tested)
    is_shown, pose = _find_single_poses(weights)
    if weights.shape[1] != len(device.poses) or not is_shown.any():
        return None
    basis = live_device(unit.model_file, device.source).poses
    if basis is None or basis.names != tuple(p.name for p in device.poses):
        return None
    amplitudes = PoseAmplitudes(basis, len(model.channels))
    decoded = model.decode(unit.recording.sample_time, unit.recording.signals, tested)
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
