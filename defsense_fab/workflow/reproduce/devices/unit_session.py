"""What is in the session of a unit: its one run, and what the twin alone knows of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Device
from ....training.data.dataset import Recording
from ....training.recordings.datasets import DataFiles
from ....twin.recordings.run_files import TRUTH


def true_weights(session: Path, time: Float) -> Float:
    """Weights (t, d) of the poses at times (t,) s of a twin's session."""
    with np.load(session / TRUTH) as truth:
        at, weights = truth["sample_time"], truth["weights"]
    return np.stack([np.interp(time, at, w) for w in weights.T], axis=1)


def recording_of(device: Device, session: Path) -> Recording:
    """The one run of a session, with its channels as the device has them."""
    return DataFiles((session,)).load(device).recordings[0]
