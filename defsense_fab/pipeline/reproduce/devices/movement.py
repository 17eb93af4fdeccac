"""The error that a design predicts for the movement that a unit was tested with.

What a design promises is of its own states: each pose taken whole and in mixtures. A hand is nearer
to rest most of the time, and mixes poses in its own way, so that the error differs where all cords
are perfect. Here the design's model alone is moved as the hand moved the unit: its solved states,
and smooth functions of the poses' weights between them, give markers and signals of its cords as
built; a decoder is fitted to some moments of the training, and errs in moments of the test.
Nothing of the unit's cords, cameras, mesh or material goes in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ....core.arrays import Float, Int
from ....core.device import Device
from ....decoding.decoders import fit_decoder
from ....decoding.trained_model import TrainedModel
from ....mechanics.elements.point_location import PointLocator
from ....mechanics.elements.tet10 import QuadraticMesh
from ....sensing.built_cord import BuiltCord, CordReading
from ....training.evaluation.decoded_frames import DecodedFrames
from ....training.ridge.candidates import FORMS, KERNEL, SIMULATED
from ....training.simulation.simulated_model import simulated_decoder
from ....twin.scenes.pose_space import PoseSpace
from ...artifacts.build_folder import build_folder
from ...artifacts.fields import load_fields
from ...artifacts.layout import load_layout
from ...artifacts.mesh import load_mesh
from ...train.models.simulated_prior import simulated_prior
from ...twin.devices.pose_samples import coordinates
from .unit_session import true_weights

_MOMENTS = 400  # evenly taken from the training, and from the test
_KERNEL = 100  # of the training, for kernels, whose widths take long to find
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


def movement_error(
    device: Device, session: Path, model: TrainedModel, trained: Float, tested: DecodedFrames,
    kind: str,
) -> MovementError:  # fmt: skip
    """Of the device's design for a decoder of this `kind`, as training names them, of movements as
    in the twin's session at times `trained` (t,) s and in the `tested` pictures, of the markers
    that were seen there: tags turn away from cameras where a body is bent most."""
    form = form_of(kind)
    moved = _designed(device, model)
    training = _some(len(trained), _KERNEL if form == KERNEL else _MOMENTS)
    S, P = moved(_weights(device, session, trained[training]))
    test = _some(len(tested.time), _MOMENTS)
    s, p = moved(_weights(device, session, tested.time[test]))
    weights = tested.weights[test]
    reading, cords = CordReading.of(device), _cords(device)
    noise = np.array([reading.noise(cords[name]) for name in model.channels])
    decode: Callable[[Float], Float]
    if form == SIMULATED:
        decode = simulated_decoder(simulated_prior(device, model.channels, model.rest_points))
    else:
        decode = fit_decoder(form, S, P.reshape(len(P), -1), noise)
    said = decode(s).reshape(p.shape)
    rng = np.random.default_rng(_SEED)
    shaken = [
        decode(s + noise * rng.standard_normal(s.shape)).reshape(p.shape) for _ in range(_DRAWS)
    ]
    return MovementError(
        form, _rms(said - p, weights), _rms(np.array(shaken) - said, np.array([weights] * _DRAWS))
    )


def form_of(kind: str) -> str:
    """What starts from the simulation is the simulation's own map."""
    parts = kind.split(" + ")
    return SIMULATED if SIMULATED in parts else next(f for f in FORMS if f in parts)


def _weights(device: Device, session: Path, times: Float) -> Float:
    """Of the device's own poses: a twin's hand may also pull at the skin."""
    return true_weights(session, times)[:, : len(device.poses)]


def _some(count: int, most: int) -> Int:
    """Indices of at most so many of so many, evenly taken."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))


def _rms(off: Float, weights: Float) -> float:
    """Root mean square length of vectors (..., 3) with weights (...)."""
    return float(np.sqrt((weights * (off**2).sum(-1)).sum() / weights.sum()))


def _cords(device: Device) -> dict[str, BuiltCord]:
    return {r.name: r.built for r in load_layout(build_folder(device)).by_channel()}


def _designed(device: Device, model: TrainedModel) -> Callable[[Float], tuple[Float, Float]]:
    """Signals (t, c) and markers' displacements (t, m, 3) mm at poses' weights (t, d)."""
    folder = build_folder(device)
    fields = load_fields(folder)
    names = [p.name for p in device.poses]
    states = np.array([[w.get(name, 0.0) for name in names] for w in fields.weights])
    space = PoseSpace(coordinates(device.poses), states)
    markers = simulated_prior(device, model.channels, model.rest_points).displacements[1:]
    locator = PointLocator(QuadraticMesh.from_linear(load_mesh(folder)))
    cords, reading = _cords(device), CordReading.of(device)
    ways = {
        n: locator.displacement(locator.find(cords[n].path), fields.displacements)
        for n in model.channels
    }

    def moved(weights: Float) -> tuple[Float, Float]:
        c = space(weights)
        signals = [
            reading.signals(cords[n], cords[n].path + np.tensordot(c, ways[n], 1))
            for n in model.channels
        ]
        return np.stack(signals, axis=1), np.tensordot(c, markers, 1)

    return moved
