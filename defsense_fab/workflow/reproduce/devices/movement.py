"""The error that a design predicts for the movement with which a unit was tested.

The prediction of a design is for its own states: each pose at full amplitude, and mixtures. A hand
is closer to rest most of the time and mixes poses differently, so that the error differs even if
all cords are perfect. Here the design alone is moved as the hand moved the unit: markers and
signals are interpolated between its simulated states, a decoder is fitted to some frames of the
training, and its error is measured in frames of the test. Nothing of the unit's cords, cameras,
mesh or material is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ....core.arrays import Float, Int
from ....core.device.build_folder import build_folder
from ....core.device.device import Device
from ....decoding.decoders import fit_decoder
from ....decoding.trained_model import TrainedModel
from ....mechanics.elements.point_location import PointLocator
from ....mechanics.elements.tet10 import QuadraticMesh
from ....sensing.built_cord import BuiltCord, CordReading
from ....store.fields import load_fields
from ....store.layout import load_layout
from ....store.mesh import load_mesh
from ....training.data.dataset import Recording
from ....training.evaluation.decoded_frames import DecodedFrames
from ....training.models.prepare import simulated_prior
from ....training.recordings.datasets import DataFiles
from ....training.regression.candidates import KERNEL, SIMULATED, parse_form
from ....training.regression.simulated_decoder import fit_simulated_decoder
from ....training.regression.simulation_prior import Prior
from ....twin.devices.pose_samples import pose_axes
from ....twin.recordings.run_files import TRUTH
from ....twin.scenes.pose_space import PoseSpace

MAX_FRAMES = 400  # of the training and of the test, evenly spread
MAX_KERNEL_FRAMES = 100  # of the training, for kernels, whose widths take long to fit
NOISE_DRAWS, NOISE_SEED = 8, 1  # of the read-out's noise


def load_true_weights(session: Path, time: Float) -> Float:
    """Return the true weights (t, d) of the poses at times (t,) s of a twin's session."""
    with np.load(session / TRUTH) as truth:
        sample_time, weights = truth["sample_time"], truth["weights"]
    return np.stack([np.interp(time, sample_time, w) for w in weights.T], axis=1)


def load_unit_recording(device: Device, session: Path) -> Recording:
    """Return the only run of a unit's session, with the channels of the device."""
    return DataFiles((session,)).load(device).recordings[0]


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
        device: The built device.
        session: Session of the twin.
        model: The model that was trained on the session; its markers and channels are used.
        trained: Times of the training frames (t,) s.
        tested: Frames of the test. Only markers that were visible count, because tags turn away
            from the cameras where the body is bent most.
    """

    def __init__(
        self, device: Device, session: Path, model: TrainedModel, trained: Float,
        tested: DecodedFrames,
    ) -> None:  # fmt: skip
        cords = {r.name: r.built for r in load_layout(build_folder(device)).by_channel()}
        reading = CordReading.from_device(device)
        self._prior = simulated_prior(device, model.channels, model.rest_points)
        self._noise = np.array([reading.noise(cords[name]) for name in model.channels])
        simulate = _design_simulator(
            device, [cords[n] for n in model.channels], reading, self._prior
        )
        self._signals, self._points = simulate(
            _weights(device, session, trained[_spread(len(trained), MAX_FRAMES)])
        )
        test = _spread(len(tested.time), MAX_FRAMES)
        self._test_signals, self._test_points = simulate(
            _weights(device, session, tested.time[test])
        )
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


def _weights(device: Device, session: Path, times: Float) -> Float:
    """Return the weights of the device's own poses, without grips of the twin's hand."""
    return load_true_weights(session, times)[:, : len(device.poses)]


def _spread(count: int, limit: int) -> Int:
    """Return at most `limit` of `count` indices, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(limit, count)).round().astype(int))


def _rms(vectors: Float, weights: Float) -> float:
    """Return the RMS length of vectors (..., 3) with weights (...)."""
    return float(np.sqrt((weights * (vectors**2).sum(-1)).sum() / weights.sum()))


def _design_simulator(
    device: Device, cords: Sequence[BuiltCord], reading: CordReading, prior: Prior
) -> Callable[[Float], tuple[Float, Float]]:
    """Return a function from weights of poses (t, d) to signals (t, c) and displacements.

    The displacements (t, m, 3) mm are those of the markers.
    """
    folder = build_folder(device)
    fields = load_fields(folder)
    names = [p.name for p in device.poses]
    weights = np.array([[w.get(name, 0.0) for name in names] for w in fields.weights])
    space = PoseSpace(pose_axes(device.poses), weights)
    locator = PointLocator(QuadraticMesh.from_linear(load_mesh(folder)))
    displacements = [
        locator.displacement(locator.find(c.path), fields.displacements) for c in cords
    ]

    def simulate(weights: Float) -> tuple[Float, Float]:
        states = space(weights)
        signals = [
            reading.signals(cord, cord.path + np.tensordot(states, u, 1))
            for cord, u in zip(cords, displacements, strict=True)
        ]
        return np.stack(signals, axis=1), np.tensordot(states, prior.displacements[1:], 1)

    return simulate
