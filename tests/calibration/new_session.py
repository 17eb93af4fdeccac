"""A calibration session without frames, and the specimen that it measures."""

from defsense_fab.calibration import session as sessions
from defsense_fab.calibration.options import MeasureOptions
from defsense_fab.calibration.readings import BendingSpecimen

SPECIMEN = {
    "length": 150,
    "thickness": 15,
    "channels": {"inner": 2},
    "jigs": [{"radius": r} for r in (None, 75, 112, 200)],
}


def create_session(folder, rounds=1, radii=(75.0, 112.0, 200.0)):
    specimen = BendingSpecimen(radii=radii)
    return sessions.create_session(folder, specimen, MeasureOptions(name="s", rounds=rounds))
