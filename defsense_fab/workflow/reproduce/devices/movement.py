"""The error that a design predicts for the movement that a unit was tested with.

What a design promises is of its own states: each pose taken whole and in mixtures. A hand is nearer
to rest most of the time, and mixes poses in its own way, so that the error differs where all cords
are perfect. Here the design's model alone is moved as the hand moved the unit: its solved states,
and smooth functions of the poses' weights between them, give markers and signals of its cords as
built; a decoder is fitted to some moments of the training, and errs in moments of the test.
Nothing of the unit's cords, cameras, mesh or material goes in.
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

# What is in the session of a unit: its one run, and what the twin alone knows of it.


def true_weights(session: Path, time: Float) -> Float:
    """Weights (t, d) of the poses at times (t,) s of a twin's session."""
    with np.load(session / TRUTH) as truth:
        at, weights = truth["sample_time"], truth["weights"]
    return np.stack([np.interp(time, at, w) for w in weights.T], axis=1)


def recording_of(device: Device, session: Path) -> Recording:
    """The one run of a session, with its channels as the device has them."""
    return DataFiles((session,)).load(device).recordings[0]


_MOMENTS = 400  # evenly taken from the training, and from the test
_KERNEL = 100  # of those of the training, for kernels, whose widths take long to find
_DRAWS, _SEED = 8, 1  # of the read-out's noise


@dataclass(frozen=True)
class MovementError:
    """RMSE (mm) of a decoder of this `form` without noise, and what the read-out's noise adds to
    it; both together are `rmse`."""

    form: str
    noise_free: float
    noise: float

    @property
    def rmse(self) -> float:
        """With noise, mm."""
        return float(np.hypot(self.noise_free, self.noise))


class DesignedMovement:
    """A unit's movement, made by its device's design alone: in the twin's session at times
    `trained` (t,) s, and in the `tested` pictures, of the markers that were seen there, since tags
    turn away from cameras where a body is bent most. Markers and channels are the model's."""

    def __init__(
        self, device: Device, session: Path, model: TrainedModel, trained: Float,
        tested: DecodedFrames,
    ) -> None:  # fmt: skip
        cords = {r.name: r.built for r in load_layout(build_folder(device)).by_channel()}
        reading = CordReading.from_device(device)
        self._prior = simulated_prior(device, model.channels, model.rest_points)
        self._noise = np.array([reading.noise(cords[name]) for name in model.channels])
        moved = _designed(device, [cords[n] for n in model.channels], reading, self._prior)
        self._signals, self._points = moved(
            _weights(device, session, trained[_some(len(trained), _MOMENTS)])
        )
        test = _some(len(tested.time), _MOMENTS)
        self._test_signals, self._test_points = moved(_weights(device, session, tested.time[test]))
        self._test_weights = tested.weights[test]

    def error(self, kind: str) -> MovementError:
        """Of a decoder of this `kind`, as training names them."""
        form, s, p = parse_form(kind), self._test_signals, self._test_points
        decode = self._decoder(form)
        said = decode(s).reshape(p.shape)
        rng = np.random.default_rng(_SEED)
        shaken = [
            decode(s + self._noise * rng.standard_normal(s.shape)).reshape(p.shape) - said
            for _ in range(_DRAWS)
        ]
        weights = np.array([self._test_weights] * _DRAWS)
        return MovementError(
            form, _rms(said - p, self._test_weights), _rms(np.array(shaken), weights)
        )

    def _decoder(self, form: str) -> Callable[[Float], Float]:
        if form == SIMULATED:
            return fit_simulated_decoder(self._prior)
        some = _some(len(self._points), _KERNEL if form == KERNEL else _MOMENTS)
        points = self._points[some].reshape(len(some), -1)
        return fit_decoder(form, self._signals[some], points, self._noise)


def _weights(device: Device, session: Path, times: Float) -> Float:
    """Of the device's own poses: a twin's hand may also pull at the skin."""
    return true_weights(session, times)[:, : len(device.poses)]


def _some(count: int, most: int) -> Int:
    """Indices of at most so many of so many, evenly taken."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))


def _rms(off: Float, weights: Float) -> float:
    """Root mean square length of vectors (..., 3) with weights (...)."""
    return float(np.sqrt((weights * (off**2).sum(-1)).sum() / weights.sum()))


def _designed(
    device: Device, cords: Sequence[BuiltCord], reading: CordReading, prior: Prior
) -> Callable[[Float], tuple[Float, Float]]:
    """Signals (t, c) and markers' displacements (t, m, 3) mm at poses' weights (t, d)."""
    folder = build_folder(device)
    fields = load_fields(folder)
    names = [p.name for p in device.poses]
    states = np.array([[w.get(name, 0.0) for name in names] for w in fields.weights])
    space = PoseSpace(pose_axes(device.poses), states)
    locator = PointLocator(QuadraticMesh.from_linear(load_mesh(folder)))
    ways = [locator.displacement(locator.find(c.path), fields.displacements) for c in cords]

    def moved(weights: Float) -> tuple[Float, Float]:
        at = space(weights)
        signals = [
            reading.signals(cord, cord.path + np.tensordot(at, way, 1))
            for cord, way in zip(cords, ways, strict=True)
        ]
        return np.stack(signals, axis=1), np.tensordot(at, prior.displacements[1:], 1)

    return moved
