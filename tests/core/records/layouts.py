"""Make layouts with arbitrary predictions for tests."""

from __future__ import annotations

import numpy as np

from defsense_fab.core.prediction import Prediction
from defsense_fab.store.layout import BandRecord, CordPath, CordRecord, LayoutRecord, LimitsRecord


def cord(sensor, channel):
    """Return the record of a drawn cord."""
    line = np.array([[0.0, 0, 0], [150, 0, 0]])
    return CordRecord(
        **vars(CordPath.of(sensor)), channel=channel, points=line, length=150.0, min_radius=9.0,
        min_wall=2.0, inlets=(1.0, 1.0), cord_diameter=2.0, peak_strain=0.1, least_strain=0.0,
        stretch=line, series=0.0, prestretch=None, noise=0.003,
    )  # fmt: skip


def layout(*sensors):
    """Return a layout of drawn cords, in the order of their channels."""
    cords = tuple(cord(s, k) for k, s in enumerate(sensors))
    noise = (0.003,) * len(cords)
    prediction = Prediction(
        "affine", noise, 1.2, 1.1, 3, "held out", 1.0, 0.9, 2.0, 1.5, 0.1, {}, {}
    )
    band = BandRecord(1.0, 0.9, 1.1, 0.3, 0.05, 0.05, 0.01, 0.5, 600)
    limits = LimitsRecord(1.2, 5.0, 3.4)
    return LayoutRecord(
        "bar",
        "mesh",
        limits,
        None,
        cords,
        4.0,
        (),
        (),
        prediction,
        {},
        {},
        band,
        prediction,
        (),
        False,
        (),
        1,
    )
