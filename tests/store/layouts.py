"""Make layouts with arbitrary predictions for tests."""

from __future__ import annotations

import numpy as np

from defsense_fab.store.layout import (
    BandRecord,
    CordPath,
    CordRecord,
    ErrorRange,
    LayoutRecord,
    LimitsRecord,
    Prediction,
)

BAND = BandRecord(
    median=1.0,
    low=0.9,
    high=1.1,
    trained=ErrorRange(1.5, 1.0, 2.0),
    families={
        "viscoelastic": ErrorRange(1.2, 1.0, 1.4),
        "hysteretic": ErrorRange(1.7, 1.4, 2.0),
    },
    affine=ErrorRange(3.0, 2.0, 4.0),
    offset=0.3,
    gauge=0.05,
    amplitude=0.05,
    ends=0.7,
    compression=0.5,
    frames=600,
)


def cord(sensor, channel):
    """Return the record of a drawn cord."""
    line = np.array([[0.0, 0, 0], [150, 0, 0]])
    return CordRecord(
        **vars(CordPath.of(sensor)),
        channel=channel,
        points=line,
        length=150.0,
        min_radius=9.0,
        min_wall=2.0,
        inlets=(1.0, 1.0),
        cord_diameter=2.0,
        peak_strain=0.1,
        least_strain=0.0,
        stretch=line,
        series=0.0,
        prestretch=None,
        noise=0.003,
    )


def layout(*sensors):
    """Return a layout of drawn cords, in the order of their channels."""
    cords = tuple(cord(s, k) for k, s in enumerate(sensors))
    prediction = Prediction(
        decoder="affine",
        noise=(0.003,) * len(cords),
        unseen=1.2,
        unseen_noise_free=1.1,
        tested=3,
        how="held out",
        rmse=1.0,
        rmse_noise_free=0.9,
        peak=2.0,
        average_peak=1.5,
        floor=0.1,
        per_state={},
        held_out={},
    )
    return LayoutRecord(
        device="bar",
        mesh="mesh",
        limits=LimitsRecord(1.2, 5.0, 3.4),
        response=None,
        sensors=cords,
        min_clearance=4.0,
        warnings=(),
        weighed=(),
        prediction=prediction,
        unseen={},
        cross_validated={},
        band=BAND,
        initial=prediction,
        drawn=(),
        proposed=False,
        starts=(),
        seed=1,
    )
